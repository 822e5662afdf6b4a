"""The table of formats against what they keep, made of what readers found."""

import importlib
import tempfile
from pathlib import Path
from typing import Any

from foreign import Found
from foreign.models import all_loads, femur
from gpubspline.export import formats, write

READERS = {
    "abaqus": "Abaqus, CalculiX",
    "febio": "FEBio 4",
    "ansys": "ANSYS Mechanical APDL",
    "nastran": "Nastran",
    "lsdyna": "LS-DYNA",
    "exodus": "Exodus II",
    "med": "MED (SALOME, Code_Aster)",
    "gmsh": "Gmsh 4.1",
    "vtu": "VTK unstructured",
    "vts": "VTK structured",
    "vtkhdf": "VTK in HDF5",
    "xdmf": "XDMF 3",
}
"""Formats of the table and what they are called there; the others hold a surface or a mesh."""

COLUMNS = (
    *("format", "", "elements", "sets", "surfaces", "modulus", "nu, density"),
    *("supports", "forces", "pressure", "gravity", "read by"),
)

MODULES = {name: "vtk" for name in ("vtu", "vts", "vtkhdf", "xdmf")}


def read(name: str, path: Path) -> Found:
    """Read a file by the reader of its format."""
    found: Found = importlib.import_module(f"foreign.{MODULES.get(name, name)}").read(path)
    return found


def page() -> str:
    """The text of the page; each reader must be installed."""
    lines = [f"| {' | '.join(COLUMNS)} |", "|---" * len(COLUMNS) + "|"]
    with tempfile.TemporaryDirectory() as folder:
        lines += [_row(name, title, Path(folder)) for name, title in READERS.items()]
    return TEXT.replace("TABLE", "\n".join(lines))


def _row(name: str, title: str, folder: Path) -> str:
    form = formats()[name]
    path = folder / f"deck{form.extensions[0]}"
    write(femur(), path, load=all_loads())
    by_default = read(name, path)
    binned = None
    if form.binned:
        write(femur(), path, modulus_bins=9)
        binned = read(name, path)
    extensions = " ".join(f"`{extension}`" for extension in form.extensions)
    solved = by_default.internal is not None
    cells = [
        title,
        extensions,
        ", ".join(kind for kind in form.element_types),
        " and ".join(
            kind for kind, sets in (("node", by_default.node_sets), ("element", by_default.element_sets)) if sets
        ),
        _yes(by_default.surfaces or solved),
        _modulus(by_default, binned, solved),
        _yes((by_default.poisson is not None and by_default.density is not None) or solved),
        _yes(by_default.fixed is not None or solved),
        _yes((by_default.forces is not None and by_default.forces.any()) or solved),
        "card" if by_default.pressed or solved else "nodal forces",
        "card" if by_default.gravity is not None or solved else "nodal forces",
        by_default.reader,
    ]
    return f"| {' | '.join(cells)} |"


def _yes(kept: Any) -> str:
    return "yes" if kept else "-"


def _modulus(by_default: Found, binned: Found | None, solved: bool) -> str:
    if solved:
        return "node, bins"
    means, given = [], by_default.modulus
    if given is not None and (given.ndim == 2 or len(given) != len(by_default.cells)):
        means.append("node")
    if binned is not None and binned.modulus is not None and binned.modulus.ndim == 1:
        means.append("bins")
    return ", ".join(means) or "-"


TEXT = Path(__file__).with_name("formats.md").read_text(encoding="utf-8")
