"""Gmsh's mesh (.msh, version 4.1, as text): sets and surfaces as physical groups, fields as node and element data.

An item may be in several groups: entities are the families of items that are in the same groups. A node set is a group
of point elements, whose name ends in ``_nodes`` where a surface or an element set has the same; a surface is a group of
quads. The modulus is the node data ``E_MPa``, or a group and element data for the bins; the load case is node data.

Source: Gmsh reference manual, "MSH file format" 4.1, "Node ordering".
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray

from gpubspline.export.columns import write_lines
from gpubspline.export.deck import Deck
from gpubspline.export.formats import Format
from gpubspline.export.groups import Families, facets, families
from gpubspline.export.names import apart
from gpubspline.export.rows import chunks
from gpubspline.files import whole_file

ELEMENT_TYPES = {"quad4": 3, "quad8": 16, "quad9": 10, "hex8": 5, "hex20": 17, "hex27": 12}
POINT = 15
NODES_END = "_nodes"
LONGEST_NAME = 127 - len(NODES_END)
"""Characters of a physical name, less the ending that one gets here."""

_HEX20 = (*range(8), 8, 11, 16, 9, 17, 10, 18, 19, 12, 15, 13, 14)
ORDER = {"hex20": _HEX20, "hex27": (*_HEX20, 24, 22, 20, 21, 23, 25, 26)}
"""Of the vertices, in VTK's numbers, where it is another."""


@dataclass(frozen=True, eq=False)
class _Items:
    """Elements of one type and the families they are in.

    Attributes
    ----------
    dimension, kind: of their type.
    nodes: (m, k), or None for those of the mesh.
    families: which groups they are in.
    of: (m,) elements of the mesh whose data they take, or None for points, which have none.
    """

    dimension: int
    kind: int
    nodes: NDArray[Any] | None
    families: Families
    of: NDArray[np.int64] | None = None

    def blocks(self) -> list[NDArray[np.int64]]:
        """Their numbers, family by family, as the file holds them."""
        return [np.flatnonzero(self.families.of == number) for number in range(len(self.families.names))]


def write(deck: Deck, path: Path) -> None:
    """Write a mesh with its groups and data."""
    items = _items(deck)
    groups = sorted({(each.dimension, name) for each in items for names in each.families.names for name in names})
    tags = {group: tag for tag, group in enumerate(groups, start=1)}
    with whole_file(path) as temporary, open(temporary, "w", encoding="ascii", errors="replace", newline="\n") as out:
        out.write("$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Comments\n")
        out.writelines(f"{line}\n" for line in deck.comment_lines(100))
        out.write(f"$EndComments\n$PhysicalNames\n{len(tags)}\n")
        out.writelines(f'{dimension} {tag} "{name}"\n' for (dimension, name), tag in tags.items())
        out.write("$EndPhysicalNames\n")
        _write_entities(out, deck, items, tags)
        _write_nodes(out, deck)
        _write_elements(out, deck, items)
        mesh = deck.with_all_fields
        for name, values in mesh.fields.items():
            _write_data(out, "NodeData", name, np.arange(mesh.n_nodes), values)
        labels, places = _data_places(items)
        for name, values in mesh.cell_fields.items():
            spread = np.where(places < 0, 0, values[places])
            _write_data(out, "ElementData", name, labels, spread)


def _items(deck: Deck) -> list[_Items]:
    """Elements first, so that they have the labels from 1, then faces, then nodes of sets."""
    mesh = deck.mesh
    sets = {deck.body: np.arange(mesh.n_elements), **deck.element_sets}
    sets |= {section.name: section.members for section in deck.sections}
    kind = ELEMENT_TYPES[mesh.element_type]
    found = [_Items(mesh.element.dimension, kind, None, families(mesh.n_elements, sets), np.arange(mesh.n_elements))]
    outer = facets(deck.surfaces)
    if outer is not None:
        found.append(_Items(2, ELEMENT_TYPES[mesh.element.side_name], outer.nodes, outer.families, outer.elements))
    if deck.node_sets:
        taken = {*sets, *deck.surfaces}  # readers keep one group of a name
        called = apart(deck.node_sets, taken, NODES_END)
        within = families(mesh.n_nodes, {called[name]: nodes for name, nodes in deck.node_sets.items()})
        inside = np.array([bool(names) for names in within.names])[within.of]
        of, names = within.of[inside], [names for names in within.names if names]
        shift = np.cumsum([bool(names) for names in within.names]) - 1  # the family of no set is left out
        found.append(_Items(0, POINT, np.flatnonzero(inside)[:, None], Families(shift[of], names)))
    return found


def _write_entities(out: TextIO, deck: Deck, items: list[_Items], tags: dict[tuple[int, str], int]) -> None:
    of = {each.dimension: each for each in items}
    counts = [len(of[d].families.names) if d in of else 0 for d in range(4)]
    out.write(f"$Entities\n{' '.join(map(str, counts))}\n")
    low, high = deck.mesh.points.min(axis=0), deck.mesh.points.max(axis=0)
    for dimension, each in sorted(of.items()):
        box = [*low] if dimension == 0 else [*low, *high]
        for number, names in enumerate(each.families.names, start=1):
            held = " ".join(str(tags[dimension, name]) for name in names)
            end = "" if dimension == 0 else " 0"
            out.write(f"{number} {' '.join(f'{x:.9g}' for x in box)} {len(names)} {held}{end}\n")
    out.write("$EndEntities\n")


def _write_nodes(out: TextIO, deck: Deck) -> None:
    count = deck.mesh.n_nodes
    out.write(f"$Nodes\n1 {count} 1 {count}\n{deck.mesh.element.dimension} 1 0 {count}\n")
    write_lines(out, "{}", [np.arange(count) + 1])
    write_lines(out, "{} {} {}", list(deck.mesh.planes))
    out.write("$EndNodes\n")


def _write_elements(out: TextIO, deck: Deck, items: Sequence[_Items]) -> None:
    total = sum(len(each.families.of) for each in items)
    blocks = sum(len(each.families.names) for each in items)
    out.write(f"$Elements\n{blocks} {total} 1 {total}\n")
    order = list(ORDER.get(deck.mesh.element_type, range(deck.mesh.element.n_nodes)))
    first = 1
    for each in items:
        for number, members in enumerate(each.blocks()):
            out.write(f"{each.dimension} {number + 1} {each.kind} {members.size}\n")
            for rows in chunks(members.size):
                part = members[rows]
                nodes = deck.mesh.cells_of(part)[:, order] if each.nodes is None else each.nodes[part]
                write_lines(out, " ".join(["{}"] * (1 + nodes.shape[1])), [part + first, *(nodes.T + 1)])
        first += len(each.families.of)
    out.write("$EndElements\n")


def _data_places(items: Sequence[_Items]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Numbers of all elements as the file holds them, and the elements of the mesh whose data they take, -1 for none.

    Readers such as meshio's take data in the order of the elements and want some for each.
    """
    labels, places, first = [], [], 0
    for each in items:
        order = np.concatenate(each.blocks())
        labels.append(order + first)
        places.append(np.full(order.size, -1) if each.of is None else each.of[order])
        first += order.size
    return np.concatenate(labels), np.concatenate(places)


def _write_data(out: TextIO, kind: str, name: str, of: NDArray[Any], values: NDArray[Any]) -> None:
    out.write(f'${kind}\n1\n"{name}"\n1\n0.0\n3\n0\n1\n{len(values)}\n')
    write_lines(out, "{} {}", [of + 1, values])
    out.write(f"$End{kind}\n")


FORMATS = (
    Format(
        "gmsh",
        (".msh",),
        tuple(ELEMENT_TYPES),
        write,
        nodal="field",
        binned=True,
        loads=True,
        sets=True,
        longest_name=LONGEST_NAME,
        fields=True,
        cell_fields=True,
    ),
)
