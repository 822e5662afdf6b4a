"""Samples near a surface, in bricks: what is far inside or outside a body is never looked at.

Their number grows with the surface, while the samples of the whole grid grow with the volume. What a brick needs of its
neighbours is put beside it for one axis at a time, since all that is done here falls apart into axes.
"""

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.ndimage import correlate1d, maximum_filter

EDGE = 12
"""Samples along a brick, four lattice cells."""

FAR = EDGE
"""Steps up to which distances are exact: the way through a neighbour."""

OUTSIDE, INSIDE = -1, -2
"""Numbers of what is no brick; of values (n + 2, ...) the last and the last but one."""

_TOGETHER = 256  # bricks: they and what is beside them fit the caches
_UNREACHED = 30_000  # squared steps, with room for more

Values = NDArray[Any]


@dataclass(frozen=True, eq=False)
class Bricks:
    """Which bricks of a grid are near a surface.

    Values at their samples are arrays (n + 2, EDGE, EDGE, EDGE), along k, j, i: the last two hold what is at all
    others, far inside and far outside.

    Attributes
    ----------
    shape: (n_k, n_j, n_i) samples of the grid; bricks go on beyond its end.
    numbers: (b_k, b_j, b_i) int32 of each brick, from 0; ``OUTSIDE`` or ``INSIDE`` of what is far.
    """

    shape: tuple[int, ...]
    numbers: NDArray[np.int32]

    @property
    def count(self) -> int:
        """Bricks near the surface."""
        return int(self.numbers.max(initial=-1)) + 1

    @cached_property
    def _beside(self) -> list[tuple[NDArray[np.int32], NDArray[np.int32]]]:
        """Numbers (n,) of the bricks before and after each, along each axis."""
        padded = np.pad(self.numbers, 1, constant_values=OUTSIDE)
        inner, found = slice(1, -1), []
        for axis in range(3):
            sides = []
            for side in (slice(0, -2), slice(2, None)):
                window = [inner, inner, inner]
                window[axis] = side
                sides.append(padded[tuple(window)][self.numbers >= 0])
            found.append((sides[0], sides[1]))
        return found

    def joined(self, other: "Bricks") -> "Bricks":
        """Those near either of two surfaces."""
        return bricks_where((self.numbers >= 0) | (other.numbers >= 0), self.numbers == INSIDE, self.shape)

    def along(self, values: Values, axis: int, reach: int, work: Callable[[Values], Values]) -> Values:
        """Replace each line of a brick by what ``work`` makes of lines with ``reach`` samples more at both ends.

        ``work`` takes (m, EDGE + 2 reach, EDGE, EDGE), lines along the second axis, and gives (m, EDGE, EDGE, EDGE).
        """
        turned = np.moveaxis(values, axis + 1, 1)
        before, after = self._beside[axis]
        out: Values = values.copy()
        made = np.moveaxis(out, axis + 1, 1)

        def do(first: int) -> None:
            part = slice(first, min(first + _TOGETHER, self.count))
            ends = turned[before[part], EDGE - reach :], turned[part], turned[after[part], :reach]
            lines = np.empty((len(ends[1]), EDGE + 2 * reach, EDGE, EDGE), dtype=values.dtype)
            made[part] = work(np.concatenate(ends, axis=1, out=lines))

        _in_threads(do, range(0, self.count, _TOGETHER))
        return out

    def of(self, field: Values, inside: Any, outside: Any) -> Values:
        """Values of a field (n_k, n_j, n_i), with what is far inside and far outside."""
        values = np.empty((self.count + 2, EDGE, EDGE, EDGE), dtype=field.dtype)
        values[-2:] = far_values(inside, outside, field.dtype)
        for numbers, slab, _ in self._slabs(field, outside):
            values[numbers[numbers >= 0]] = slab[numbers >= 0]
        return values

    def places(self, at: tuple[NDArray[Any], ...]) -> NDArray[np.int64]:
        """Indices (n, 3) k, j, i of samples by brick and place in it."""
        corners = EDGE * np.argwhere(self.numbers >= 0)
        return np.asarray(corners[at[0]] + np.stack(at[1:], axis=1))

    def put(self, values: Values, field: Values) -> Values:
        """Write values into a field (n_k, n_j, n_i)."""
        for numbers, slab, part in self._slabs(field):
            slab[numbers >= 0] = values[numbers[numbers >= 0]]
            n_k, n_j, n_i = part.shape
            part[...] = slab.transpose(2, 0, 3, 1, 4).reshape(EDGE, len(slab) * EDGE, -1)[:n_k, :n_j, :n_i]
        return field

    def field(self, values: Values) -> Values:
        """Write values into a field (n_k, n_j, n_i) of its own, far ones too."""
        field = np.empty(self.shape, dtype=values.dtype)
        _, b_j, b_i = self.numbers.shape
        for first, numbers in enumerate(self.numbers):
            part = field[first * EDGE : (first + 1) * EDGE]
            n_k, n_j, n_i = part.shape
            slab = values[numbers].transpose(2, 0, 3, 1, 4).reshape(EDGE, b_j * EDGE, b_i * EDGE)
            part[...] = slab[:n_k, :n_j, :n_i]
        return field

    def _slabs(self, field: Values, beyond: Any = 0) -> Iterator[tuple[NDArray[np.int32], Values, Values]]:
        """Layers of bricks along k: numbers (b_j, b_i), samples (b_j, b_i, EDGE, EDGE, EDGE), their part of a field."""
        _, b_j, b_i = self.numbers.shape
        slab = np.full((EDGE, b_j * EDGE, b_i * EDGE), beyond, dtype=field.dtype)
        seen = slab.reshape(EDGE, b_j, EDGE, b_i, EDGE).transpose(1, 3, 0, 2, 4)
        for layer, numbers in enumerate(self.numbers):
            part = field[layer * EDGE : (layer + 1) * EDGE]
            n_k, n_j, n_i = part.shape
            if (numbers >= 0).any():
                slab[:n_k, :n_j, :n_i], slab[n_k:] = part, beyond
                yield numbers, seen, part

    def smoothed(self, values: Values, sigma: float) -> Values:
        """Smooth by a Gaussian of some samples, cut at three of them: as ``gaussian_filter`` does, to the last bit."""
        reach = int(3.0 * sigma + 0.5)
        weights = np.exp(-0.5 / (sigma * sigma) * np.arange(-reach, reach + 1) ** 2)
        weights /= weights.sum()

        def smooth(lines: Values) -> Values:
            return np.asarray(correlate1d(lines, weights, axis=1)[:, reach:-reach])

        for axis in range(3):
            values = self.along(values, axis, reach, smooth)
        return values

    def summed_in_cells(self, values: Values, each: int) -> Values:
        """Sums over the samples of each lattice cell of ``each`` samples a side, but for those of its far sides."""
        cells, n = [(n - 1) // each for n in self.shape], EDGE // each
        sums = values[:-2].reshape(self.count, n, each, n, each, n, each).sum(axis=(2, 4, 6))
        found = np.zeros((len(self.numbers), n, self.numbers.shape[1], n, self.numbers.shape[2], n), dtype=values.dtype)
        found.transpose(0, 2, 4, 1, 3, 5)[self.numbers >= 0] = sums
        whole = found.reshape([n * bricks for bricks in self.numbers.shape])
        return whole[: cells[0], : cells[1], : cells[2]]

    def between_cells(self, cells: Values, each: int) -> Values:
        """Values of cells (n_k, n_j, n_i), linear between the middles of what is summed over; none far away."""
        n = EDGE // each
        sizes = [n * bricks + 2 for bricks in self.numbers.shape]
        ends = [(1, size - 1 - count) for size, count in zip(sizes, cells.shape, strict=True)]
        around = sliding_window_view(np.pad(cells, ends, mode="edge"), (n + 2, n + 2, n + 2))[::n, ::n, ::n]
        values = around[self.numbers >= 0]
        low, share = np.divmod(np.arange(EDGE) + each - (each - 1) // 2, each)
        for axis in range(1, 4):
            part = (share / each).astype(np.float32).reshape([-1 if a == axis else 1 for a in range(4)])
            values = values.take(low, axis) * (1 - part) + values.take(low + 1, axis) * part
        return np.concatenate([values, np.zeros((2, EDGE, EDGE, EDGE), dtype=values.dtype)])

    def depth(self, inside: Values) -> NDArray[np.float32]:
        """Steps to the outermost samples inside, positive inside, negative outside; exact up to ``FAR``.

        Outermost are those that any of the 26 round them is not like, as ITK has it. Farther ones are at least as far
        as ``FAR``.
        """
        beyond = ~inside
        for axis in range(3):
            beyond = self.along(beyond, axis, 1, lambda a: a[:, :-2] | a[:, 1:-1] | a[:, 2:])
        steps = np.where(inside & beyond, np.int16(0), np.int16(_UNREACHED))
        for axis in range(3):
            steps = self.along(steps, axis, FAR, _nearest)
        found = np.sqrt(steps.astype(np.float32))
        return np.asarray(np.where(inside, found, -found))


def far_values(inside: Any, outside: Any, dtype: Any = None) -> Values:
    """Values (2, EDGE, EDGE, EDGE) of what is far inside and far outside."""
    return np.stack([np.full((EDGE, EDGE, EDGE), value, dtype) for value in (inside, outside)])


def bricks_where(near: NDArray[np.bool_], inside: NDArray[np.bool_], shape: tuple[int, ...]) -> Bricks:
    """Bricks (b_k, b_j, b_i) that are near a surface; ``inside``: what the others are."""
    numbers = np.where(inside, np.int32(INSIDE), np.int32(OUTSIDE))
    numbers[near] = np.arange(np.count_nonzero(near), dtype=np.int32)
    return Bricks(shape, numbers)


def bricks_round(field: NDArray[np.float32], far: float) -> Bricks:
    """Bricks of a field (n_k, n_j, n_i) that hold values between ``-far`` and ``far``."""
    starts = [np.arange(0, n, EDGE) for n in field.shape]
    near, inside = (np.empty(tuple(len(start) for start in starts), dtype=bool) for _ in range(2))
    for layer, first in enumerate(starts[0]):
        part = field[first : first + EDGE]
        for which, mask in ((near, (part < far) & (part > -far)), (inside, part < 0)):
            which[layer] = np.logical_or.reduceat(
                np.logical_or.reduceat(mask.any(axis=0), starts[1], axis=0), starts[2], axis=1
            )
    return bricks_where(near, inside, field.shape)


def with_neighbours(bricks: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Bricks (b_k, b_j, b_i) and all 26 round them."""
    return np.asarray(maximum_filter(bricks, size=3))


def _nearest(steps: Values) -> Values:
    """Least squared steps along lines: the lower envelope of parabolas, whose arms end at ``FAR``."""
    least: Values = steps[:, FAR:-FAR].copy()
    for step in range(1, FAR + 1):
        other = np.minimum(steps[:, FAR - step : -FAR - step], steps[:, FAR + step : FAR + step + EDGE])
        np.minimum(least, other + np.int16(step * step), out=least)
    return least


def _in_threads(do: Callable[[int], None], items: range) -> None:
    """On two threads where there is much: NumPy and SciPy let others run meanwhile."""
    if len(items) < 4:
        for item in items:
            do(item)
        return
    with ThreadPoolExecutor(2) as pool:
        list(pool.map(do, items))
