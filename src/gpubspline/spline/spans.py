"""Row spans: where each row of a slice enters and leaves the region, between voxels."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
BISECTIONS = 24  # of one voxel: far below the noise of any scan


def blend(samples: NDArray[Any], positions: Floats, axis: int) -> NDArray[np.float32]:
    """Interpolate linearly between neighbours along ``axis``.

    Arguments
    ---------
    samples: (..., n, ...) real.
    positions: (m,) fractional indices along ``axis``, or (l, m), one set for each of the l entries of the first axis.

    Returns: float32 of the shape of ``samples`` with n replaced by m.
    """
    positions = np.clip(positions, 0, samples.shape[axis] - 1)
    low = np.minimum(positions.astype(int), max(samples.shape[axis] - 2, 0))
    high = np.minimum(low + 1, samples.shape[axis] - 1)
    part = (positions - low).astype(np.float32)
    if positions.ndim == 1:
        ends = [np.take(samples, index, axis=axis) for index in (low, high)]
        part = part.reshape(-1, *[1] * (samples.ndim - axis - 1))
    else:
        rows = np.arange(len(samples))[:, None]
        ends = [samples[rows, index] for index in (low, high)]
        part = part[..., None]
    return np.asarray((1 - part) * ends[0] + part * ends[1], dtype=np.float32)


def row_spans(rows: NDArray[np.float32]) -> tuple[Floats, Floats]:
    """First entry into and last exit from the region along each row, by linear crossing of zero.

    Arguments
    ---------
    rows: (..., n) float32, mm, signed distance along each row, negative inside.

    Returns: two (...) float64 of fractional indices; NaN where the row misses the region.
    """
    inside = rows < 0
    hit = inside.any(axis=-1)
    last = rows.shape[-1] - 1
    first_in = inside.argmax(axis=-1)
    last_in = last - inside[..., ::-1].argmax(axis=-1)
    enter = first_in - _crossing(rows, first_in, np.maximum(first_in - 1, 0))
    leave = last_in + _crossing(rows, last_in, np.minimum(last_in + 1, last))
    return np.where(hit, enter, np.nan), np.where(hit, leave, np.nan)


def _crossing(rows: NDArray[np.float32], within: NDArray[Any], beyond: NDArray[Any]) -> Floats:
    # how far from the inside sample to its outside neighbour the zero lies; 0 where the grid ends
    a = np.take_along_axis(rows, within[..., None], axis=-1)[..., 0].astype(np.float64)
    b = np.take_along_axis(rows, beyond[..., None], axis=-1)[..., 0].astype(np.float64)
    return np.where(within == beyond, 0.0, a / np.where(b > a, a - b, 1.0))


def tips(slabs: NDArray[np.float32]) -> tuple[Floats, Floats]:
    """Fractional indices of the first and the last row (or slice) that hit the region.

    The blend of a row inside with its neighbour outside leaves the region once, since the least of its linear
    functions is concave: bisection finds where. A region cut by the end of the grid ends there.

    Arguments
    ---------
    slabs: (l, n, ...) float32, mm, signed distance; along n lie the rows of each of the l slices.

    Returns: two (l,) float64, NaN where nothing hits.
    """
    hits = np.asarray((slabs < 0).any(axis=tuple(range(2, slabs.ndim))))
    last = slabs.shape[1] - 1
    first_hit = hits.argmax(axis=1)
    last_hit = last - hits[:, ::-1].argmax(axis=1)
    first = first_hit - _reach(slabs, first_hit, np.maximum(first_hit - 1, 0))
    final = last_hit + _reach(slabs, last_hit, np.minimum(last_hit + 1, last))
    some = hits.any(axis=1)
    return np.where(some, first, np.nan), np.where(some, final, np.nan)


def _reach(slabs: NDArray[np.float32], within: NDArray[Any], beyond: NDArray[Any]) -> Floats:
    entry = np.arange(len(slabs))
    a, b = (slabs[entry, row].reshape(len(slabs), -1) for row in (within, beyond))
    low, high = np.zeros(len(slabs)), np.ones(len(slabs))
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        part = middle[:, None].astype(np.float32)
        hit = ((1 - part) * a + part * b < 0).any(axis=1)
        low, high = np.where(hit, middle, low), np.where(hit, high, middle)
    return np.where(within == beyond, 0.0, low)


def inset(first: Floats, final: Floats, last: int, fraction: float) -> tuple[Floats, Floats]:
    """Draw the ends in by a fraction of the extent, one voxel at most, but not where the grid's end cuts the region.

    A row at the very tip has no length and one just below it hardly any: the elements there would be slivers.
    ``last`` is the grid's last index.
    """
    depth = np.minimum(fraction * (final - first), 1.0)
    low = np.asarray(np.where(first > 0, first + depth, first))
    return low, np.asarray(np.where(final < last, final - depth, final))


def fill_gaps(values: Floats) -> Floats:
    """Replace NaN by linear interpolation along the last axis, then along the first where a whole line is NaN.

    Arguments
    ---------
    values: (l, m) float64 with some number in it.
    """
    if not np.isnan(values).any():
        return values
    along_rows = np.array([_fill_line(line) for line in values])
    return np.asarray(np.array([_fill_line(line) for line in along_rows.T]).T)


def _fill_line(line: Floats) -> Floats:
    known = np.flatnonzero(~np.isnan(line))
    if len(known) in (0, len(line)):
        return line
    return np.asarray(np.interp(np.arange(len(line)), known, line[known]))
