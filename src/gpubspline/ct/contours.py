"""Closed contours in slices to what they enclose: at pixel centres, and the part of each pixel.

A line through the slice crosses contours an even number of times. The inside lies between the first and the second
crossing, the third and the fourth, and so on: so contours within others are holes.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

LINES = 8
"""Lines through each row of pixels by which the part inside is found; along a line it is exact."""

TOUCH = 1e-4
"""Pixels by which a centre may lie outside and is still counted inside: contours are written in decimals, and some draw
them through the centres of the outermost pixels."""


@dataclass(frozen=True, eq=False)
class Plane:
    """Closed contours in one plane.

    Attributes
    ----------
    height: index k, not always whole.
    contours: (points, 2) each, indices (i, j); the last point joins the first.
    """

    height: float
    contours: list[Floats]


def fill(planes: list[Plane], shape: tuple[int, ...]) -> tuple[NDArray[np.bool_], NDArray[np.float32]]:
    """Fill contours on a grid.

    Arguments
    ---------
    planes: by rising height.
    shape: (n_k, n_j, n_i).

    Returns
    -------
    (n_k, n_j, n_i) bool, centres inside, and float32, the part of each pixel in its slice that is inside.
    """
    inside, covered = np.zeros(shape, dtype=bool), np.zeros(shape, dtype=np.float32)
    heights = np.array([plane.height for plane in planes])
    reach = 0.5 * max(float(np.median(np.diff(heights))), 1.0) if len(heights) > 1 else 0.5
    for k in range(shape[0]):
        nearest = int(np.abs(heights - k).argmin()) if len(heights) else -1
        if nearest >= 0 and abs(heights[nearest] - k) <= reach + TOUCH:
            inside[k], covered[k] = _fill_slice(planes[nearest].contours, shape[1:])
    return inside, covered


def _fill_slice(contours: list[Floats], shape: tuple[int, ...]) -> tuple[NDArray[np.bool_], NDArray[np.float32]]:
    starts = np.concatenate(contours)
    ends = np.concatenate([np.roll(contour, -1, axis=0) for contour in contours])
    rows = np.arange(shape[0], dtype=np.float64)
    touching = np.zeros((shape[0], shape[1] + 1), dtype=np.int64)
    for off in (-TOUCH, TOUCH):  # a contour along a row of centres holds them
        row, left, right = _spans(starts, ends, rows + off)
        first = np.clip(np.ceil(left - TOUCH).astype(int), 0, shape[1])
        last = np.clip(np.floor(right + TOUCH).astype(int) + 1, 0, shape[1])
        np.add.at(touching, (row, first), 1)
        np.add.at(touching, (row, last), -1)
    covered = np.zeros((shape[0], shape[1] + 1))
    line, left, right = _spans(starts, ends, (np.arange(LINES * shape[0]) + 0.5) / LINES - 0.5)
    for at, sign in ((right, 1.0), (left, -1.0)):
        _add_ramp(covered, line // LINES, at, sign / LINES)
    inside = np.cumsum(touching, axis=1)[:, :-1] > 0
    return inside, np.clip(np.cumsum(covered, axis=1)[:, :-1], 0, 1).astype(np.float32)


def _spans(starts: Floats, ends: Floats, heights: Floats) -> tuple[NDArray[np.int64], Floats, Floats]:
    """Where lines at rising heights are inside: number of the line, from, to (s,) each."""
    low, high = np.minimum(starts[:, 1], ends[:, 1]), np.maximum(starts[:, 1], ends[:, 1])
    first = np.searchsorted(heights, low)  # a line through a point is crossed by the edge that goes on above it
    count = np.searchsorted(heights, high) - first
    edge = np.repeat(np.arange(len(starts)), count)
    line = np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count) + first[edge]
    a, b = starts[edge], ends[edge]
    at = a[:, 0] + (heights[line] - a[:, 1]) / (b[:, 1] - a[:, 1]) * (b[:, 0] - a[:, 0])
    order = np.lexsort((at, line))
    return line[order][::2], at[order][::2], at[order][1::2]


def _add_ramp(differences: Floats, row: NDArray[np.int64], at: Floats, height: float) -> None:
    """Add to pixels of rows the part of them to the left of ``at``, times a height, as differences along the row."""
    size = differences.shape[1] - 1
    from_edge = np.clip(at + 0.5, 0, size)
    pixel = np.minimum(np.floor(from_edge).astype(int), size - 1)
    part = from_edge - pixel
    np.add.at(differences, (row, np.zeros_like(row)), height)
    np.add.at(differences, (row, pixel), height * (part - 1))
    np.add.at(differences, (row, pixel + 1), -height * part)
