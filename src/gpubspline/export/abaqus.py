"""Decks for Abaqus and CalculiX (.inp): nodes, elements, sets, sections and a material that varies from node to node.

The nodal material travels as a table over temperature, with the nodal carrier of it (HU) as the initial temperature;
see ``modulus_table``. Without ``*EXPANSION`` it strains nothing. Elements with straight edges (C3D8) take one
temperature, the mean of their nodes, in both solvers; those with curved edges (C3D20) interpolate it.

Source: Abaqus keywords reference, *ELASTIC, *INITIAL CONDITIONS; CalculiX CrunchiX 2.20 user's manual, *ELASTIC,
*INITIAL CONDITIONS, "Eight-node brick element", "Twenty-node brick element".
"""

import re
import textwrap
from pathlib import Path
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray

from gpubspline.errors import InputError
from gpubspline.export.modulus_bins import ModulusBins
from gpubspline.export.modulus_bins import modulus_bins as gather
from gpubspline.export.modulus_table import ModulusTable, modulus_table
from gpubspline.export.rows import REAL, chunks, texts, write_cells, write_members, write_reals
from gpubspline.files import whole_file
from gpubspline.material.laws import Law
from gpubspline.mesh.mesh import Mesh

EXTENSIONS = (".inp",)
ELEMENT_TYPES = {"quad4": "S4", "quad8": "S8R", "hex8": "C3D8", "hex20": "C3D20"}
"""Abaqus's names; vertices are numbered as VTK's. Both solvers know these, and neither hexes of 27 nor quads of 9."""

TONNE_MM3 = 1e-9
"""Of 1 g/cm3: the unit of mass that goes with mm, N and MPa."""


def write(
    mesh: Mesh,
    path: Path,
    *,
    law: Law | None = None,
    modulus_bins: int | None = None,
    thickness_mm: float = 1.0,
    step: str = "",
) -> None:
    """Write a deck; labels start at 1.

    Arguments
    ---------
    mesh: with the nodal fields ``E_MPa`` and ``nu``, and ``HU``; without them the deck has no material.
    law: the material law to cite.
    modulus_bins: None for the nodal material by temperature, or the number of element sets by modulus, each with a
        material of its own. The error of doing so is stated in the deck.
    thickness_mm: of quads, which are shells.
    step: text that ends the deck, such as ``*STEP`` to ``*END STEP``.

    Raises
    ------
    InputError where the deck cannot hold the elements or the material cannot be tabulated.
    """
    if mesh.element_type not in ELEMENT_TYPES:
        held = ", ".join(ELEMENT_TYPES)
        raise InputError(f"expected elements of {held} for {path.suffix}, got {mesh.element_type}; .vtu holds them")
    has_material = {"E_MPa", "nu"} <= mesh.fields.keys()
    if modulus_bins is not None and not has_material:
        raise InputError("expected the nodal fields E_MPa and nu to gather by modulus, got a mesh without them")
    bins = gather(mesh, modulus_bins) if modulus_bins is not None else None
    table = modulus_table(mesh.fields) if has_material and bins is None else None
    with whole_file(path) as temporary, open(temporary, "w", encoding="ascii", errors="replace", newline="\n") as deck:
        _write_heading(deck, law)
        body = _write_elements(deck, mesh)
        if bins is not None:
            _write_bins(deck, mesh, bins, thickness_mm)
        if table is not None:
            _write_table(deck, mesh, table, body, thickness_mm)
        deck.write(step)


def _write_heading(deck: TextIO, law: Law | None) -> None:
    deck.write("*HEADING\ngpubspline\n")
    _comment(deck, "Units: mm, N, MPa, tonne, tonne/mm3. Coordinates: patient, LPS.")
    if law is not None:
        _comment(deck, f"Material law: {law.name}, {law.title}")
        _comment(deck, law.citation)
        for part in law.unconfirmed:
            _comment(deck, f"Not confirmed from its source: {part}")


def _comment(deck: TextIO, words: str) -> None:
    deck.writelines(f"** {line}\n" for line in textwrap.wrap(words, 100))


def _write_elements(deck: TextIO, mesh: Mesh) -> str:
    """Nodes, elements and sets; returns the name of the set of all elements."""
    deck.write("*NODE, NSET=all_nodes\n")
    write_reals(deck, list(mesh.planes))
    whole = len(mesh.element_sets.get("body", ())) in (0, mesh.n_elements)
    body = "body" if whole else "all_elements"
    deck.write(f"*ELEMENT, TYPE={ELEMENT_TYPES[mesh.element_type]}, ELSET={body}\n")
    for elements in chunks(mesh.n_elements):
        write_cells(deck, mesh.cells_of(np.arange(elements.start, elements.stop)), elements.start + 1)
    for name, members in mesh.node_sets.items():
        _write_set(deck, "NSET", name, members)
    for name, members in mesh.element_sets.items():
        if name != body:
            _write_set(deck, "ELSET", name, members)
    return body


def _write_set(deck: TextIO, keyword: str, name: str, members: NDArray[Any]) -> None:
    deck.write(f"*{keyword}, {keyword}={re.sub(r'[^A-Za-z0-9_]', '_', name)}\n")
    write_members(deck, members)


def _write_section(deck: TextIO, mesh: Mesh, elements: str, material: str, thickness_mm: float) -> None:
    if mesh.element.dimension == 3:
        deck.write(f"*SOLID SECTION, ELSET={elements}, MATERIAL={material}\n")
    else:
        deck.write(f"*SHELL SECTION, ELSET={elements}, MATERIAL={material}\n{thickness_mm:g}\n")


def _write_table(deck: TextIO, mesh: Mesh, table: ModulusTable, elements: str, thickness_mm: float) -> None:
    field = table.carrier
    _comment(
        deck,
        f"Material by node: the temperature is the field {field}, no heat. The table gives each node its modulus and "
        f"Poisson's ratio within {table.error:.1e} of their size; between nodes the solver interpolates {field}. "
        "Give no *EXPANSION and no other *TEMPERATURE.",
    )
    deck.write("*MATERIAL, NAME=bone\n*ELASTIC, TYPE=ISOTROPIC\n")
    at = texts(table.at.astype(mesh.fields[field].dtype))  # as the nodes' own, so that a node lies on its row
    deck.writelines(_lines(at, table.columns["E_MPa"], table.columns["nu"]))
    if "density_g_cm3" in table.columns:
        deck.write("*DENSITY\n")
        deck.writelines(_lines(at, table.columns["density_g_cm3"] * TONNE_MM3))
    _write_section(deck, mesh, elements, "bone", thickness_mm)
    deck.write("*INITIAL CONDITIONS, TYPE=TEMPERATURE\n")
    write_reals(deck, [mesh.fields[field]])


def _write_bins(deck: TextIO, mesh: Mesh, bins: ModulusBins, thickness_mm: float) -> None:
    _comment(
        deck,
        f"Material by element: the mean modulus of its nodes, in {len(bins.members)} bins. Binning changes it "
        f"by {100 * bins.mean_error:.3g} % on average and {100 * bins.largest_error:.3g} % at most, and "
        f"Poisson's ratio by {bins.poisson_error:.3g} at most.",
    )
    for number, members in enumerate(bins.members):
        _write_set(deck, "ELSET", f"modulus_{number + 1}", members)
    for number in range(len(bins.members)):
        deck.write(f"*MATERIAL, NAME=bone_{number + 1}\n*ELASTIC, TYPE=ISOTROPIC\n")
        deck.write(f"{REAL % bins.modulus_mpa[number]},{REAL % bins.poisson[number]}\n")
        if bins.density_g_cm3 is not None and bins.density_g_cm3[number] > 0:
            deck.write("*DENSITY\n")
            deck.write(f"{REAL % (bins.density_g_cm3[number] * TONNE_MM3)}\n")
        _write_section(deck, mesh, f"modulus_{number + 1}", f"bone_{number + 1}", thickness_mm)


def _lines(at: list[str], *columns: NDArray[np.float64]) -> list[str]:
    """Rows of a table along ``at``, which stands last."""
    line = ",".join([REAL] * len(columns)) + ",%s\n"
    return [line % row for row in zip(*(column.tolist() for column in columns), at, strict=True)]
