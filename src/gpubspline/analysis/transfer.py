"""From a grid of a structured mesh to a coarser one, which has every second node of some directions, and back."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.analysis.banded import bandwidth
from gpubspline.device import Buffer, Device

DIRECT = 2_000_000
"""Numbers in the band of a matrix that is solved directly."""
CLOSE = 1.7
"""Directions are coarsened whose nodes lie closer than this, times the closest direction."""
SHORTEST = 0.05
"""Of an edge, in mean ones of its direction."""

Counts = tuple[int, int, int]


@dataclass(frozen=True, eq=False)
class Transfer:
    """From a grid to a coarser one and back; arrays of the three directions one after another.

    Attributes
    ----------
    counts: coarse nodes per direction.
    centre: of each coarse node the fine one at its place.
    side: of each coarse node the values of its function at the fine nodes before and after it.
    below, above: of each fine node the coarse one at or before it, and the share of the one after.
    functions: of each direction the values (fine, coarse) of coarse nodes' functions, on the host.
    """

    counts: Counts
    centre: Buffer
    side: Buffer
    below: Buffer
    above: Buffer
    functions: list[NDArray[Any]]


def spacing_of(counts: Counts, points: NDArray[Any]) -> list[float]:
    """Distance of neighbours along each direction, mm: that whose coupling, by 1 / distance^2, is their mean.

    Edges count as no shorter than ``SHORTEST``: one without length couples without end.
    """
    grid = points.reshape(*counts[::-1], 3).astype(np.float64)
    squares = [np.sum(np.diff(grid, axis=axis) ** 2, axis=-1) for axis in (2, 1, 0)]
    return [float(np.mean(1 / np.maximum(square, SHORTEST**2 * square.mean())) ** -0.5) for square in squares]


def is_direct(counts: Counts) -> bool:
    """Whether the matrix of a grid is small enough to be solved directly."""
    return 3 * int(np.prod(counts)) * bandwidth(counts) <= DIRECT


def coarsened(
    device: Device, counts: Counts, spacing: list[float], close: float = CLOSE
) -> tuple[Transfer, list[float]]:
    """Coarsen the directions in which nodes lie close; none where the grid itself can be solved directly.

    Arguments
    ---------
    spacing: distance of neighbours along each direction, mm.
    close: which lie close, in distances of the closest direction.

    Returns
    -------
    the way to the coarser grid and back, and its spacing.
    """
    least = min((size for size, n in zip(spacing, counts, strict=True) if n > 2), default=0.0)
    limit = 0.0 if is_direct(counts) else close * least
    halved = [n > 2 and size < limit for size, n in zip(spacing, counts, strict=True)]
    centres = [_centres(n) if half else np.arange(n) for n, half in zip(counts, halved, strict=True)]
    sides, below, above, functions = [], [], [], []
    for n, centre in zip(counts, centres, strict=True):
        gap = np.diff(centre) == 2
        sides.append(np.stack([np.append(False, gap), np.append(gap, False)], axis=1).ravel() * 0.5)
        below.append(np.searchsorted(centre, np.arange(n), side="right") - 1)
        above.append(np.where(centre[below[-1]] < np.arange(n), 0.5, 0.0))
        functions.append(np.eye(len(centre) + 1)[below[-1]] * (1 - above[-1])[:, None])
        functions[-1] += np.eye(len(centre) + 1)[below[-1] + 1] * above[-1][:, None]
    coarse = (len(centres[0]), len(centres[1]), len(centres[2]))
    centre, side, low, high = (device.put(np.concatenate(rows)) for rows in (centres, sides, below, above))
    spacing = [2 * size if half else size for size, half in zip(spacing, halved, strict=True)]
    return Transfer(coarse, centre, side, low, high, functions), spacing


def _centres(n: int) -> NDArray[Any]:
    """Every second node and the last."""
    return np.unique(np.append(np.arange(0, n, 2), n - 1))
