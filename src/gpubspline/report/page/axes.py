"""Axes of a chart as SVG: a frame, ticks, and places for values; colours are left to the page's style sheet."""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np
from matplotlib.ticker import LogLocator, MaxNLocator

LEFT, RIGHT, TOP, BOTTOM = 68.0, 18.0, 12.0, 40.0
"""Margins around the frame, in the picture's units."""


@dataclass(frozen=True)
class Axes:
    """A frame whose values are placed in a picture ``width`` by ``height``.

    Attributes
    ----------
    x, y: ends of the values.
    x_label, y_label: with units.
    log_x, log_y: whether values are placed by their logarithm.
    """

    x: tuple[float, float]
    y: tuple[float, float]
    x_label: str
    y_label: str
    log_x: bool = False
    log_y: bool = False
    width: float = 420.0
    height: float = 260.0

    def across(self, values: Sequence[float]) -> list[float]:
        """Places of x values, cut off at the frame."""
        share = _share(values, self.x, self.log_x)
        return [LEFT + s * (self.width - LEFT - RIGHT) for s in share]

    def up(self, values: Sequence[float]) -> list[float]:
        """Places of y values, cut off at the frame."""
        share = _share(values, self.y, self.log_y)
        return [self.height - BOTTOM - s * (self.height - TOP - BOTTOM) for s in share]

    def svg(self, marks: str, title: str) -> str:
        """Draw the frame, its ticks and labels, and the marks in it; the title is for those who cannot see."""
        middle = (LEFT + self.width - RIGHT) / 2, (TOP + self.height - BOTTOM) / 2
        floor = self.height - BOTTOM
        parts = [
            f'<svg viewBox="0 0 {self.width:g} {self.height:g}" role="img" aria-label="{escape(title)}">',
            *self._ticks_across(floor),
            *self._ticks_up(),
            marks,
            f'<path class="frame" d="M{LEFT:g} {TOP:g}V{floor:g}H{self.width - RIGHT:g}"/>',
            f'<text x="{middle[0]:.1f}" y="{self.height - 6:g}" class="label">{escape(self.x_label)}</text>',
            f'<text transform="translate(12 {middle[1]:.1f}) rotate(-90)" class="label">{escape(self.y_label)}</text>',
            "</svg>",
        ]
        return "".join(parts)

    def _ticks_across(self, floor: float) -> list[str]:
        values = _ticks(self.x, self.log_x)
        places = self.across(values)
        return [
            f'<text x="{place:.1f}" y="{floor + 15:g}" class="tick middle">{_tick(value)}</text>'
            for value, place in zip(values, places, strict=True)
        ]

    def _ticks_up(self) -> list[str]:
        values = _ticks(self.y, self.log_y)
        return [
            f'<path class="grid" d="M{LEFT:g} {place:.1f}H{self.width - RIGHT:g}"/>'
            f'<text x="{LEFT - 5:g}" y="{place + 4:.1f}" class="tick end">{_tick(value)}</text>'
            for value, place in zip(values, self.up(values), strict=True)
        ]


def _share(values: Sequence[float], ends: tuple[float, float], logarithmic: bool) -> list[float]:
    low, high = ends
    wide = np.asarray(values, dtype=np.float64)
    if logarithmic:
        low, high, wide = np.log(low), np.log(high), np.log(np.maximum(wide, 1e-300))
    share: list[float] = np.clip((wide - low) / (high - low), 0, 1).tolist()
    return share


def _ticks(ends: tuple[float, float], logarithmic: bool) -> list[float]:
    """Round values between the ends."""
    low, high = ends
    decades = np.log10(high / low) if logarithmic else 0.0
    if logarithmic and decades > 0.9:
        found = LogLocator(subs=(1.0, 2.0, 5.0) if decades < 2.5 else (1.0,)).tick_values(low, high)
    else:
        found = MaxNLocator(6, steps=[1, 2, 2.5, 5, 10]).tick_values(low, high)
    inside = found[(found >= low * (1 - 1e-9 * np.sign(low))) & (found <= high * (1 + 1e-9 * np.sign(high)))]
    ticks: list[float] = (inside + 0.0).tolist()
    return ticks


def _tick(value: float) -> str:
    return f"{value:,.0f}" if 1000 <= abs(value) < 1e6 else f"{value:g}"


def widened(values: Sequence[float], logarithmic: bool = False) -> tuple[float, float]:
    """Ends that hold all values with a little room, and are never equal."""
    low, high = float(np.min(values)), float(np.max(values))
    if logarithmic:
        room = max((high / low) ** 0.04, 1.02)
        return low / room, high * room
    room = 0.04 * (high - low) or max(abs(high), 1.0) * 0.05
    return low - room, high + room


def polyline(x: Sequence[float], y: Sequence[float], kind: str) -> str:
    """Draw a line through places."""
    points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))
    return f'<polyline class="{kind}" points="{points}"/>'
