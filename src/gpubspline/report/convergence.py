"""The graph of a convergence study."""

from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gpubspline.analysis.convergence import Convergence
from gpubspline.report.sheet import FAINT, INK, check_png, save

LINES = {
    "max_von_mises_mpa": ("maximum von Mises stress", "#1f5fa8", "o", 2.2),
    "p99_von_mises_mpa": ("99th percentile of it", "#8a5fb0", "s", 1.2),
    "max_displacement_mm": ("greatest displacement", "#2c8a6b", "^", 1.2),
    "strain_energy_nmm": ("strain energy", "#c77d1e", "D", 1.2),
}
"""Name, colour, mark and width of each line."""


def write_convergence(found: Convergence, path: str | Path, title: str | None = None) -> None:
    """Write a PNG of the changes against the finest mesh, %, over the number of elements.

    Arguments
    ---------
    found: from ``converge``.
    path: a ``.png``, which appears whole or not at all.
    title: the load case's and the number of models unless told.

    Raises
    ------
    InputError where the file cannot be written as PNG.

    Source: the form of Fig. 13 of the paper, with what else is followed beside the stress.
    """
    path = Path(path)
    check_png(path)
    figure = Figure(figsize=(7.8, 4.9), facecolor="white")
    axes = figure.add_axes((0.1, 0.13, 0.87, 0.68))
    _draw(axes, found)
    first, last = found.models[0], found.models[-1]
    case = first["load_case"]["title"] or first["load_case"]["name"]
    heading = title if title is not None else f"{case} · {len(found.models)} meshes"
    figure.text(0.1, 0.965, heading, ha="left", va="top", fontsize=13, color=INK)
    words = (
        f"{first['elements']:,} to {last['elements']:,} {last['element_type']}   ·   finest: "
        f"{last['max_von_mises_mpa']:.4g} MPa, {last['max_displacement_mm']:.4g} mm   ·   "
        f"last step of the stress {100 * found.last_change:.2f} %"
    )
    figure.text(0.1, 0.895, words, ha="left", va="top", fontsize=10, color=FAINT)
    save(figure, path)


def _draw(axes: Axes, found: Convergence) -> None:
    elements = [model["elements"] for model in found.models]
    axes.axhline(0, color=FAINT, linewidth=0.8)
    for name, (label, colour, mark, width) in reversed(LINES.items()):
        percent = [100 * change for change in found.changes[name]]
        axes.plot(elements, percent, color=colour, marker=mark, markersize=5, linewidth=width, label=label)
    axes.set_xlabel("elements", color=INK)
    axes.set_ylabel("change against the finest mesh (%)", color=INK)
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:,.0f}")
    axes.set_xlim(left=0)
    axes.tick_params(color=FAINT, labelcolor=INK, labelsize=9)
    axes.grid(color="#e4e6ea", linewidth=0.8)
    axes.set_axisbelow(True)
    handles, labels = axes.get_legend_handles_labels()
    axes.legend(handles[::-1], labels[::-1], frameon=False, fontsize=9, labelcolor=INK)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
