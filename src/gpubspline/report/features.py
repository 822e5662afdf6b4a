"""A picture of where a region is thin, and of what a mesh leaves out of it."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from gpubspline.ct.region import Region
from gpubspline.mesh.coverage import surface_places
from gpubspline.mesh.element_size import ACROSS
from gpubspline.mesh.thickness import measure_thickness
from gpubspline.report.sheet import FAINT, INK, check_png, save

VIEWS = (("from the front", 0, 2, "x", "z"), ("from the left", 1, 2, "y", "z"), ("from below", 0, 1, "x", "y"))
LISTED = 12
"""Lost features that are numbered and listed, farthest out first."""

THIN, LOST = "#d95f02", "#c1121f"
MOST_DOTS = 6000


def write_features(region: Region, figures: dict[str, Any], path: str | Path) -> None:
    """Write a PNG of a region seen along the patient's axes: its surface, where it is thin, and what the mesh lost.

    Arguments
    ---------
    region: what was meshed.
    figures: of the run's summary: ``lost_features`` and, where there is one, the element size ``size_mm``.
    path: a ``.png``, which appears whole or not at all.
    """
    path = Path(path)
    check_png(path)
    save(draw_features(region, figures), path)


def draw_features(region: Region, figures: dict[str, Any]) -> Figure:
    """Draw what ``write_features`` writes."""
    lost = (figures.get("lost_features") or [])[:LISTED]
    size = figures.get("size_mm")
    outline = _some(surface_places(region)[0])
    thick = measure_thickness(region)
    limit = thick.least() if size is None else ACROSS * size
    thin = _some(thick.places_mm[thick.thickness_mm < limit])
    figure = Figure(figsize=(12.6, 5.6 + 0.2 * len(lost)), facecolor="white")
    below = (0.7 + 0.2 * len(lost)) / figure.get_size_inches()[1]
    for number, view in enumerate(VIEWS):
        axes = figure.add_axes((0.05 + 0.32 * number, below + 0.08, 0.26, 0.82 - below))
        _draw_view(axes, view, outline, thin, lost)
    unit = f"2 elements of {size:.3g} mm" if size is not None else f"{limit:.3g} mm"
    text = [f"orange: the middle of what is thinner than {unit}; red: left out by the mesh, farthest first"]
    text += [_line(number, feature) for number, feature in enumerate(lost, 1)] or ["nothing is left out"]
    figure.text(0.05, 0.03, "\n".join(text), fontsize=9, color=INK, va="bottom", linespacing=1.25)
    return figure


def _draw_view(axes: Axes, view: tuple[str, int, int, str, str], outline: Any, thin: Any, lost: list[Any]) -> None:
    title, across, up, name_across, name_up = view
    axes.scatter(outline[:, across], outline[:, up], s=1, color="#c9ced6", linewidths=0, rasterized=True)
    axes.scatter(thin[:, across], thin[:, up], s=4, color=THIN, linewidths=0)
    for number, feature in enumerate(lost, 1):
        place = feature["place_mm"]
        axes.scatter([place[across]], [place[up]], s=70, facecolors="none", edgecolors=LOST, linewidths=1.4)
        axes.annotate(str(number), (place[across], place[up]), xytext=(6, 4), textcoords="offset points", color=LOST)
    axes.set_aspect("equal")
    axes.set_title(title, fontsize=10, color=INK)
    axes.set_xlabel(f"{name_across}, mm (LPS)", fontsize=8, color=FAINT)
    axes.set_ylabel(f"{name_up}, mm", fontsize=8, color=FAINT)
    axes.tick_params(labelsize=8, colors=FAINT)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def _line(number: int, feature: dict[str, Any]) -> str:
    x, y, z = feature["place_mm"]
    thick = f", {feature['thickness_mm']:.3g} mm thick" if "thickness_mm" in feature else ""
    return f"{number}  at ({x:.1f}, {y:.1f}, {z:.1f}) mm, up to {feature['out_mm']:.1f} mm outside the mesh{thick}"


def _some(places: NDArray[np.float64]) -> NDArray[np.float64]:
    return places[:: max(1, len(places) // MOST_DOTS)]
