"""The mesh as a page holds it: faces, and the fields at their corners and of their elements."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.colors import LogNorm, to_hex
from numpy.typing import NDArray

from gpubspline.errors import InputError
from gpubspline.mesh.mesh import Mesh
from gpubspline.mesh.quality import Quality
from gpubspline.report.page.faces import KEPT_BELOW, Cut, Faces, centroids, side_faces, surface_and_cuts
from gpubspline.report.page.pack import LEVELS, pack, quantise
from gpubspline.report.quantity import quantity

Integers = NDArray[Any]

NODAL = ("von_mises_mpa", "HU", "E_MPa", "displacement_mm", "density_g_cm3")
"""Nodal fields that a page shows, where the mesh has them, the first at once; ``displacement_mm`` is its length."""

ELEMENTAL = ("scaled_jacobian", "E_MPa", "density_g_cm3")
"""Element fields that a page shows; some mappings of the material give an element one modulus."""

COLOURS = 32
"""Steps of a colour map on the page, between which it interpolates."""


@dataclass(frozen=True, eq=False)
class _Scene:
    """Faces of the surface, then of the cuts, then of the worst elements, in one list."""

    faces: Faces
    surface: int
    cuts: list[tuple[int, float, int, int]]
    worst: list[tuple[int, int]]
    note: str


def nodal_fields(mesh: Mesh) -> dict[str, NDArray[Any]]:
    """Nodal fields (n,) that a page shows, by name."""
    known = dict(mesh.fields)
    moved = [known.get(f"displacement_mm_{axis}") for axis in "xyz"]
    if "displacement_mm" not in known and all(part is not None for part in moved):
        known["displacement_mm"] = np.linalg.norm(np.stack([np.asarray(part) for part in moved]), axis=0)
    return {name: known[name] for name in NODAL if name in known and np.isfinite(known[name]).any()}


def scene(mesh: Mesh, quality: Quality | None) -> dict[str, Any]:
    """Describe a mesh for ``page.js``.

    Raises
    ------
    InputError where the mesh has none of the fields that a page shows.
    """
    nodal = nodal_fields(mesh)
    elemental = {name: mesh.cell_fields[name] for name in ELEMENTAL if name in mesh.cell_fields and name not in nodal}
    if not nodal and not elemental:
        wanted, got = ", ".join([*NODAL, *ELEMENTAL]), ", ".join([*mesh.fields, *mesh.cell_fields]) or "none"
        raise InputError(f"expected a mesh with fields to report on ({wanted}), got {got}")
    whole = quality is None or quality.n_elements == mesh.n_elements
    shown = _collect(mesh, quality if whole else None)
    used, corners = np.unique(shown.faces.nodes, return_inverse=True)
    placed = [quantise(mesh.points[used, axis]) for axis in range(3)]
    middle = [_steps(centroids(mesh)[shown.faces.owners[: shown.surface], a], *placed[a][1:]) for a in range(3)]
    fields = [_field(name, values, values[used], "node") for name, values in nodal.items()]
    fields += [_field(name, values, values[shown.faces.owners], "face") for name, values in elemental.items()]
    return {
        "low": [low for _, low, _ in placed],
        "high": [high for _, _, high in placed],
        "points": [pack(steps) for steps, _, _ in placed],
        "middle": [pack(steps) for steps in middle],
        "faces": pack(corners.reshape(-1, 4).astype(np.uint32).T),
        "owners": pack(shown.faces.owners.astype(np.uint32)),
        "nodes": pack(used.astype(np.uint32)),
        "fields": fields,
        "surface": shown.surface,
        "cuts": [dict(zip(("axis", "at", "first", "last"), cut, strict=True)) for cut in shown.cuts],
        "keptBelow": KEPT_BELOW,
        "worst": shown.worst,
        "flat": mesh.element.dimension == 2,
        "outline": pack(_outline(mesh, used)) if mesh.element.dimension == 2 else None,
        "note": shown.note if whole else f"Written in slabs: a coarser one of {mesh.n_elements:,} elements is shown.",
    }


def _collect(mesh: Mesh, quality: Quality | None) -> _Scene:
    surface, cuts, note = surface_and_cuts(mesh)
    parts, first, placed = [surface], len(surface.owners), []
    for cut in cuts:
        placed.append(_place(cut, first))
        parts.append(cut.faces)
        first += len(cut.faces.owners)
    worst = []
    for element in [] if quality is None else quality.worst.tolist():
        parts.append(_element_faces(mesh, element))
        worst.append((first, first + len(parts[-1].owners)))
        first = worst[-1][1]
    faces = Faces(np.concatenate([p.nodes for p in parts]), np.concatenate([p.owners for p in parts]))
    return _Scene(faces, len(surface.owners), placed, worst, note)


def _place(cut: Cut, first: int) -> tuple[int, float, int, int]:
    return cut.axis, cut.at_mm, first, first + len(cut.faces.owners)


def _element_faces(mesh: Mesh, element: int) -> Faces:
    if mesh.element.dimension == 2:
        return Faces(mesh.cells_of(np.array([element]))[:, :4], np.array([element]))
    owners = np.full(6, element)
    return Faces(side_faces(mesh, owners, np.arange(6)), owners)


def _outline(mesh: Mesh, used: Integers) -> Integers:
    """Ends of the outer edges of a quad mesh, as places in ``used``: (2, e) uint32."""
    return np.asarray(np.searchsorted(used, mesh.boundary()[:, :2]).astype(np.uint32).T)


def _steps(values: NDArray[Any], low: float, high: float) -> NDArray[np.uint16]:
    return np.clip(np.round((values - low) * (LEVELS / (high - low))), 0, LEVELS).astype(np.uint16)


def _field(name: str, whole: NDArray[Any], shown: NDArray[Any], where: str) -> dict[str, Any]:
    """Describe one field: how it is quantised, and how its quantity is coloured."""
    look = quantity(name)
    known = np.asarray(whole)[np.isfinite(whole)]  # a mesh of somebody else may have gaps
    mapping, _ = look.scale(known)
    positive = bool(known.min() > 0)
    steps, low, high = quantise(shown, logarithmic=look.logarithmic and positive)
    bar = mapping.get_clim()
    colours = [to_hex(colour) for colour in mapping.get_cmap()(np.linspace(0, 1, COLOURS))]
    return {
        "name": name,
        "label": " ".join(look.label.split()),
        "where": where,
        "log": look.logarithmic and positive,
        "low": low,
        "high": high,
        "bar": [float(end) for end in bar],
        "barLog": isinstance(mapping.norm, LogNorm),
        "colours": colours,
        "values": pack(steps),
    }
