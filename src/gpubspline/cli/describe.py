"""What the command line says of a volume, a patch, a mesh, a law and a run: lines of text."""

import math
import textwrap
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.cli.describe_material import material_lines
from gpubspline.ct.labels import label_counts
from gpubspline.ct.region import otsu_threshold
from gpubspline.ct.volume import Volume
from gpubspline.material.density import MASS_OF
from gpubspline.mesh.element_size import about_elements, default_size
from gpubspline.mesh.mesh import Mesh
from gpubspline.mesh.quality import Quality
from gpubspline.mesh.validity import Certificate
from gpubspline.recipe import Body
from gpubspline.report.histogram import text_histogram
from gpubspline.report.summary import validity_figures
from gpubspline.spline.fit import FitError
from gpubspline.spline.hyperpatch import Hyperpatch
from gpubspline.surface.surface import Surface

_UNDER = 11 * " "


def volume_lines(volume: Volume) -> list[str]:
    """Size, place and values of a CT volume, and the threshold that would be chosen for it."""
    n = np.array(volume.shape) - 1
    corners = volume.to_points(np.stack(np.meshgrid(*[(0, 1)] * 3), axis=-1).reshape(-1, 3) * n)
    low, high = corners.min(axis=0), corners.max(axis=0)
    directions = volume.affine[:3, :3] / volume.spacing_mm
    lean = np.degrees(np.arcsin(np.clip(np.abs(directions.T @ directions - np.eye(3)).max(), 0, 1)))
    tilt = f", sheared by {lean:.1f} degrees (gantry tilt)" if lean > 0.05 else ""
    return [
        f"source     {volume.source}",
        f"voxels     {_by(volume.shape)} of {_by(volume.spacing_mm, '.4g')} mm{tilt}",
        _extent(low, high) + " LPS",
        f"HU         {_range_of(volume)}",
    ]


def label_lines(volume: Volume, names: Mapping[int, str]) -> list[str]:
    """Voxels and volume of each number of what may be a segmentation, with its name; nothing where it is none."""
    counts = label_counts(volume.hu)
    if not counts:
        return []
    width = len(f"{max(counts.values()):,}")
    sizes = {n: f"{count:{width},} voxels, {count * volume.voxel_mm3:,.0f} mm3" for n, count in counts.items()}
    lines = [f"{n:10} {size}" + (f", {names[n]}" if names.get(n) else "") for n, size in sizes.items()]
    return ["labels     where this is a segmentation, for --mask:", *lines]


def body_lines(body: Body) -> list[str]:
    """What would be meshed: by what it was found, its place and volume, what lies apart, and how fine blocks would be.

    ``body``: of a CT, see ``segment.find_body``.
    """
    region, volume, threshold = body.region, body.volume, body.threshold_hu
    ends = region.outermost_mm
    lines = [_extent(ends.min(axis=0), ends.max(axis=0)) + " LPS", f"volume     {region.volume_mm3:,.0f} mm3"]
    if threshold is not None and volume is not None:
        above = volume.hu >= threshold
        apart = np.count_nonzero(above & ~region.mask) / np.count_nonzero(above)
        lines.append(f"threshold  {threshold:.0f} HU; {apart:.1%} of what is above it lies apart and is left out")
    size = default_size(region)
    return [
        *lines,
        f"blocks     about {about_elements(region, size):,.0f} hexes of {size:.3g} mm, unless told otherwise",
    ]


def _extent(low: NDArray[Any], high: NDArray[Any]) -> str:
    ranges = (f"{axis} {_tenths(a)} to {_tenths(b)}" for axis, a, b in zip("xyz", low, high, strict=True))
    return f"extent     {', '.join(ranges)} mm"


def _tenths(value: float) -> str:
    """A number to a tenth, and 0.0 where that is nothing."""
    return f"{round(float(value), 1) + 0.0:.1f}"


def _range_of(volume: Volume) -> str:
    low, high = volume.hu.min(), volume.hu.max()
    return (
        f"{low:g} everywhere" if low == high else f"{low:g} to {high:g}, Otsu's threshold {otsu_threshold(volume):.0f}"
    )


def surface_lines(surface: Surface) -> list[str]:
    """Triangles, extent and volume of a closed surface."""
    low, high = surface.points.min(axis=0), surface.points.max(axis=0)
    return [
        f"surface    closed, {len(surface.triangles):,} triangles, {len(surface.points):,} points",
        _extent(low, high),
        f"volume     {surface.volume_mm3:,.0f} mm3",
    ]


def patch_lines(patch: Hyperpatch) -> list[str]:
    """Kind, control points and extent of a hyperpatch."""
    kind = {2: "surface", 3: "solid"}[patch.parametric_dimension]
    low, high = patch.control[..., :3].reshape(-1, 3).min(axis=0), patch.control[..., :3].reshape(-1, 3).max(axis=0)
    rational = ", rational" if patch.weights is not None else ""
    return [
        f"patch      B-spline {kind} of {_by(patch.shape)} control points, degree {_by(patch.degrees)}{rational}",
        _extent(low, high) + " LPS",
        "channels   " + ", ".join(patch.channels),
    ]


def fit_lines(error: FitError) -> list[str]:
    """Distance of a patch from its data."""
    return [
        f"fit        off its data by {error.mean_mm:.3g} mm on average, {error.max_mm:.3g} mm at most; "
        f"{error.mean_hu:.3g} HU and {error.max_hu:.3g} HU"
    ]


def mesh_lines(mesh: Mesh) -> list[str]:
    """Elements, extent, fields and sets of a mesh."""
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    lines = [
        f"mesh       {mesh.n_elements:,} {mesh.element_type}, {mesh.n_nodes:,} nodes",
        _extent(low, high),
    ]
    for where, fields in (("nodal", mesh.fields), ("element", mesh.cell_fields)):
        lines += [f"{where:10} {name} {values.min():.6g} to {values.max():.6g}" for name, values in fields.items()]
    if "density_g_cm3" in {**mesh.fields, **mesh.cell_fields}:
        kind = mesh.density_kind
        told = f"{kind} density, {MASS_OF[kind]}" if kind else "not told: apparent, ash and QCT density are not one"
        lines.append(f"density    {told}")
    sets = {**mesh.node_sets, **mesh.element_sets}
    return lines + ([f"sets       {', '.join(sets)}"] if sets else [])


def quality_figures(mesh: Mesh, quality: Quality, certificate: Certificate | None = None) -> dict[str, Any]:
    """Figures of a mesh file's elements, for JSON."""
    head = {"nodes": mesh.n_nodes, "elements": mesh.n_elements, "element_type": mesh.element_type}
    return head | {"scaled_jacobian": quality.to_dict(), **validity_figures(certificate)}


def validity_lines(counts: dict[str, Any] | None) -> list[str]:
    """What is known of the determinants inside hexes, not only at corners."""
    if counts is None:
        return []
    if counts["negative"] == counts["undecided"] == 0:
        return [
            f"inside     every hex certified valid throughout, determinant from {counts['least_ratio']:.3f} of its mean"
        ]
    return [
        f"inside     {counts['certified']:,} hexes certified valid throughout, {counts['negative']:,} invalid at some "
        f"place, {counts['undecided']:,} undecided"
    ]


def optimized_lines(done: dict[str, float] | None) -> list[str]:
    """What moving nodes did to the worst hex, and to the surface."""
    if done is None:
        return []
    return [
        f"optimized  worst element from {done['before']:.3f} to {done['after']:.3f}; the surface stayed within "
        f"{done['boundary_mm']:.2g} mm"
    ]


def method_lines(method: dict[str, str] | None, size_mm: float | None = None) -> list[str]:
    """By which method a mesh was made, and why."""
    if method is None:
        return []
    size = f", elements of {size_mm:.3g} mm" if size_mm is not None else ""
    return [f"method     {method['name']}{size}: {method['why']}"]


def quality_lines(mesh: Mesh, quality: Quality) -> list[str]:
    """Histogram of a mesh's scaled Jacobians and where its worst elements are, numbered from 1."""
    rows = zip(quality.worst, quality.worst_values, quality.worst_centroids_mm, strict=True)
    worst = [f"  element {e + 1}: {v:.4f} at {c[0]:.1f}, {c[1]:.1f}, {c[2]:.1f} mm" for e, v, c in rows]
    return [f"{mesh.n_elements:,} {mesh.element_type}", text_histogram(quality), "worst elements", *worst]


def kind(counted: Any) -> str:
    """Number and type of the elements of a mesh or its tally."""
    return f"{counted.n_elements:,} {counted.element_type}"


def deck_lines(figures: dict[str, Any]) -> list[str]:
    """Units, means of the modulus and load case of what was written, where it has any; see ``export.write``."""
    deck = figures.get("deck") or {}
    modulus, load = deck.get("modulus"), deck.get("load")
    if not load and (not modulus or modulus["means"].startswith("field")):
        return []
    lines = [f"deck       {deck['format']}, {deck['units']}"]
    if modulus and modulus["means"] == "bins":
        lines.append(
            f"{_UNDER}modulus in {modulus['bins']} bins, off by {modulus['mean_error']:.2%} on average, "
            f"{modulus['largest_error']:.2%} at most; Poisson's ratio by {modulus['poisson_error']:.2g}"
        )
    elif modulus and "rows" in modulus:
        lines.append(
            f"{_UNDER}modulus by node, a table of {modulus['rows']} rows along {modulus['carrier']}, within "
            f"{modulus['error']:.2%} of each node's"
        )
        if modulus["share_off"]:
            lines += [
                f"{_UNDER}the law gives {modulus['share_off']:.0%} of the nodes a modulus that it gives twice: their",
                f"{_UNDER}Poisson's ratio is a mean (off by up to {modulus['poisson_error']:.2g}) and so is their "
                f"density (mass in all off by {modulus['density_total_error']:.1%})",
            ]
    elif modulus:
        lines.append(f"{_UNDER}modulus by {modulus['means'].removeprefix('field by ')}")
    if load:
        total = _vector(load["total_n"])
        lines.append(f"load       {load['title']}: {total} N in all, {load['held_nodes']:,} nodes held")
    return lines


def wrote(paths: list[Path]) -> list[str]:
    """What was written, if anything."""
    return ["wrote      " + ", ".join(str(path) for path in paths)] if paths else []


def summary_lines(figures: dict[str, Any]) -> list[str]:
    """The figures of a run that a person wants first."""
    quality = figures["scaled_jacobian"]
    lines = [
        f"mesh       {figures['elements']:,} {figures['element_type']}, {figures['nodes']:,} nodes",
        *method_lines(figures["method"], figures["size_mm"]),
        f"quality    scaled Jacobian from {quality['min']:.3f}, mean {quality['mean']:.3f}; "
        f"{quality['fraction_above_0.5']:.1%} above 0.5, {quality['fraction_below_0.1']:.1%} below 0.1, "
        f"{quality['inverted']} inverted",
        *optimized_lines(figures.get("optimized")),
        *validity_lines(figures.get("jacobian_determinant")),
    ]
    size, distance = figures["volume_mm3"], figures["surface_distance_mm"]
    if size["mesh"] is not None:
        of_region = "" if size["region"] is None else f", region {size['region']:,.0f} mm3"
        lines.append(f"volume     mesh {size['mesh']:,.0f} mm3{of_region}")
    if distance is not None:
        lines.append(
            f"surface    {distance['mean']:.2f} mm from the region's on average, 95 % within {distance['p95']:.2f}, "
            f"at most {distance['max']:.2f} mm"
        )
    back = figures["region_distance_mm"]
    if back is not None:
        lines.append(
            f"           the region's {back['mean']:.2f} mm from it on average, 95 % within {back['p95']:.2f}, at most "
            f"{back['max']:.2f} mm"
        )
    if figures["threshold_hu"] is not None:
        lines.append(f"threshold  {figures['threshold_hu']:.0f} HU")
    lines += material_lines(figures)
    return [*lines, f"ran on     {figures['backend']}, {figures['device']}, {figures['seconds']['total']:.1f} s"]


def response_lines(figures: dict[str, Any]) -> list[str]:
    """What a load case did to a mesh: where it acts, the solve, displacement, stress and what its maximum is."""
    case = figures["load_case"]
    lines = [
        f"mesh       {figures['elements']:,} {figures['element_type']}, {figures['nodes']:,} nodes",
        f"load       {case['name']}" + (f": {case['title']}" if case["title"] else ""),
    ]
    for part in figures["regions"]:
        at = ", ".join(map(_tenths, part["centre_mm"]))
        what = "fixed" if part["kind"] == "fixed" else f"{part['kind']} {_vector(part['force_n'])} N"
        area = f"{part['area_mm2']:,.0f} mm2" if part["area_mm2"] else f"{part['nodes']:,} nodes"
        lines.append(f"{_UNDER}{part['region']}: {what} on {area} about {at} mm")
    at = ", ".join(map(_tenths, figures["max_von_mises_at_mm"]))
    return [
        *lines,
        f"solved     {figures['unknowns']:,} unknowns in {figures['iterations']:,} iterations, "
        f"residual {figures['residual']:.1e}",
        f"balance    applied {_vector(figures['applied_n'])} N, reaction {_vector(figures['reaction_n'])} N",
        f"moved      at most {figures['max_displacement_mm']:.4g} mm; strain energy "
        f"{figures['strain_energy_nmm']:.5g} N mm",
        f"stress     von Mises at most {figures['max_von_mises_mpa']:.5g} MPa, at {at} mm;",
        f"{_UNDER}{figures['p99_von_mises_mpa']:.5g} MPa is not exceeded by 99 % of the volume, at points, next to "
        "supports and forces too",
        *textwrap.wrap(
            f"at most: the {figures['max_von_mises_is']}", 108, initial_indent=_UNDER, subsequent_indent=_UNDER
        ),
        f"ran on     {figures['backend']}, {figures['device']}, {figures['seconds']['total']:.1f} s",
    ]


def _vector(values: list[float]) -> str:
    greatest = max(map(abs, values))
    digits = max(2, 4 - math.floor(math.log10(greatest))) if greatest else 2  # small forces are not nothing
    return "(" + ", ".join(f"{round(value, digits) + 0.0:.6g}" for value in values) + ")"


def _by(values: Any, form: str = "") -> str:
    return " x ".join(format(value, form) for value in values)
