"""Readers that nobody here wrote, one file for each format, all giving the same plain data.

``python -m foreign docs/formats.md`` (with ``tests`` on the path) writes the page with the table.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Faces = set[frozenset[int]]


@dataclass
class Found:
    """What a reader found; None where the format has no place for it or the reader does not look there.

    Attributes
    ----------
    reader: whose it is.
    points: (n, 3).
    cells: (m, k) node numbers from 0, in VTK's order, by label.
    node_sets, element_sets: numbers from 0 by name.
    surfaces: corner nodes of the faces by name.
    modulus, poisson, density: (n,) by node, (m,) by element, or (m, k) by element and vertex.
    fixed, prescribed, forces: (n, 3).
    pressed: faces, and the pressure on them.
    gravity: (3,) acceleration.
    fields, cell_fields: by name.
    comment: what the file says of its units.
    internal: (n, 3) forces that a solver found inside the body, which are the loads where nothing is held.
    """

    reader: str
    points: NDArray[Any]
    cells: NDArray[Any]
    node_sets: dict[str, NDArray[Any]] | None = None
    element_sets: dict[str, NDArray[Any]] | None = None
    surfaces: dict[str, Faces] | None = None
    modulus: NDArray[Any] | None = None
    poisson: NDArray[Any] | None = None
    density: NDArray[Any] | None = None
    fixed: NDArray[Any] | None = None
    prescribed: NDArray[Any] | None = None
    forces: NDArray[Any] | None = None
    pressed: list[tuple[Faces, float]] | None = None
    gravity: NDArray[Any] | None = None
    fields: dict[str, NDArray[Any]] = field(default_factory=dict)
    cell_fields: dict[str, NDArray[Any]] = field(default_factory=dict)
    comment: str = ""
    internal: NDArray[Any] | None = None


def faces(nodes: Any) -> Faces:
    """Corner nodes (f, 4 or more), from 0, as sets."""
    return {frozenset(row) for row in np.asarray(nodes)[:, :4].tolist()}


def load_fields(found: dict[str, NDArray[Any]], length: str = "mm") -> dict[str, Any]:
    """Supports and forces of formats that hold them as nodal fields, as keywords of ``Found``."""
    if "force_n_x" not in found:
        return {}
    zero = np.zeros_like(found["force_n_x"])
    columns = {
        "fixed": [found[f"support_{axis}"] > 0 for axis in "xyz"],
        "prescribed": [found.get(f"prescribed_{length}_{axis}", zero) for axis in "xyz"],
        "forces": [found[f"force_n_{axis}"] for axis in "xyz"],
    }
    return {name: np.stack(each, axis=1) for name, each in columns.items()}


def materials(nodal: dict[str, NDArray[Any]], elemental: dict[str, NDArray[Any]]) -> dict[str, Any]:
    """Material of formats that hold it as fields: of the sections, or of the nodes."""
    if "section_E_MPa" in elemental:
        names = ("section_E_MPa", "section_nu", "section_density_tonne_mm3")
        return dict(zip(("modulus", "poisson", "density"), (elemental[name] for name in names), strict=True))
    if "E_MPa" in nodal:
        return {"modulus": nodal["E_MPa"], "poisson": nodal["nu"], "density": nodal["density_apparent_g_cm3"] * 1e-9}
    return {}
