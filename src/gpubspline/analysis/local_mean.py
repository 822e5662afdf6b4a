"""The mean of a field over balls about points of a body, by the volume in them.

What is known at scattered points, each standing for a volume, goes onto a grid that is fine against the balls, shared
between the eight grid points around; balls are sums over the grid, made for all places at once by Fourier transform.
The mean at a place is smooth in the place and in the points, and needs as long for a million points as for many.
"""

from dataclasses import dataclass, field
from itertools import product
from math import ceil

import numpy as np
from numpy.typing import NDArray
from scipy import fft, ndimage

from gpubspline.errors import InputError

Floats = NDArray[np.float64]

STEPS = 6
"""Grid steps a radius; fewer where the grid would have more than ``MOST`` points, and never fewer than ``FEWEST``."""
FEWEST = 2
MOST = 20_000_000


@dataclass(eq=False)
class LocalMean:
    """A field summed on a grid.

    Attributes
    ----------
    low_mm: (3,) the grid's first point.
    step_mm: between its points.
    counts: (n_x, n_y, n_z) of them.
    radius_mm: of the balls.
    volume, total: (n_z n_y n_x,) mm3, and the same times the field.
    """

    low_mm: Floats
    step_mm: float
    counts: tuple[int, int, int]
    radius_mm: float
    volume: Floats = field(init=False)
    total: Floats = field(init=False)

    def __post_init__(self) -> None:
        """Begin with nothing."""
        size = int(np.prod(self.counts))
        self.volume, self.total = np.zeros(size), np.zeros(size)

    def add(self, points_mm: Floats, volume: Floats, values: Floats) -> None:
        """Add values (n,) at points (n, 3) of the body that stand for volumes (n,)."""
        at = (points_mm - self.low_mm) / self.step_mm
        cell = np.floor(at).astype(np.int64)
        share = at - cell
        n_x, n_y, _ = self.counts
        place = cell @ np.array([1, n_x, n_x * n_y])
        first, span = int(place.min()), int(np.ptp(place)) + 1
        for corner in product((0, 1), repeat=3):
            part = np.where(np.array(corner), share, 1 - share).prod(axis=1) * volume
            start = first + corner[0] + n_x * (corner[1] + n_y * corner[2])
            self.volume[start : start + span] += np.bincount(place - first, part, span)
            self.total[start : start + span] += np.bincount(place - first, part * values, span)

    def at(self, points_mm: Floats) -> tuple[Floats, Floats]:
        """Mean over the balls about points (n, 3) of the body, and which share of each ball the body fills, (n,)."""
        shape = self.counts[::-1]
        where = ((points_mm - self.low_mm) / self.step_mm)[:, ::-1].T
        padded = [fft.next_fast_len(n, real=True) for n in shape]
        ball = self._ball(padded)
        spectrum = fft.rfftn(ball)
        sums = []
        for values in (self.volume, self.total):
            grid = fft.irfftn(fft.rfftn(values.reshape(shape), padded) * spectrum, padded)
            sums.append(ndimage.map_coordinates(grid, where, order=1))
        filled = sums[0] / (float(ball.sum()) * self.step_mm**3)
        return np.asarray(sums[1] / np.where(sums[0] > 0, sums[0], 1.0)), np.asarray(filled)

    def _ball(self, shape: list[int]) -> Floats:
        """Weights of the ball's grid points about the first one, periodic; one step from 1 to 0 at its surface."""
        squares = np.zeros(shape)
        for axis, n in enumerate(shape):
            along = np.minimum(np.arange(n), n - np.arange(n)) ** 2.0
            squares += along.reshape([-1 if a == axis else 1 for a in range(3)])
        return np.clip(0.5 + self.radius_mm / self.step_mm - np.sqrt(squares), 0.0, 1.0)


def local_mean(points_mm: NDArray[np.floating], radius_mm: float) -> LocalMean:
    """Lay the grid for means over balls of a radius about the points (n, 3) of a body.

    Raises
    ------
    InputError where the radius is so small against the body that the grid would be too large.
    """
    low, high = points_mm.min(axis=0).astype(np.float64), points_mm.max(axis=0).astype(np.float64)
    size = high - low + 2 * radius_mm
    step = max(radius_mm / STEPS, float(np.prod(size) / MOST) ** (1 / 3))
    if step > radius_mm / FEWEST:
        least = FEWEST * step
        raise InputError(
            f"expected balls of at least {least:.2g} mm to average over in a body of "
            f"{' x '.join(f'{s:.0f}' for s in high - low)} mm, got {radius_mm:g} mm"
        )
    # a margin of a ball and two steps keeps the periodic sums apart
    counts = [ceil(span / step) + 5 for span in size]
    return LocalMean(low - radius_mm - 2 * step, step, (counts[0], counts[1], counts[2]), radius_mm)
