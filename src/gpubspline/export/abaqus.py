"""Decks for Abaqus and CalculiX (.inp): nodes, elements, sets, surfaces, sections, a material by node, a load case.

The nodal material travels as a table over temperature, with the nodal carrier of it as the initial temperature; see
``modulus_table``. Without ``*EXPANSION`` it strains nothing. Elements with straight edges (C3D8) take one temperature,
the mean of their nodes, in both solvers: the modulus is the temperature. Those with curved edges (C3D20) interpolate
it: HU is the temperature.

Source: Abaqus keywords reference, *ELASTIC, *INITIAL CONDITIONS, *SURFACE, *DSLOAD; CalculiX CrunchiX 2.20 user's
manual, the same keywords, "Eight-node brick element", "Twenty-node brick element".
"""

from pathlib import Path
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray

from gpubspline.export.deck import Deck
from gpubspline.export.deck_loads import DeckLoads
from gpubspline.export.deck_material import NodalTable
from gpubspline.export.formats import Format
from gpubspline.export.rows import REAL, texts, write_cells, write_members, write_reals, write_rows
from gpubspline.files import whole_file

ELEMENT_TYPES = {"quad4": "S4", "quad8": "S8R", "hex8": "C3D8", "hex20": "C3D20"}
"""Abaqus's names; vertices are numbered as VTK's. Both solvers know these, and neither hexes of 27 nor quads of 9."""

SIDES = {"w0": "S1", "w1": "S2", "v0": "S3", "u1": "S4", "v1": "S5", "u0": "S6"}
"""Faces of hexes: 1-2-3-4, 5-8-7-6, 1-5-6-2, 2-6-7-3, 3-7-8-4, 4-8-5-1."""

LONGEST_NAME = 80

AXES = "axes"
"""Name of the orientation of orthotropic elements."""


def write(deck: Deck, path: Path) -> None:
    """Write a deck, its step from the load case, or the text ``deck.step``."""
    with whole_file(path) as temporary, open(temporary, "w", encoding="ascii", errors="replace", newline="\n") as out:
        out.write("*HEADING\ngpubspline\n")
        out.writelines(f"** {line}\n" for line in deck.comment_lines(100))
        _write_mesh(out, deck)
        if deck.table is not None:
            _write_table(out, deck, deck.table)
        if deck.sections:
            _write_sections(out, deck)
        if deck.loads is not None:
            _write_step(out, deck.loads, deck.body)
        out.write(deck.step)


def _write_mesh(out: TextIO, deck: Deck) -> None:
    mesh = deck.mesh
    out.write("*NODE, NSET=all_nodes\n")
    write_reals(out, list(mesh.planes))
    out.write(f"*ELEMENT, TYPE={ELEMENT_TYPES[mesh.element_type]}, ELSET={deck.body}\n")
    for first, cells in mesh.cell_blocks():
        write_cells(out, cells, first + 1)
    for name, members in deck.node_sets.items():
        _write_set(out, "NSET", name, members)
    for name, members in deck.element_sets.items():
        _write_set(out, "ELSET", name, members)
    labels = np.array([SIDES.get(side, "") for side in mesh.element.sides])
    for name, faces in deck.surfaces.items():
        out.write(f"*SURFACE, NAME={name}, TYPE=ELEMENT\n")
        write_rows(out, [faces.elements + 1, labels[faces.sides]])


def _write_set(out: TextIO, keyword: str, name: str, members: NDArray[Any]) -> None:
    out.write(f"*{keyword}, {keyword}={name}\n")
    write_members(out, members)


def _write_section(out: TextIO, deck: Deck, elements: str, material: str) -> None:
    if deck.mesh.element.dimension == 3:
        along = "" if deck.axes is None else f", ORIENTATION={AXES}"
        out.write(f"*SOLID SECTION, ELSET={elements}, MATERIAL={material}{along}\n")
    else:
        out.write(f"*SHELL SECTION, ELSET={elements}, MATERIAL={material}\n{deck.thickness:g}\n")


def _write_table(out: TextIO, deck: Deck, table: NodalTable) -> None:
    out.write("*MATERIAL, NAME=bone\n*ELASTIC, TYPE=ISOTROPIC\n")
    at = texts(table.at)
    out.writelines(_lines(at, table.modulus, table.poisson))
    if table.density is not None:
        out.write("*DENSITY\n")
        out.writelines(_lines(at, table.density))
    _write_section(out, deck, deck.body, "bone")
    out.write("*INITIAL CONDITIONS, TYPE=TEMPERATURE\n")
    write_reals(out, [table.temperature])


def _write_axes(out: TextIO, axes: NDArray[np.float64]) -> None:
    """Axes 1 and 2 of each element, from the origin; a default before them, which both solvers want."""
    out.write(f"*DISTRIBUTION TABLE, NAME={AXES}_table\nCOORD3D, COORD3D\n")
    out.write(
        f"*DISTRIBUTION, NAME={AXES}_by_element, LOCATION=ELEMENT, TABLE={AXES}_table\n, 1., 0., 0., 0., 1., 0.\n"
    )
    write_reals(out, list(axes.T))
    out.write(f"*ORIENTATION, NAME={AXES}, SYSTEM=RECTANGULAR\n{AXES}_by_element\n")


def _write_sections(out: TextIO, deck: Deck) -> None:
    if deck.axes is not None:
        _write_axes(out, deck.axes)
    for section in deck.sections:
        _write_set(out, "ELSET", section.name, section.members)
    for section in deck.sections:
        material = section.name.replace("modulus", "bone")
        if section.constants:
            row = [REAL % value for value in section.constants]
            out.write(f"*MATERIAL, NAME={material}\n*ELASTIC, TYPE=ENGINEERING CONSTANTS\n")
            out.write(f"{','.join(row[:8])}\n{row[8]}\n")
        else:
            out.write(f"*MATERIAL, NAME={material}\n*ELASTIC, TYPE=ISOTROPIC\n")
            out.write(f"{REAL % section.modulus},{REAL % section.poisson}\n")
        if section.density is not None:
            out.write(f"*DENSITY\n{REAL % section.density}\n")
        _write_section(out, deck, section.name, material)


def _write_step(out: TextIO, loads: DeckLoads, body: str) -> None:
    out.write("*STEP\n*STATIC\n*BOUNDARY\n")
    for component in range(3):
        nodes, at = loads.held(component)
        write_rows(out, [nodes + 1, *(np.full(nodes.size, component + 1),) * 2, at])
    nodes, forces = loads.forced()
    if nodes.size:
        out.write("*CLOAD\n")
        for component in range(3):
            pushed = np.flatnonzero(forces[:, component])
            write_rows(out, [nodes[pushed] + 1, np.full(pushed.size, component + 1), forces[pushed, component]])
    if loads.pressures:
        out.write("*DSLOAD\n")
        out.writelines(f"{surface}, P, {REAL % pressure}\n" for surface, pressure in loads.pressures)
    if loads.gravity is not None:
        size = float(np.linalg.norm(loads.gravity))
        along = ", ".join(REAL % value for value in loads.gravity / size)
        out.write(f"*DLOAD\n{body}, GRAV, {REAL % size}, {along}\n")
    out.write("*NODE FILE\nU, RF\n*EL FILE\nS, E\n*END STEP\n")


def _lines(at: list[str], *columns: NDArray[np.float64]) -> list[str]:
    """Rows of a table along ``at``, which stands last."""
    line = ",".join([REAL] * len(columns)) + ",%s\n"
    return [line % row for row in zip(*(column.tolist() for column in columns), at, strict=True)]


FORMATS = (
    Format(
        "abaqus",
        (".inp",),
        tuple(ELEMENT_TYPES),
        write,
        nodal="table",
        binned=True,
        orthotropic=True,
        loads=True,
        sets=True,
        longest_name=LONGEST_NAME,
    ),
)
