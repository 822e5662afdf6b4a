"""Decks for LS-DYNA (.k, .key, .dyn): a linear implicit solution, a part and a material for each bin of modulus.

LS-DYNA knows no elastic modulus by node. Fields are of the standard width, 10 characters for most: five digits or so.

Source: LS-DYNA keyword user's manual, volumes I and II: *NODE, *ELEMENT_SOLID, *ELEMENT_SHELL, *PART, *SECTION_SOLID,
*SECTION_SHELL, *MAT_ELASTIC, *SET_NODE_LIST, *SET_SOLID, *SET_SHELL_LIST, *SET_SEGMENT, *BOUNDARY_SPC_NODE,
*BOUNDARY_PRESCRIBED_MOTION_NODE, *LOAD_NODE_POINT, *LOAD_SEGMENT_SET, *LOAD_BODY, *CONTROL_IMPLICIT_GENERAL.
"""

from pathlib import Path
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray

from gpubspline.errors import InputError
from gpubspline.export.columns import Fixed, write_lines
from gpubspline.export.deck import Deck
from gpubspline.export.deck_loads import DeckLoads, Faces
from gpubspline.export.formats import Format
from gpubspline.export.rows import chunks
from gpubspline.files import whole_file

ELEMENT_TYPES = ("quad4", "hex8")
"""Those whose vertices LS-DYNA numbers as VTK does; its order of twenty could not be confirmed from its source."""

FULLY_INTEGRATED = {2: 16, 3: 2}
"""ELFORM of shells and of solids."""

LONGEST_NAME = 80
"""Characters of a title."""

CONTROL = """*CONTROL_IMPLICIT_GENERAL
         1       1.0
*CONTROL_IMPLICIT_SOLUTION
         1
*CONTROL_TERMINATION
       1.0
*DATABASE_BINARY_D3PLOT
       1.0
"""
"""Implicit in one step of one second; NSOLVR 1 is linear."""

RAMP = f"*DEFINE_CURVE\n{1:10d}\n{0.0:20.1f}{0.0:20.1f}\n{1.0:20.1f}{1.0:20.1f}\n"
CURVE, DISPLACEMENT = 1, 2
"""Number of the ramp; VAD of a prescribed motion."""


def write(deck: Deck, path: Path) -> None:
    """Write a deck; raises InputError for a mesh without modulus, Poisson's ratio or density, which parts must have."""
    if not deck.sections or any(section.density is None for section in deck.sections):
        words = "expected the fields E_MPa, nu and density_g_cm3 for .k, whose parts have a material with a density"
        raise InputError(f"{words}, got a mesh without")
    with whole_file(path) as temporary, open(temporary, "w", encoding="ascii", errors="replace", newline="\n") as out:
        out.write("*KEYWORD\n")
        out.writelines(f"$ {line}\n" for line in deck.comment_lines(70))
        out.write("*TITLE\ngpubspline\n")
        if deck.loads is not None:
            out.write(CONTROL)
        _write_mesh(out, deck)
        _write_parts(out, deck)
        numbers = _write_sets(out, deck)
        if deck.loads is not None:
            _write_loads(out, deck.loads, numbers)
        out.write("*END\n")


def _write_mesh(out: TextIO, deck: Deck) -> None:
    mesh = deck.mesh
    out.write("*NODE\n")
    nodes = Fixed(np.arange(mesh.n_nodes) + 1, 8)
    write_lines(out, "{}{}{}{}", [nodes, *(Fixed(plane, 16) for plane in mesh.planes)])
    part = np.ones(mesh.n_elements, dtype=np.int64)
    for number, section in enumerate(deck.sections, start=1):
        part[section.members] = number
    out.write("*ELEMENT_SOLID\n" if mesh.element.dimension == 3 else "*ELEMENT_SHELL\n")
    for rows in chunks(mesh.n_elements):
        elements = np.arange(rows.start, rows.stop)
        columns = [elements + 1, part[rows], *(mesh.cells_of(elements).T + 1)]
        write_lines(out, "{}" * len(columns), [Fixed(column, 8) for column in columns])


def _write_parts(out: TextIO, deck: Deck) -> None:
    dimension = deck.mesh.element.dimension
    out.write(f"*SECTION_{'SOLID' if dimension == 3 else 'SHELL'}\n{1:10d}{FULLY_INTEGRATED[dimension]:10d}\n")
    if dimension == 2:
        out.write(f"{deck.thickness:10.5g}" * 4 + "\n")
    for number, section in enumerate(deck.sections, start=1):
        out.write(f"*PART\n{section.name}\n{number:10d}{1:10d}{number:10d}\n")
    for number, section in enumerate(deck.sections, start=1):
        known = np.array([section.density, section.modulus, section.poisson], dtype=np.float64)
        out.write("*MAT_ELASTIC\n")
        write_lines(out, f"{number:10d}{{}}{{}}{{}}", [Fixed(value, 10) for value in known[:, None]])


def _write_sets(out: TextIO, deck: Deck) -> dict[str, int]:
    """Write the sets, each kind numbered from 1; returns the numbers of the surfaces."""
    solid = deck.mesh.element.dimension == 3
    elements = {deck.body: np.arange(deck.mesh.n_elements), **deck.element_sets}
    for number, (name, members) in enumerate(deck.node_sets.items(), start=1):
        _write_set(out, "*SET_NODE_LIST_TITLE", name, number, members)
    for number, (name, members) in enumerate(elements.items(), start=1):
        _write_set(out, "*SET_SOLID_TITLE" if solid else "*SET_SHELL_LIST_TITLE", name, number, members)
    for number, (name, faces) in enumerate(deck.surfaces.items(), start=1):
        _write_segments(out, name, number, faces)
    return {name: number for number, name in enumerate(deck.surfaces, start=1)}


def _write_set(out: TextIO, keyword: str, name: str, number: int, members: NDArray[Any]) -> None:
    out.write(f"{keyword}\n{name}\n{number:10d}\n")
    labels = np.asarray(members, dtype=np.int64) + 1
    whole = len(labels) // 8 * 8
    if whole:
        write_lines(out, "{}" * 8, [Fixed(column, 10) for column in labels[:whole].reshape(-1, 8).T])
    if whole < len(labels):
        out.write("".join(f"{label:10d}" for label in labels[whole:].tolist()) + "\n")


def _write_segments(out: TextIO, name: str, number: int, faces: Faces) -> None:
    out.write(f"*SET_SEGMENT_TITLE\n{name}\n{number:10d}\n")
    write_lines(out, "{}" * 4, [Fixed(column + 1, 10) for column in faces.nodes.T[:4]])


def _write_loads(out: TextIO, loads: DeckLoads, surfaces: dict[str, int]) -> None:
    out.write(RAMP)
    for nodes, components, at in loads.supports():
        still = components & (at == 0)
        if still.any():
            flags = "".join(f"{int(held):10d}" for held in still)
            out.write("*BOUNDARY_SPC_NODE\n")
            write_lines(out, f"{{}}{0:10d}{flags}", [Fixed(nodes + 1, 10)])
        for direction in np.flatnonzero(components & ~still):
            out.write("*BOUNDARY_PRESCRIBED_MOTION_NODE\n")
            scale = Fixed(np.full(nodes.size, at[direction]), 10)
            columns = [Fixed(nodes + 1, 10), scale]
            write_lines(out, f"{{}}{direction + 1:10d}{DISPLACEMENT:10d}{CURVE:10d}{{}}", columns)
    nodes, forces = loads.forced()
    if nodes.size:
        out.write("*LOAD_NODE_POINT\n")
    for component in range(3):
        pushed = np.flatnonzero(forces[:, component])
        columns = [Fixed(nodes[pushed] + 1, 10), Fixed(forces[pushed, component], 10)]
        write_lines(out, f"{{}}{component + 1:10d}{CURVE:10d}{{}}", columns)
    for surface, pressure in loads.pressures:  # into the segment, against its normal, where positive
        out.write("*LOAD_SEGMENT_SET\n")
        write_lines(out, f"{surfaces[surface]:10d}{CURVE:10d}{{}}", [Fixed(np.array([pressure]), 10)])
    for axis, value in zip("XYZ", () if loads.gravity is None else loads.gravity.tolist(), strict=False):
        if value:  # the acceleration of the base, which pushes the other way
            out.write(f"*LOAD_BODY_{axis}\n")
            write_lines(out, f"{CURVE:10d}{{}}", [Fixed(np.array([-value]), 10)])


FORMATS = (
    Format(
        "lsdyna",
        (".k", ".key", ".dyn"),
        ELEMENT_TYPES,
        write,
        binned=True,
        loads=True,
        sets=True,
        material=True,
        longest_name=LONGEST_NAME,
        readable=False,
    ),
)
