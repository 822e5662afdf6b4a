"""The laws side by side: modulus against HU, and what each makes of a model, as one picture."""

from collections.abc import Sequence
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from gpubspline.analysis.law_comparison import LawOutcome
from gpubspline.material.laws import Law
from gpubspline.report.sheet import FAINT, INK, check_png, save

STROKES = ("-", "--", ":", "-.")


def write_law_comparison(outcomes: Sequence[LawOutcome], hu: NDArray[np.floating], path: str | Path) -> None:
    """Write a PNG of the laws of some outcomes.

    Arguments
    ---------
    outcomes: from ``compare_laws``.
    hu: (n,) of the model's nodes, whose distribution stands behind the curves.
    path: a ``.png``, which appears whole or not at all.

    Raises
    ------
    InputError where the file cannot be written as PNG.
    """
    path = Path(path)
    check_png(path)
    figure = Figure(figsize=(12.4, 6.2), facecolor="white")
    curves = figure.add_axes((0.06, 0.11, 0.43, 0.74))
    bars = figure.add_axes((0.72, 0.11, 0.26, 0.74))
    ordered = sorted(outcomes, key=lambda each: each.stiffness_n_mm or each.mean_modulus_mpa)
    colours = matplotlib.colormaps["turbo"](np.linspace(0.05, 0.95, len(ordered)))
    _draw_curves(curves, ordered, colours, hu)
    _draw_bars(bars, ordered, colours)
    figure.text(0.06, 0.95, "Material laws, side by side", ha="left", va="top", fontsize=13, color=INK)
    figure.text(0.06, 0.905, _spread(ordered), ha="left", va="top", fontsize=10, color=FAINT)
    save(figure, path)


def modulus_curve(law: Law, n: int = 200) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """HU and modulus, MPa, along a law, a gap (NaN) between its pieces where it jumps."""
    hu, modulus = [], []
    for piece in law.pieces:
        at = np.linspace(piece.lower_hu, piece.upper_hu, n)
        hu += [*at, at[-1]]
        modulus += [*(piece.modulus_mpa(law.density.density_g_cm3(value)) for value in at), np.nan]
    return np.array(hu), np.array(modulus)


def _draw_curves(
    axes: Axes, ordered: Sequence[LawOutcome], colours: NDArray[np.floating], hu: NDArray[np.floating]
) -> None:
    for number, (outcome, colour) in enumerate(zip(ordered, colours, strict=True)):
        axes.plot(*modulus_curve(outcome.law), color=colour, linestyle=STROKES[number % len(STROKES)], linewidth=1.6)
    axes.set_yscale("log")
    axes.set_ylim(5, 100_000)
    axes.set_xlim(-200, 2050)
    axes.set_xlabel("HU", color=INK)
    axes.set_ylabel("Young's modulus (MPa)", color=INK)
    behind = axes.twinx()
    behind.hist(np.clip(hu, -200, 2050), bins=90, range=(-200, 2050), color="#dfe3ea")
    behind.set_yticks([])
    behind.set_zorder(axes.get_zorder() - 1)
    axes.patch.set_visible(False)
    for each in (axes, behind):
        for side in ("top", "right"):
            each.spines[side].set_visible(False)
    axes.tick_params(color=FAINT, labelcolor=INK, labelsize=9)
    axes.grid(color="#eceef2", linewidth=0.7)
    axes.set_title("grey: HU of the model's nodes", loc="right", fontsize=8, color=FAINT)


def _draw_bars(axes: Axes, ordered: Sequence[LawOutcome], colours: NDArray[np.floating]) -> None:
    solved = ordered[0].stiffness_n_mm is not None
    values = [each.stiffness_n_mm or each.mean_modulus_mpa for each in ordered]
    places = list(range(len(ordered)))
    axes.barh(places, values, 0.68, color=colours, edgecolor=INK, linewidth=0.4)
    for place, value, each in zip(places, values, ordered, strict=True):
        mean = f"{value:,.0f}" + (f"   (E {each.mean_modulus_mpa:,.0f})" if solved else "")
        axes.text(value, place, f" {mean}", va="center", fontsize=8, color=INK)
    names = [each.law.name + (" *" if each.law.all_unconfirmed else "") for each in ordered]
    axes.set_yticks(places, names, fontsize=8.5)
    axes.set_xlim(0, 1.5 * max(values))
    axes.locator_params(axis="x", nbins=4)
    what = "stiffness along the long axis (N/mm), mean E (MPa)" if solved else "mean modulus over the volume (MPa)"
    axes.set_xlabel(what + "\n* something of it is unconfirmed", color=INK, fontsize=9)
    axes.tick_params(color=FAINT, labelcolor=INK, labelsize=8.5)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def _spread(ordered: Sequence[LawOutcome]) -> str:
    means = [each.mean_modulus_mpa for each in ordered]
    least, most = min(means), max(means)
    text = f"mean modulus over the volume {least:,.0f} to {most:,.0f} MPa, {most / least:.1f} times"
    stiff = [each.stiffness_n_mm for each in ordered if each.stiffness_n_mm is not None]
    if stiff:
        text += f"   ·   stiffness {min(stiff):,.0f} to {max(stiff):,.0f} N/mm, {max(stiff) / min(stiff):.1f} times"
    return text
