"""MED (.med, version 3.0 of its layout in HDF5), as SALOME, Code_Aster and code_saturne read it.

Sets and surfaces are groups, held as families; surfaces are quads beside the hexes. The modulus is the nodal field
``E_MPa`` (with Poisson's ratio and density), or a group and element fields for the bins; the load case is nodal fields.
What the deck says of itself stands in the mesh's description, and whole in an attribute of the file.

A hex of MED is numbered with its first face outward, so that its vertices are VTK's 0 3 2 1 4 7 6 5.

Source: MED 3 file format ("documentation MED", structure of the files); MEDCoupling's cell models; checked with
MEDCoupling's own reader.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.export.deck import Deck
from gpubspline.export.formats import Format
from gpubspline.export.groups import Families, facets, families
from gpubspline.files import whole_file
from gpubspline.mesh.mesh import Mesh

CELLS = {"quad4": "QU4", "quad8": "QU8", "hex8": "HE8", "hex20": "H20"}
_HEX8 = (0, 3, 2, 1, 4, 7, 6, 5)
ORDER = {"hex8": _HEX8, "hex20": (*_HEX8, 11, 10, 9, 8, 15, 14, 13, 12, 16, 19, 18, 17)}
"""Of the vertices, in VTK's numbers, where it is another."""

MESH = "mesh"
PROFILE = "MED_NO_PROFILE_INTERNAL"
MESH_STEP = f"{-1:020d}{-1:020d}"
FIELD_STEP = f"{1:020d}{-1:020d}"
GROUP_NAME = 80
FLOAT64 = 6


def write(deck: Deck, path: Path) -> None:
    """Write a mesh with its groups and fields."""
    import h5py

    with whole_file(path) as temporary, h5py.File(temporary, "w") as file:
        _attributes(file.create_group("INFOS_GENERALES"), MAJ=3, MIN=0, REL=0)
        _attributes(file, COMMENT="\n".join(deck.comments))  # whole; the mesh's description ends at 200 characters
        outer = facets(deck.surfaces)
        sets = {deck.body: np.arange(deck.mesh.n_elements), **deck.element_sets}
        sets |= {section.name: section.members for section in deck.sections}
        of_cells = families(deck.mesh.n_elements, sets)
        of_nodes = families(deck.mesh.n_nodes, deck.node_sets)
        step = _make_mesh(file, deck)
        _write_nodes(step, deck, of_nodes)
        cells = step.create_group("MAI")
        _attributes(cells, CGT=1)
        order = list(ORDER.get(deck.mesh.element_type, range(deck.mesh.element.n_nodes)))
        _write_cells(cells, CELLS[deck.mesh.element_type], deck.mesh.cells[:, order], -1 - of_cells.of)
        groups = _named(of_cells, -1, -1)
        if outer is not None:
            first = -1 - len(of_cells.names)
            name = CELLS[deck.mesh.element.side_name]
            _write_cells(cells, name, outer.nodes, first - outer.families.of)
            groups |= _named(outer.families, first, -1)
        _write_families(file, _named(of_nodes, 1, 1), groups)
        _write_fields(file, deck)


def _attributes(group: Any, **values: Any) -> None:
    for name, value in values.items():
        given = np.bytes_(value.encode("ascii", "replace")) if isinstance(value, str) else value
        group.attrs.create(name, given)


def _make_mesh(file: Any, deck: Deck) -> Any:
    """Make the mesh, and give its only step."""
    mesh = file.create_group(f"ENS_MAA/{MESH}")
    axes, length = "".join(f"{axis:<16}" for axis in "XYZ"), deck.units.length
    dimension = deck.mesh.element.dimension
    words = " ".join(deck.comments)[:200]
    _attributes(mesh, DIM=dimension, ESP=3, REP=0, UNT="", UNI=f"{length:<16}" * 3, SRT=1, NOM=axes, DES=words, TYP=0)
    step = mesh.create_group(MESH_STEP)
    _attributes(step, CGT=1, NDT=-1, NOR=-1, PDT=-1.0)
    return step


def _write_nodes(step: Any, deck: Deck, of: Families) -> None:
    nodes = step.create_group("NOE")
    _attributes(nodes, CGT=1, CGS=1, PFL=PROFILE)
    _data(nodes, "COO", deck.mesh.planes.astype(np.float64).ravel(), deck.mesh.n_nodes)
    numbers = np.array([1 + number if names else 0 for number, names in enumerate(of.names)])
    _data(nodes, "FAM", numbers[of.of], deck.mesh.n_nodes)


def _write_cells(cells: Any, kind: str, nodes: NDArray[Any], family: NDArray[np.int64]) -> None:
    group = cells.create_group(kind)
    _attributes(group, CGT=1, CGS=1, PFL=PROFILE)
    _data(group, "NOD", (nodes.T + 1).astype(np.int64).ravel(), len(nodes))
    _data(group, "FAM", family, len(nodes))


def _data(group: Any, name: str, values: NDArray[Any], count: int) -> None:
    _attributes(group.create_dataset(name, data=values), CGT=1, NBR=count)


def _named(of: Families, first: int, step: int) -> dict[int, tuple[str, ...]]:
    """Numbers of the families that are in any group, and the groups."""
    return {first + step * number: names for number, names in enumerate(of.names) if names}


def _write_families(file: Any, nodes: Mapping[int, tuple[str, ...]], cells: Mapping[int, tuple[str, ...]]) -> None:
    import h5py

    every = file.create_group(f"FAS/{MESH}")
    _attributes(every.create_group("FAMILLE_ZERO"), NUM=0)
    for place, families_of in (("NOEUD", nodes), ("ELEME", cells)):
        if not families_of:
            continue
        group = every.create_group(place)
        for number, names in families_of.items():
            family = group.create_group(f"FAM_{number}")
            _attributes(family, NUM=number)
            held = family.create_group("GRO")
            _attributes(held, NBR=len(names))
            table = np.array([name.encode("ascii") for name in names], dtype=f"S{GROUP_NAME}")
            texts = table.view(np.int8).reshape(len(names), GROUP_NAME)
            kind = h5py.h5t.array_create(h5py.h5t.NATIVE_INT8, (GROUP_NAME,))
            space = h5py.h5s.create_simple((len(names),))
            made = h5py.h5d.create(held.id, b"NOM", kind, space)
            made.write(h5py.h5s.ALL, h5py.h5s.ALL, texts, mtype=kind)


def _write_fields(file: Any, deck: Deck) -> None:
    mesh = deck.with_all_fields
    every = file.create_group("CHA")
    for name, values in mesh.fields.items():
        _write_field(every, name, "NOE", values)
    for name, values in mesh.cell_fields.items():
        known = name if name not in mesh.fields else f"{name}_of_elements"
        _write_field(every, known, f"MAI.{CELLS[mesh.element_type]}", values)


def _write_field(every: Any, name: str, where: str, values: NDArray[Any]) -> None:
    field = every.create_group(name.replace("/", "_"))  # HDF5's own
    _attributes(field, MAI=MESH, TYP=FLOAT64, UNI=f"{'':16}", UNT="", NCO=1, NOM=f"{name[:16]:<16}")
    step = field.create_group(FIELD_STEP)
    _attributes(step, NDT=1, NOR=-1, PDT=0.0, RDT=-1, ROR=-1)
    support = step.create_group(where)
    _attributes(support, GAU="", PFL=PROFILE)
    data = support.create_group(PROFILE)
    _attributes(data, NBR=len(values), NGA=1, GAU="")
    data.create_dataset("CO", data=values.astype(np.float64))


def read(path: Path) -> Mesh:
    """Read the hexes, or the quads, of the first mesh of a file, at its first step.

    Raises
    ------
    KeyError, OSError or ValueError where the file is broken or has neither.
    """
    import h5py

    with h5py.File(path, "r") as file:
        name, mesh = next(iter(file["ENS_MAA"].items()))
        step = next(iter(mesh.values()))
        kind = next(each for each in ("hex8", "hex20", "quad4", "quad8") if CELLS[each] in step["MAI"])
        cells, nodes = step["MAI"][CELLS[kind]], step["NOE"]
        n_nodes, n_cells = int(nodes["COO"].attrs["NBR"]), int(cells["NOD"].attrs["NBR"])
        table = cells["NOD"][:].reshape(-1, n_cells).T - 1
        order = np.argsort(ORDER.get(kind, range(table.shape[1])))
        groups = _read_groups(file, name)
        return Mesh(
            nodes["COO"][:].reshape(-1, n_nodes).T,
            kind,
            connectivity=table[:, order],
            fields=_read_fields(file, "NOE", n_nodes),
            cell_fields=_read_fields(file, f"MAI.{CELLS[kind]}", n_cells),
            node_sets=_members(nodes["FAM"][:], groups) if "FAM" in nodes else {},
            element_sets=_members(cells["FAM"][:], groups) if "FAM" in cells else {},
        )


def _read_groups(file: Any, mesh: str) -> dict[int, list[str]]:
    """Groups of each family by its number."""
    found = {}
    for place in file[f"FAS/{mesh}"].values():
        for family in place.values():
            if "GRO" in family:
                rows = family["GRO"]["NOM"][:]
                names = [bytes(row.astype(np.uint8)).split(b"\0")[0].decode("ascii", "replace") for row in rows]
                found[int(family.attrs["NUM"])] = [name.strip() for name in names]
    return found


def _members(family: NDArray[Any], groups: dict[int, list[str]]) -> dict[str, NDArray[np.int32]]:
    names = dict.fromkeys(name for number in np.unique(family) for name in groups.get(int(number), ()))
    numbers = {name: [number for number, held in groups.items() if name in held] for name in names}
    return {name: np.flatnonzero(np.isin(family, held)).astype(np.int32) for name, held in numbers.items()}


def _read_fields(file: Any, where: str, count: int) -> dict[str, NDArray[Any]]:
    """Fields of one component at the last step, on all nodes or elements."""
    found: dict[str, NDArray[Any]] = {}
    for name, field in file.get("CHA", {}).items():
        step = field[list(field)[-1]]
        values = next(iter(step[where].values()))["CO"][:] if where in step else np.empty(0)
        if len(values) == count:
            found[name.removesuffix("_of_elements")] = values
    return found


FORMATS = (
    Format(
        "med",
        (".med",),
        tuple(CELLS),
        write,
        nodal="field",
        binned=True,
        loads=True,
        sets=True,
        longest_name=GROUP_NAME,
        fields=True,
        cell_fields=True,
        needs="h5py",
    ),
)
