"""Decks for Nastran (.bdf, .nas, .fem): a linear static solution, its material by node as a table over temperature.

Bulk data has no names: sets are numbered, and a comment before each says what it is. A surface is a set of unit
pressures (PLOAD4) that the case control does not call, as preprocessors leave them.

Source: MSC Nastran quick reference guide: GRID, CHEXA, CQUAD4, CQUAD8, MAT1, MATT1, TABLEM1, TEMP, SET1, PLOAD4, SPC,
FORCE, GRAV, LOAD; case control TEMPERATURE(MATERIAL).
"""

from pathlib import Path
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray

from gpubspline.export.columns import Fixed, write_lines
from gpubspline.export.deck import Deck
from gpubspline.export.deck_loads import DeckLoads, Faces
from gpubspline.export.deck_material import NodalTable
from gpubspline.export.formats import Format
from gpubspline.export.rows import chunks
from gpubspline.files import whole_file

CARDS = {"quad4": "CQUAD4", "quad8": "CQUAD8", "hex8": "CHEXA", "hex20": "CHEXA"}
ORDER = {"hex20": (*range(12), 16, 17, 18, 19, 12, 13, 14, 15)}
"""Of the vertices, in VTK's numbers, where it is another: midway along the bottom, the uprights, the top."""

SPC, LOAD, TEMPERATURE, FORCES, GRAVITY = 1, 2, 3, 11, 12
"""Numbers of the sets that the case control calls, and of the parts of the load."""

LONGEST_NAME = 48
"""A comment ends in column 80."""

FIRST_NODE_SET, FIRST_ELEMENT_SET, FIRST_SURFACE = 1001, 2001, 3001


def write(deck: Deck, path: Path) -> None:
    """Write a deck."""
    with whole_file(path) as temporary, open(temporary, "w", encoding="ascii", errors="replace", newline="\n") as out:
        out.writelines(f"$ {line}\n" for line in deck.comment_lines(70))
        _write_case_control(out, deck)
        _write_mesh(out, deck)
        if deck.table is not None:
            _write_table(out, deck.table)
        for number, section in enumerate(deck.sections, start=1):
            _write_material(out, number, section.modulus, section.poisson, section.density)
        for number in range(1, 1 + max(1, len(deck.sections))):
            _write_property(out, deck, number)
        _write_sets(out, deck)
        if deck.loads is not None:
            _write_loads(out, deck, deck.loads)
        out.write("ENDDATA\n")


def _write_case_control(out: TextIO, deck: Deck) -> None:
    out.write("SOL 101\nCEND\nTITLE = gpubspline\n")
    if deck.table is not None:
        out.write(f"TEMPERATURE(MATERIAL) = {TEMPERATURE}\n")
    if deck.loads is not None:
        acting = deck.loads.forces.any() or deck.loads.pressures or deck.loads.gravity is not None
        out.write(f"SUBCASE 1\nSPC = {SPC}\n" + (f"LOAD = {LOAD}\n" if acting else ""))
        out.write("DISPLACEMENT = ALL\nSPCFORCES = ALL\nSTRESS = ALL\n")
    out.write("BEGIN BULK\n")


def _write_mesh(out: TextIO, deck: Deck) -> None:
    mesh = deck.mesh
    planes = [Fixed(plane, 16) for plane in mesh.planes]
    nodes = Fixed(np.arange(mesh.n_nodes) + 1, 16)
    write_lines(out, f"GRID*   {{}}{'':16}{{}}{{}}\n*       {{}}", [nodes, *planes])
    part = np.ones(mesh.n_elements, dtype=np.int64)
    for number, section in enumerate(deck.sections, start=1):
        part[section.members] = number
    order = ORDER.get(mesh.element_type, range(mesh.element.n_nodes))
    card = f"{CARDS[mesh.element_type]:8}{{}}{{}}" + "{}" * 6 + _continued(mesh.element.n_nodes - 6)
    for rows in chunks(mesh.n_elements):
        elements = np.arange(rows.start, rows.stop)
        cells = mesh.cells_of(elements)[:, order] + 1
        if mesh.element_type == "quad4":
            card = f"{CARDS['quad4']:8}{{}}{{}}" + "{}" * 4
        write_lines(out, card, [Fixed(column, 8) for column in (elements + 1, part[rows], *cells.T)])


def _continued(count: int) -> str:
    """Template of so many fields on lines of eight."""
    return "".join("\n+       " + "{}" * min(8, count - first) for first in range(0, max(count, 0), 8))


def _write_material(out: TextIO, number: int, modulus: float, poisson: float, density: float | None) -> None:
    line = f"MAT1*   {number:16d}{_real(modulus)}{'':16}{_real(poisson)}\n"
    out.write(line if density is None else f"{line}*       {_real(density)}\n")


def _write_property(out: TextIO, deck: Deck, number: int) -> None:
    if deck.mesh.element.dimension == 3:
        out.write(f"PSOLID  {number:8d}{number:8d}\n")
    else:
        stretched_and_bent = f"PSHELL* {number:16d}{number:16d}{_real(deck.thickness)}{number:16d}\n"
        out.write(f"{stretched_and_bent}*       {'':16}{number:16d}\n")  # and sheared: without it nothing gives way


def _write_table(out: TextIO, table: NodalTable) -> None:
    density = None if table.density is None else float(table.density[0])
    _write_material(out, 1, float(table.modulus[0]), float(table.poisson[0]), density)
    tables = {1: table.modulus, 2: table.poisson} | ({} if table.density is None else {3: table.density})
    out.write(f"MATT1   {1:8d}{1:8d}{'':8}{2:8d}{3 if 3 in tables else '':>8}\n")
    at = table.at if table.at.size > 1 else table.at[0] + np.arange(2, dtype=table.at.dtype)  # two rows at least
    for number, column in tables.items():
        out.write(f"TABLEM1*{number:16d}\n*\n")
        column = np.resize(column, at.size)
        ends = 2 * (at.size // 2)
        pairs = [Fixed(values[start:ends:2], 16) for start in (0, 1) for values in (at, column)]
        write_lines(out, "*       {}{}{}{}", pairs)
        left = f"{_real(float(at[-1]))}{_real(column[-1])}" if at.size % 2 else ""
        out.write(f"*       {left}{'ENDT':>16}\n" + ("" if at.size // 2 % 2 else "*\n"))
    nodes = Fixed(np.arange(table.temperature.size) + 1, 16)
    write_lines(out, f"TEMP*   {TEMPERATURE:16d}{{}}{{}}\n*", [nodes, Fixed(table.temperature, 16)])


def _write_sets(out: TextIO, deck: Deck) -> None:
    kinds = (("Node", FIRST_NODE_SET, deck.node_sets), ("Element", FIRST_ELEMENT_SET, deck.element_sets))
    for kind, first, sets in kinds:
        for number, (name, members) in enumerate(sets.items(), start=first):
            out.write(f"$ {kind} set {number}: {name}\n")
            _write_set(out, number, members)
    for number, (name, faces) in enumerate(deck.surfaces.items(), start=FIRST_SURFACE):
        out.write(f"$ Surface {number}: {name}\n")
        _write_pressure(out, number, faces, 1.0)


def _write_set(out: TextIO, number: int, members: NDArray[Any]) -> None:
    labels = np.asarray(members, dtype=np.int64) + 1
    out.write(f"SET1    {number:8d}" + "".join(f"{label:8d}" for label in labels[:7]) + "\n")
    left = labels[7:]
    whole = len(left) // 8 * 8
    if whole:
        write_lines(out, "+       " + "{}" * 8, [Fixed(column, 8) for column in left[:whole].reshape(-1, 8).T])
    if whole < len(left):
        out.write("+       " + "".join(f"{label:8d}" for label in left[whole:]) + "\n")


def _write_pressure(out: TextIO, number: int, faces: Faces, pressure: float) -> None:
    """Into the elements where positive; a corner of the face and the one opposite tell which face."""
    columns = [Fixed(column + 1, 16) for column in (faces.elements, faces.nodes[:, 0], faces.nodes[:, 2])]
    write_lines(out, f"PLOAD4* {number:16d}{{}}{_real(pressure)}\n*       {'':32}{{}}{{}}", columns)


def _write_loads(out: TextIO, deck: Deck, loads: DeckLoads) -> None:
    for component in range(3):
        nodes, at = loads.held(component)
        held = f"SPC*    {SPC:16d}{{}}{component + 1:16d}{{}}\n*"
        write_lines(out, held, [Fixed(nodes + 1, 16), Fixed(at, 16)])
    nodes, forces = loads.forced()
    if nodes.size:
        force = f"FORCE*  {FORCES:16d}{{}}{0:16d}{_real(1.0)}\n*       {{}}{{}}{{}}"
        write_lines(out, force, [Fixed(nodes + 1, 16), *(Fixed(values, 16) for values in forces.T)])
    for surface, pressure in loads.pressures:
        _write_pressure(out, FORCES, deck.surfaces[surface], pressure)
    parts = [FORCES] if nodes.size or loads.pressures else []
    if loads.gravity is not None:  # which has a number of its own
        parts.append(GRAVITY)
        size = float(np.linalg.norm(loads.gravity))
        x, y, z = loads.gravity / size
        out.write(f"GRAV*   {GRAVITY:16d}{0:16d}{_real(size)}{_real(x)}\n*       {_real(y)}{_real(z)}\n")
    if parts:
        out.write(f"LOAD    {LOAD:8d}{'1.0':>8}" + "".join(f"{'1.0':>8}{part:8d}" for part in parts) + "\n")


def _real(value: float) -> str:
    return f"{value:16.9E}"


FORMATS = (
    Format(
        "nastran",
        (".bdf", ".nas", ".fem"),
        tuple(CARDS),
        write,
        nodal="table",
        binned=True,
        loads=True,
        sets=True,
        longest_name=LONGEST_NAME,
    ),
)
