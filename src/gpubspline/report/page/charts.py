"""The charts of a report: scaled Jacobians beside the paper's, distributions of HU and E, E against HU, curves."""

from collections.abc import Sequence
from html import escape
from typing import Any

import numpy as np
from matplotlib.colors import to_hex
from numpy.typing import NDArray

from gpubspline.material.laws import Law
from gpubspline.mesh.quality import Quality
from gpubspline.report.page.account import Curve
from gpubspline.report.page.axes import Axes, polyline, widened
from gpubspline.report.quantity import quantity

PAPER_SHARES = (
    ("head slice, Fig. 6", 95.0, None),
    ("child femur, Fig. 7", 76.0, 10.5),
    ("adult femur, Fig. 8", 88.0, None),
    ("head, Fig. 9", 91.0, None),
)
"""Percent of elements above 0.5, and below 0.1 where the text gives one figure, of the paper's section 3.4."""

BINS, POINTS = 40, 600
"""Bars of a distribution; points of the chart of E against HU."""


def jacobian_chart(quality: Quality) -> str:
    """Draw the histogram of scaled Jacobians, percent of the elements in ten bins, coloured as everywhere."""
    percent = 100 * quality.counts / quality.n_elements
    axes = Axes((0, 1), (0, max(1.12 * float(percent.max()), 1.0)), "scaled Jacobian", "elements (%)")
    middles = (quality.edges[:-1] + quality.edges[1:]) / 2
    colours = quantity("scaled_jacobian").scale(quality.edges)[0].to_rgba(middles)
    marks = []
    edges, tops, floor = axes.across(quality.edges.tolist()), axes.up(percent.tolist()), axes.up([0])[0]
    for left, right, top, colour, count in zip(edges, edges[1:], tops, colours, quality.counts, strict=False):
        marks.append(_bar(left + 1.5, right - 1.5, top, floor, f'fill="{to_hex(colour)}"'))
        if count:
            marks.append(
                f'<text x="{(left + right) / 2:.1f}" y="{top - 3:.1f}" class="count">{_short(int(count))}</text>'
            )
    return axes.svg("".join(marks), "histogram of scaled Jacobians")


def _short(count: int) -> str:
    return f"{count:,}" if count < 100_000 else f"{count / 1000:,.0f} k"


def _bar(left: float, right: float, top: float, floor: float, look: str) -> str:
    return f'<rect x="{left:.1f}" y="{top:.1f}" width="{right - left:.1f}" height="{floor - top:.1f}" {look}/>'


def paper_chart(quality: Quality) -> str:
    """Draw the share of elements above 0.5 and below 0.1 beside those that the paper reports for its models."""
    own = ("this mesh", 100 * quality.fraction_above_0_5, 100 * quality.fraction_below_0_1)
    rows = [own, *PAPER_SHARES]
    left, right, step = 122.0, 300.0, 42.0
    parts = [f'<svg viewBox="0 0 420 {step * len(rows) + 34:g}" role="img" aria-label="beside the paper">']
    parts.append(
        f'<text x="{left}" y="14" class="tick">above 0.5</text><text x="362" y="14" class="tick">below 0.1</text>'
    )
    for number, (name, above, below) in enumerate(rows):
        y, kind = 26 + step * number, "own" if number == 0 else "paper"
        wide = (right - left) * above / 100
        low = "not given" if below is None else percent(below / 100)
        parts.append(
            f'<text x="{left - 8}" y="{y + 18:g}" class="tick end">{escape(name)}</text>'
            f'<rect class="{kind}" x="{left}" y="{y:g}" width="{wide:.1f}" height="26"/>'
            f'<text x="{left + wide + 5:.1f}" y="{y + 18:g}" class="tick">{percent(above / 100)}</text>'
            f'<text x="362" y="{y + 18:g}" class="tick">{low}</text>'
        )
    return "".join([*parts, "</svg>"])


def percent(share: float) -> str:
    """Percent with one digit where it has one, which never rounds to all or to none."""
    if 0 < share < 0.001:
        return "< 0.1 %"
    if 0.999 < share < 1:
        return "> 99.9 %"
    return f"{100 * share:.1f}".removesuffix(".0") + " %"


def distribution(name: str, values: NDArray[Any]) -> str:
    """Draw how a nodal field is distributed, percent of the nodes in equal bins, on the scale of its colour bar."""
    look = quantity(name)
    values = np.asarray(values, dtype=np.float64)
    values = values[np.isfinite(values)]
    low, high = (float(end) for end in np.percentile(values, [0.0, 99.9]))
    high = high if high > low else low + 1
    logarithmic = look.logarithmic and low > 0 and high > 20 * low
    edges = np.geomspace(low, high, BINS + 1) if logarithmic else np.linspace(low, high, BINS + 1)
    share = 100 * np.histogram(np.clip(values, edges[0], edges[-1]), edges)[0] / values.size
    label = " ".join(look.label.split())
    axes = Axes((edges[0], edges[-1]), (0, 1.08 * float(share.max())), label, "nodes (%)", log_x=logarithmic)
    middles = np.sqrt(edges[:-1] * edges[1:]) if logarithmic else (edges[:-1] + edges[1:]) / 2
    colours = look.scale(values)[0].to_rgba(middles)
    places, tops, floor = axes.across(edges.tolist()), axes.up(share.tolist()), axes.up([0])[0]
    bars = [
        _bar(left, right, top, floor, f'class="bar" fill="{to_hex(colour)}"')
        for left, right, top, colour in zip(places, places[1:], tops, colours, strict=False)
    ]
    return axes.svg("".join(bars), f"distribution of {label}")


def law_chart(hu: NDArray[Any], modulus_mpa: NDArray[Any], laws: Sequence[Law]) -> str:
    """Draw E against HU of some of the nodes, and the laws as lines, one a piece: where a law jumps, its line does."""
    step = max(len(hu) // POINTS, 1)
    some_hu, some_mpa = np.asarray(hu)[::step].astype(float), np.asarray(modulus_mpa)[::step].astype(float)
    lines = [_piece_line(law, number) for law in laws for number in range(len(law.pieces))]
    ends = [value for x, y in lines for value in zip(x, y, strict=True)]
    known = [(x, y) for x, y in zip(some_hu, some_mpa, strict=True) if np.isfinite(x) and 0 < y < np.inf]
    all_x, all_y = [x for x, _ in known + ends], [y for _, y in known + ends]
    log_y = max(all_y) > 20 * min(all_y)
    axes = Axes(widened(all_x), widened(all_y, log_y), "HU", "Young's modulus (MPa)", log_y=log_y)
    dots = [
        f'<circle class="dot" cx="{x:.1f}" cy="{y:.1f}" r="2"/>'
        for x, y in zip(axes.across([p[0] for p in known]), axes.up([p[1] for p in known]), strict=True)
    ]
    drawn = [polyline(axes.across(x), axes.up(y), "law") for x, y in lines]
    return axes.svg("".join(dots + drawn), "Young's modulus against HU")


def _piece_line(law: Law, number: int) -> tuple[list[float], list[float]]:
    piece = law.pieces[number]
    hu = np.linspace(piece.lower_hu, piece.upper_hu, 60).tolist()
    return hu, [piece.modulus_mpa(law.density.density_g_cm3(value)) for value in hu]


def curve_chart(curve: Curve) -> str:
    """Draw the points and lines of a command's own chart, and name its series below where there are several."""
    all_x = [float(value) for x, _ in curve.series.values() for value in x]
    all_y = [float(value) for _, y in curve.series.values() for value in y]
    x_ends, y_ends = widened(all_x, curve.log_x), widened(all_y, curve.log_y)
    axes = Axes(x_ends, y_ends, curve.x_label, curve.y_label, log_x=curve.log_x, log_y=curve.log_y)
    marks = []
    for number, (name, (x, y)) in enumerate(curve.series.items()):
        places = axes.across([float(v) for v in x]), axes.up([float(v) for v in y])
        marks.append(polyline(*places, f"curve series{number % 4}"))
        marks += [
            f'<circle class="point series{number % 4}" cx="{a:.1f}" cy="{b:.1f}" r="3"/>'
            for a, b in zip(*places, strict=True)
        ]
        if len(curve.series) > 1:
            place = f'x="{axes.width - 14:g}" y="{22 + 15 * number:g}"'
            marks.append(f'<text {place} class="tick end name series{number % 4}">{escape(name)}</text>')
    return axes.svg("".join(marks), curve.title)
