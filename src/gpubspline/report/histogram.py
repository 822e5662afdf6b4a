"""The distribution of scaled Jacobians, as a picture and as text."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gpubspline.mesh.quality import Quality
from gpubspline.report.quantity import QUANTITIES
from gpubspline.report.sheet import FAINT, INK, check_png, save

BAR_CHARACTERS = 40
ALARM = "#b3261e"


def write_histogram(quality: Quality, path: str | Path, title: str | None = None) -> None:
    """Write a PNG of the scaled Jacobians in ten bins: percent of the elements, and counts above the bars.

    Arguments
    ---------
    quality: from ``mesh.quality``.
    path: a ``.png``, which appears whole or not at all.
    title: the number of elements unless told.

    Raises
    ------
    InputError where the file cannot be written as PNG.

    Source: the form of Figs. 6 to 9 of the paper.
    """
    path = Path(path)
    check_png(path)
    save(draw_histogram(quality, title), path)


def draw_histogram(quality: Quality, title: str | None = None) -> Figure:
    """Draw what ``write_histogram`` writes."""
    figure = Figure(figsize=(7.2, 4.6), facecolor="white")
    axes = figure.add_axes((0.1, 0.13, 0.87, 0.68))
    _draw_bars(axes, quality)
    heading = title if title is not None else f"Mesh quality · {quality.n_elements:,} elements"
    figure.text(0.1, 0.955, heading, ha="left", va="top", fontsize=13, color=INK)
    figure.text(0.1, 0.885, _figures(quality), ha="left", va="top", fontsize=10, color=FAINT)
    if quality.inverted:
        figure.text(0.97, 0.955, _inverted(quality), ha="right", va="top", fontsize=11, color=ALARM, weight="bold")
    return figure


def _draw_bars(axes: Axes, quality: Quality) -> None:
    percent = 100 * quality.counts / quality.n_elements
    middles, width = (quality.edges[:-1] + quality.edges[1:]) / 2, np.diff(quality.edges)
    scale, _ = QUANTITIES["scaled_jacobian"].scale(quality.edges)
    axes.bar(middles, percent, 0.9 * width, color=scale.to_rgba(middles), edgecolor=INK, linewidth=0.5)
    top = max(float(percent.max()), 1.0)
    for middle, height, count in zip(middles, percent, quality.counts, strict=True):
        axes.text(middle, height + 0.012 * top, f"{count:,}", ha="center", va="bottom", fontsize=8.5, color=INK)
    axes.set_xlim(quality.edges[0], quality.edges[-1])
    axes.set_ylim(0, 1.1 * top)
    axes.set_xticks(quality.edges)
    axes.set_xlabel("scaled Jacobian", color=INK)
    axes.set_ylabel("elements (%)", color=INK)
    axes.tick_params(color=FAINT, labelcolor=INK, labelsize=9)
    axes.grid(axis="y", color="#e4e6ea", linewidth=0.8)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def _figures(quality: Quality) -> str:
    parts = (
        f"minimum {quality.min:.3f}",
        f"mean {quality.mean:.3f}",
        f"above 0.5: {_percent(quality.fraction_above_0_5)}",
        f"below 0.1: {_percent(quality.fraction_below_0_1)}",
    )
    return "   ·   ".join(parts)


def _percent(fraction: float) -> str:
    """Percent with one digit, which never rounds to all or to none."""
    if 0 < fraction < 0.001:
        return "< 0.1 %"
    if 0.999 < fraction < 1:
        return "> 99.9 %"
    return f"{100 * fraction:.1f} %"


def _inverted(quality: Quality) -> str:
    return f"{quality.inverted:,} inverted"


def text_histogram(quality: Quality) -> str:
    """Draw the histogram in characters: one line per bin with its count and percent, then the figures."""
    width = len(f"{quality.counts.max():,}")
    most = max(int(quality.counts.max()), 1)
    lines = []
    for low, high, count in zip(quality.edges[:-1], quality.edges[1:], quality.counts, strict=True):
        bar = "█" * (-(-BAR_CHARACTERS * int(count) // most))  # rounded up: one element is seen
        share = f"{100 * count / quality.n_elements:5.1f} %"
        lines.append(f"{low:.1f} to {high:.1f}  {count:>{width},}  {share}  {bar}".rstrip())
    if quality.inverted:
        lines.append(f"{_inverted(quality)} (scaled Jacobian 0 or less)")
    return "\n".join([*lines, _figures(quality)])
