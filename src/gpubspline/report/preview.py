"""A picture of what of a CT is meshed, before anything is: its outline over three slices, and the histogram of HU.

Where labels or laws are told each label has a colour, and a line of a legend: its volume, HU, law and modulus.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from gpubspline.ct.region import Region
from gpubspline.ct.volume import Volume
from gpubspline.report.page.slices import views
from gpubspline.report.quantity import DISTINCT
from gpubspline.report.sheet import FAINT, INK, check_png, save
from gpubspline.report.tissues import ABOUT, Labelled, Tissue

OUTLINE, LETTERS = "#2fb4ff", "#ffd84d"

INSIDE, OUTSIDE = 0.45, 0.15
"""How much of a label's colour is seen in the body, and apart from it, where it is not meshed."""

WIDE, TALLEST, GAP, BELOW, ABOVE, LINE = 11.0, 6.5, 0.3, 2.8, 0.7, 0.2
"""Inches: of the three slices beside each other and of the tallest, between them, for the histogram, the title and a
line of the legend."""

MOST_LINES = 40
"""Labels that the legend has, the largest."""

COLUMNS = (0.02, 0.2, 0.4, 0.57)
"""Of the legend, as shares of its width."""

LOWEST = 0.9
"""Inches of a slice from which there is room for letters above each other."""

MOST_COUNTED = 4_000_000
"""Voxels that the histogram counts; of larger scans every second, third ..."""

BINS = 200


def write_preview(
    volume: Volume,
    region: Region,
    path: str | Path,
    threshold_hu: float | None = None,
    labelled: Labelled | None = None,
) -> None:
    """Write a PNG of a region's outline over the axial, coronal and sagittal slice that hold most of it.

    Arguments
    ---------
    volume: what the region was found in.
    region: on the grid of ``volume``.
    path: a ``.png``, which appears whole or not at all.
    threshold_hu: where the region is by a threshold: drawn in the histogram of HU.
    labelled: drawn in colours, paler where it lies apart from the region, with a legend.
    """
    path = Path(path)
    check_png(path)
    save(draw_preview(volume, region, threshold_hu, labelled), path)


def draw_preview(
    volume: Volume, region: Region, threshold_hu: float | None = None, labelled: Labelled | None = None
) -> Figure:
    """Draw what ``write_preview`` writes."""
    shown = views(volume.affine)
    planes = [_fullest(region.mask, 2 - view["across"]) for view in shown]
    cuts = [_oriented(volume.hu, view, n) for view, n in zip(shown, planes, strict=True)]
    low, high = np.percentile(np.concatenate([cut.ravel() for cut in cuts]), [0.5, 99.8])
    spacing = np.array(volume.shape) * volume.spacing_mm
    sizes = np.array([(spacing[view["right"]], spacing[view["up"]]) for view in shown])
    sizes *= min(WIDE / sizes[:, 0].sum(), TALLEST / sizes[:, 1].max())  # mm to inches
    legend = 0.0 if labelled is None else LINE * (min(len(labelled.tissues), MOST_LINES) + 1.5)
    width, height = max(sizes[:, 0].sum(), 7.0) + 4 * GAP, sizes[:, 1].max() + BELOW + ABOVE + legend
    figure = Figure(figsize=(width, height), facecolor="white")
    left = GAP
    for view, n, cut, (wide, tall) in zip(shown, planes, cuts, sizes, strict=True):
        axes = figure.add_axes((left / width, 1 - (ABOVE + tall) / height, wide / width, tall / height))
        axes.imshow(cut, cmap="gray", vmin=low, vmax=max(high, low + 1), extent=(0, wide, tall, 0), aspect="auto")
        if labelled is not None:
            axes.imshow(_overlay(labelled, region, view, n), extent=(0, wide, tall, 0), aspect="auto")
        _draw_outline(axes, _oriented(region.distance_mm, view, n), wide, tall)
        _draw_names(axes, view, _caption(volume, view, n), tall > LOWEST)
        left += wide + GAP
    place = (0.9 / width, (0.55 + legend) / height, 1 - 1.3 / width, 1.5 / height)
    _draw_histogram(figure.add_axes(place), volume, region)
    found = "the mask" if threshold_hu is None else f"the largest part from {threshold_hu:.0f} HU on"
    title = f"What is meshed: {found}, {region.volume_mm3:,.0f} mm³"
    figure.text(GAP / width, 1 - 0.25 / height, title, va="top", fontsize=13, color=INK)
    if threshold_hu is not None:
        _draw_threshold(figure.axes[-1], threshold_hu)
    if labelled is not None:
        _draw_legend(figure.add_axes((GAP / width, 0, 1 - 2 * GAP / width, legend / height)), labelled.tissues)
    return figure


def _colour(labelled: Sequence[Tissue], label: int) -> NDArray[np.float64]:
    place = [tissue.label for tissue in labelled].index(label)
    return np.asarray(DISTINCT[place % len(DISTINCT)])


def _overlay(labelled: Labelled, region: Region, view: dict[str, Any], n: int) -> NDArray[np.float64]:
    """Colours (rows, columns, 4) of a slice's labels."""
    numbers, inside = _oriented(labelled.numbers, view, n), _oriented(region.mask, view, n)
    pixels = np.zeros((*numbers.shape, 4))
    for label in np.unique(numbers[numbers != 0]).tolist():
        own = numbers == label
        pixels[own, :3] = _colour(labelled.tissues, label)
        pixels[own, 3] = np.where(inside[own], INSIDE, OUTSIDE)
    return pixels


def _draw_legend(axes: Axes, tissues: Sequence[Tissue]) -> None:
    """Draw a line a label, the largest first where there are too many."""
    order = sorted(tissues, key=lambda tissue: -tissue.mm3)[:MOST_LINES]
    shown = [tissue for tissue in tissues if tissue in order]
    left = len(tissues) - len(shown)
    axes.set_axis_off()
    axes.set_xlim(0, 1)
    axes.set_ylim(len(shown) + 1, -0.5)
    for line, tissue in enumerate(shown):
        if tissue.label:
            swatch = Rectangle((0, line - 0.35), 0.012, 0.7, color=tuple(_colour(tissues, tissue.label)))
            axes.add_patch(swatch)
        for at, words in zip(COLUMNS, tissue.words, strict=True):
            axes.text(at, line, words, va="center", fontsize=8.5, color=INK, clip_on=True)
    about = ABOUT + (f"; {left} smaller labels are not listed" if left else "")
    axes.text(COLUMNS[0], len(shown), about, va="center", fontsize=8, color=FAINT)


def _fullest(mask: NDArray[np.bool_], axis: int) -> int:
    """Slice across an array axis that holds most of the mask."""
    others = tuple(each for each in range(3) if each != axis)
    return int(np.argmax(np.count_nonzero(mask, axis=others)))


def _oriented(values: NDArray[Any], view: dict[str, Any], n: int) -> NDArray[Any]:
    """Slice of (k, j, i) as a picture (rows from the top, columns from the left) as radiology sees it."""
    cut = np.take(values, n, axis=2 - view["across"])
    turned = np.asarray(cut if view["up"] > view["right"] else cut.T)
    return turned[:: -1 if view["flipUp"] else 1, :: -1 if view["flipRight"] else 1]


def _draw_outline(axes: Axes, distance: NDArray[Any], wide: float, tall: float) -> None:
    """Draw the zero level of the distance between the centres of pixels; none where it crosses no slice."""
    rows, columns = distance.shape
    if not distance.min() < 0 < distance.max():
        return
    x, y = (np.arange(columns) + 0.5) * wide / columns, (np.arange(rows) + 0.5) * tall / rows
    axes.contour(x, y, distance, levels=[0.0], colors=[OUTLINE], linewidths=1.2)


def _draw_names(axes: Axes, view: dict[str, Any], caption: str, tall: bool) -> None:
    left, right, top, bottom = view["letters"]
    places = {(0.02, 0.5): left, (0.98, 0.5): right, **({(0.5, 0.98): top, (0.5, 0.02): bottom} if tall else {})}
    for (x, y), letter in places.items():
        sides = {0.02: "left", 0.98: "right"}.get(x, "center"), {0.98: "top", 0.02: "bottom"}.get(y, "center")
        words: dict[str, Any] = {"ha": sides[0], "va": sides[1], "fontsize": 9, "weight": "bold"}
        axes.text(x, y, letter, transform=axes.transAxes, color=LETTERS, **words)
    axes.set_axis_off()
    below: dict[str, Any] = {"xytext": (0, -5), "textcoords": "offset points", "va": "top"}
    axes.annotate(caption, (0, 0), xycoords="axes fraction", fontsize=8.5, color=INK, **below)


def _caption(volume: Volume, view: dict[str, Any], n: int) -> str:
    middle = (np.array(volume.shape) - 1) / 2
    middle[view["across"]] = n
    mm = float(volume.to_points(middle)["xyz".index(view["patient"])])
    return f"{view['name']}, slice {n + 1} of {volume.shape[view['across']]}\n{view['patient']} = {mm:.1f} mm"


def _draw_histogram(axes: Axes, volume: Volume, region: Region) -> None:
    """Draw how many voxels have which HU, of all and of the region."""
    step = volume.hu.size // MOST_COUNTED | 1  # odd, so that columns of even rows come in turn
    all_hu, inside = volume.hu.ravel()[::step], region.mask.ravel()[::step]
    edges = np.histogram_bin_edges(all_hu, BINS, (float(all_hu.min()), max(float(all_hu.max()), all_hu.min() + 1.0)))
    for hu, colour, name in ((all_hu, "#c9ced6", "all voxels"), (all_hu[inside], OUTLINE, "inside the outline")):
        counts = step * np.histogram(hu, edges)[0]
        axes.stairs(np.maximum(counts, 0.5), edges, baseline=0.5, fill=True, color=colour, label=name)
    axes.set_yscale("log")
    axes.set_ylim(bottom=0.5)
    axes.set_xlim(edges[0], edges[-1])
    axes.set_xlabel("HU", fontsize=9, color=INK)
    axes.set_ylabel("voxels", fontsize=9, color=INK)
    axes.legend(fontsize=8, frameon=False, loc="upper right")
    axes.tick_params(labelsize=8, color=FAINT, labelcolor=INK)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def _draw_threshold(axes: Axes, threshold_hu: float) -> None:
    axes.axvline(threshold_hu, color=INK, linewidth=1)
    words: dict[str, Any] = {"xytext": (3, -2), "textcoords": "offset points", "va": "top", "fontsize": 8}
    axes.annotate(f"threshold {threshold_hu:.0f}", (threshold_hu, 1), xycoords=("data", "axes fraction"), **words)
