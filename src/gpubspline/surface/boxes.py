"""Walking through the cells of many boxes of a grid at once."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

Integers = NDArray[np.int64]

CHUNK = 1 << 21
"""Cells walked through at a time, which bounds the memory."""


def walk_boxes(low: Integers, high: Integers) -> Iterator[tuple[Integers, Integers]]:
    """Give every cell of every box, some million at a time.

    Arguments
    ---------
    low, high: (m, d) first and last index of each box; a box whose last lies before its first is empty.

    Returns: pairs of the number of the box (n,) and the cell's index (n, d), box by box, first index fastest.
    """
    extents = np.maximum(high - low + 1, 0)
    counts = extents.prod(axis=1)
    ends = np.cumsum(counts)
    total = int(ends[-1]) if len(ends) else 0
    for first in range(0, total, CHUNK):
        number = np.arange(first, min(first + CHUNK, total))
        box = np.searchsorted(ends, number, side="right")
        rest = number - (ends[box] - counts[box])
        cell = np.empty((len(number), low.shape[1]), dtype=np.int64)
        for axis in range(low.shape[1]):
            rest, along = np.divmod(rest, extents[box, axis])
            cell[:, axis] = low[box, axis] + along
        yield box, cell
