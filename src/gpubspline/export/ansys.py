"""Archives for ANSYS Mechanical APDL (.cdb), read by CDREAD or /INPUT: nodes, elements, components, materials, loads.

The material by node is a table over temperature (of at most 100 rows, which is ANSYS's limit), each node's temperature
a body load; or a material number for each bin. A surface is a component of MESH200 elements, which the solver leaves
out; its name ends in ``_faces``, since a component has its name for itself.

Source: Ansys Mechanical APDL command reference: NBLOCK, EBLOCK, CMBLOCK, MPTEMP, MPDATA, BF, D, F, SFE, ACEL; element
reference: SOLID185, SOLID186, SHELL181, SHELL281, MESH200.
"""

from pathlib import Path
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray

from gpubspline.export.columns import Fixed, write_lines
from gpubspline.export.deck import Deck
from gpubspline.export.deck_loads import DeckLoads
from gpubspline.export.deck_material import NodalTable
from gpubspline.export.formats import Format
from gpubspline.export.names import free
from gpubspline.export.rows import REAL, chunks
from gpubspline.files import whole_file

ELEMENT_TYPES = {"quad4": "SHELL181", "quad8": "SHELL281", "hex8": "SOLID185", "hex20": "SOLID186"}
"""Vertices are numbered as VTK's."""

MESH200 = {"quad4": 6, "quad8": 7}
"""KEYOPT(1) of MESH200 for the faces of hexes."""

SIDES = {"w0": 1, "v0": 2, "u1": 3, "v1": 4, "u0": 5, "w1": 6}
"""Faces of SOLID185 and SOLID186: J-I-L-K, I-J-N-M, J-K-O-N, K-L-P-O, L-I-M-P, M-N-O-P."""

MOST_ROWS = 100
"""Temperatures of a material table."""

MOST_CHARACTERS = 32
LONGEST_NAME = MOST_CHARACTERS - len("_elements")
"""Characters of a component's name, less the longest ending that one gets here."""

PER_COMMAND = 6
"""Values of one MPTEMP or MPDATA."""


def write(deck: Deck, path: Path) -> None:
    """Write an archive."""
    with whole_file(path) as temporary, open(temporary, "w", encoding="ascii", errors="replace", newline="\n") as out:
        out.writelines(f"/COM,{line}\n" for line in deck.comment_lines(70))
        out.write("/PREP7\n")
        _write_types(out, deck)
        _write_nodes(out, deck)
        _write_elements(out, deck)
        _write_components(out, deck)
        if deck.table is not None:
            _write_table(out, deck.table)
        for number, section in enumerate(deck.sections, start=1):
            known = {"EX": section.modulus, "PRXY": section.poisson, "DENS": section.density}
            out.writelines(f"MP,{key},{number},{REAL % value}\n" for key, value in known.items() if value is not None)
        out.write("FINISH\n")
        if deck.loads is not None or deck.table is not None:
            out.write("/SOLU\nANTYPE,0\n")
            if deck.table is not None:
                nodes = np.arange(deck.mesh.n_nodes) + 1
                write_lines(out, "BF,{},TEMP,{}", [nodes, Fixed(deck.table.temperature, 16)])
            if deck.loads is not None:
                _write_loads(out, deck, deck.loads)
            out.write("FINISH\n")


def _write_types(out: TextIO, deck: Deck) -> None:
    element = deck.mesh.element
    out.write(f"ET,1,{ELEMENT_TYPES[element.name][-3:]}\n")
    if element.dimension == 3:
        out.write(f"ET,2,200\nKEYOPT,2,1,{MESH200[element.side_name]}\n")
    else:
        out.write(f"SECTYPE,1,SHELL\nSECDATA,{deck.thickness:g},1\n")


def _write_nodes(out: TextIO, deck: Deck) -> None:
    count = deck.mesh.n_nodes
    out.write(f"NBLOCK,6,SOLID,{count:10d},{count:10d}\n(3i10,6e21.13e3)\n")
    columns = [Fixed(np.arange(count) + 1, 10), *(Fixed(plane, 21) for plane in deck.mesh.planes)]
    write_lines(out, f"{{}}{0:10d}{0:10d}{{}}{{}}{{}}", columns)
    out.write("N,R5.3,LOC,       -1,\n")


def _write_elements(out: TextIO, deck: Deck) -> None:
    mesh = deck.mesh
    faces = [faces.nodes for faces in deck.surfaces.values()]
    total = mesh.n_elements + sum(map(len, faces))
    out.write(f"EBLOCK,19,SOLID,{total:10d},{total:10d}\n(19i10)\n")
    material = np.ones(mesh.n_elements, dtype=np.int64)
    for number, section in enumerate(deck.sections, start=1):
        material[section.members] = number
    for rows in chunks(mesh.n_elements):
        elements = np.arange(rows.start, rows.stop)
        _write_rows(out, 1, material[rows], elements + 1, mesh.cells_of(elements) + 1)
    first = mesh.n_elements + 1
    for nodes in faces:
        labels = np.arange(first, first + len(nodes))
        _write_rows(out, 2, np.ones(len(nodes), dtype=np.int64), labels, nodes + 1)
        first += len(nodes)
    out.write(f"{-1:10d}\n")


def _write_rows(out: TextIO, kind: int, material: NDArray[Any], labels: NDArray[Any], cells: NDArray[Any]) -> None:
    """Material, type, real, section, system, death, solid, shape; count of nodes, nothing, label; nodes, 8 and 12."""
    head = "{}" + f"{kind:10d}{1:10d}{1:10d}" + f"{0:10d}" * 4 + f"{cells.shape[1]:10d}{0:10d}{{}}"
    nodes = "{}" * min(8, cells.shape[1]) + ("\n" + "{}" * (cells.shape[1] - 8) if cells.shape[1] > 8 else "")
    write_lines(out, head + nodes, [Fixed(column, 10) for column in (material, labels, *cells.T)])


def _write_components(out: TextIO, deck: Deck) -> None:
    taken: set[str] = set()

    def write_component(name: str, kind: str, members: NDArray[Any]) -> None:
        name = free(name, taken, MOST_CHARACTERS)
        taken.add(name)
        _write_component(out, name, kind, members)

    for name, members in deck.node_sets.items():
        write_component(name, "NODE", members)
    of_nodes = {name.lower() for name in taken}
    for name, members in {deck.body: np.arange(deck.mesh.n_elements), **deck.element_sets}.items():
        write_component(f"{name}_elements" if name.lower() in of_nodes else name, "ELEM", members)
    first = deck.mesh.n_elements
    for name, faces in deck.surfaces.items():
        write_component(f"{name}_faces", "ELEM", np.arange(first, first + len(faces.nodes)))
        first += len(faces.nodes)


def _write_component(out: TextIO, name: str, kind: str, members: NDArray[Any]) -> None:
    labels = np.asarray(members, dtype=np.int64) + 1
    out.write(f"CMBLOCK,{name.upper()},{kind},{len(labels):8d}\n(8i10)\n")
    whole = len(labels) // 8 * 8
    if whole:
        write_lines(out, "{}" * 8, [Fixed(column, 10) for column in labels[:whole].reshape(-1, 8).T])
    if whole < len(labels):
        out.write("".join(f"{label:10d}" for label in labels[whole:].tolist()) + "\n")


def _write_table(out: TextIO, table: NodalTable) -> None:
    columns = {"EX": table.modulus, "PRXY": table.poisson, "DENS": table.density}
    out.write("MPTEMP\n")
    _write_values(out, "MPTEMP", table.at)
    for key, values in columns.items():
        if values is not None:
            _write_values(out, f"MPDATA,{key},1", values)


def _write_values(out: TextIO, command: str, values: NDArray[Any]) -> None:
    for first in range(0, values.size, PER_COMMAND):
        row = ",".join(REAL % value for value in values[first : first + PER_COMMAND].tolist())
        out.write(f"{command},{first + 1},{row}\n")


def _write_loads(out: TextIO, deck: Deck, loads: DeckLoads) -> None:
    nodes, forces = loads.forced()
    for component, axis in enumerate("XYZ"):
        held, at = loads.held(component)
        write_lines(out, f"D,{{}},U{axis},{{}}", [held + 1, Fixed(at, 16)])
        pushed = np.flatnonzero(forces[:, component])
        write_lines(out, f"F,{{}},F{axis},{{}}", [nodes[pushed] + 1, Fixed(forces[pushed, component], 16)])
    numbers = np.array([SIDES.get(side, 0) for side in deck.mesh.element.sides])
    for surface, pressure in loads.pressures:
        faces = deck.surfaces[surface]
        columns = [faces.elements + 1, numbers[faces.sides]]
        write_lines(out, f"SFE,{{}},{{}},PRES,,{REAL % pressure}", columns)
    if loads.gravity is not None:  # the frame's acceleration, which pushes the other way
        out.write("ACEL," + ",".join(REAL % (0.0 - value) for value in loads.gravity) + "\n")


FORMATS = (
    Format(
        "ansys",
        (".cdb",),
        tuple(ELEMENT_TYPES),
        write,
        nodal="table",
        most_rows=MOST_ROWS,
        binned=True,
        loads=True,
        sets=True,
        longest_name=LONGEST_NAME,
        readable=False,
    ),
)
