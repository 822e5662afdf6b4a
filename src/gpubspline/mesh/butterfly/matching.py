"""Places on the contours of all sections that belong to each other, without twist between sections.

The place on a contour is told by the angle under which the section's centroid sees it, after the section was stretched
to be as round as an ellipse can make it. The stretch is symmetric, which turns nothing: equal angles are the same place
from section to section, and the twist that equal distances along the contour would give is not there to begin with.
Where the angle turns back (an ear), it is made to rise; a small share of the length along the contour keeps places
apart.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from gpubspline.mesh.butterfly.contours import signed_area

Floats = NDArray[np.float64]

DENSE = 1440
"""Points that a contour is resampled to."""

BY_ANGLE = 0.9
"""Share of the angle in what tells a place; the rest is the length along the contour."""


def match_loops(loops: list[Floats], count: int, start: float, smoothing: float = 0.0) -> Floats:
    """Give points (count, l, 2), mm, on the contours of l sections; those of one number belong to each other.

    Arguments
    ---------
    start: angle of the first, in turns.
    smoothing: standard deviation, in points (two thirds of it in sections), of the Gaussian that takes from the
        contours what is finer than the points; 0 leaves them.
    """
    points = np.stack([_places(loop, start + np.arange(count) / count) for loop in loops], axis=1)
    if smoothing <= 0:
        return points
    return _sharpened(_sharpened(points, smoothing, 0, "wrap"), 2 / 3 * smoothing, 1, "nearest")


def _sharpened(points: Floats, sigma: float, axis: int, mode: str) -> Floats:
    """Twice the smoothed points minus the twice smoothed ones, which hardly shrinks a round contour."""
    once = gaussian_filter1d(points, sigma, axis=axis, mode=mode)
    return np.asarray(2 * once - gaussian_filter1d(once, sigma, axis=axis, mode=mode))


def _places(loop: Floats, turns: Floats) -> Floats:
    """Points (n, 2) of a contour at places given in turns."""
    dense = resample(loop, DENSE)
    centre, round_out = _round_frame(dense)
    x, y = ((dense - centre) @ round_out).T
    angle = np.unwrap(np.arctan2(y, x)) / (2 * np.pi)
    length = np.arange(DENSE) / DENSE
    rising = _rising(angle)
    place = BY_ANGLE * rising + (1 - BY_ANGLE) * (length + np.mean(rising - length))
    wanted = place[0] + np.mod(turns - place[0], 1.0)
    ends = np.append(place, place[0] + 1)
    closed = np.vstack([dense, dense[:1]])
    return np.stack([np.interp(wanted, ends, closed[:, axis]) for axis in (0, 1)], axis=1)


def resample(loop: Floats, count: int) -> Floats:
    """Points (count, 2) at equal lengths along a closed polygon (n, 2)."""
    closed = np.vstack([loop, loop[:1]])
    along = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    at = along[-1] * np.arange(count) / count
    return np.stack([np.interp(at, along, closed[:, axis]) for axis in (0, 1)], axis=1)


def _round_frame(loop: Floats) -> tuple[Floats, Floats]:
    """Centroid of a polygon, and the symmetric matrix that makes its second moments those of a disc."""
    x, y = loop.T
    x1, y1 = np.roll(x, -1), np.roll(y, -1)
    cross, area = x * y1 - x1 * y, signed_area(loop)
    centre = np.array([np.sum((x + x1) * cross), np.sum((y + y1) * cross)]) / (6 * area)
    x, y, x1, y1 = x - centre[0], y - centre[1], x1 - centre[0], y1 - centre[1]
    cross = x * y1 - x1 * y
    xx = np.sum((x * x + x * x1 + x1 * x1) * cross) / 12
    yy = np.sum((y * y + y * y1 + y1 * y1) * cross) / 12
    xy = np.sum((x * y1 + 2 * x * y + 2 * x1 * y1 + x1 * y) * cross) / 24
    values, vectors = np.linalg.eigh(np.array([[xx, xy], [xy, yy]]) / area)
    return centre, vectors @ np.diag(1 / np.sqrt(np.maximum(values, 1e-12))) @ vectors.T


def _rising(angle: Floats) -> Floats:
    """The angle along one turn, not falling: between the greatest before and the least after, over three turns."""
    turns = np.concatenate([angle - 1, angle, angle + 1])
    before = np.maximum.accumulate(turns)
    after = np.minimum.accumulate(turns[::-1])[::-1]
    return np.asarray(0.5 * (before + after)[len(angle) : 2 * len(angle)])
