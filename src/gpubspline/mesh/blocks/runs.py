"""Bodies of a mask told apart by its runs along rows: there are as many as the surface has samples, not the volume."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

Integers = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Runs:
    """Runs of samples that a mask holds, in order.

    Attributes
    ----------
    shape: (n_k, n_j, n_i) of the mask.
    start, stop: (r,) flat index of the first sample of each and of the first beyond it.
    """

    shape: tuple[int, ...]
    start: Integers
    stop: Integers

    @cached_property
    def bodies(self) -> NDArray[np.int32]:
        """(r,) body of each, joined by faces of samples, from 0 in the order of their first samples."""
        _, n_j, n_i = self.shape
        pairs = np.concatenate([self._touching(n_i), self._touching(n_j * n_i)], axis=1)
        count = len(self.start)
        joined = coo_matrix((np.ones(pairs.shape[1], dtype=bool), tuple(pairs)), shape=(count, count))
        return np.asarray(connected_components(joined, directed=False)[1])

    @cached_property
    def sizes(self) -> Integers:
        """Samples of each body."""
        return np.asarray(np.bincount(self.bodies, self.stop - self.start), dtype=np.int64)

    def samples(self, chosen: NDArray[np.bool_]) -> Integers:
        """Flat indices of the samples of some of the runs (r,), in order."""
        start, length = self.start[chosen], (self.stop - self.start)[chosen]
        return np.repeat(start - np.cumsum(length) + length, length) + np.arange(length.sum())

    def _touching(self, step: int) -> Integers:
        """(2, p) runs that lie beside each other, one row or one slice apart."""
        _, n_j, n_i = self.shape
        row = self.start // n_i
        here = np.arange(len(row)) if step != n_i else np.flatnonzero(row % n_j < n_j - 1)
        first = np.searchsorted(self.stop, self.start[here] + step, side="right")
        last = np.searchsorted(self.start, self.stop[here] + step, side="left")
        length = np.maximum(last - first, 0)
        other = np.repeat(first - np.cumsum(length) + length, length) + np.arange(length.sum())
        return np.stack([np.repeat(here, length), other])


def runs_of(mask: NDArray[np.bool_]) -> Runs:
    """Runs of a mask (n_k, n_j, n_i); none goes on from one row to the next."""
    *_, n_i = mask.shape
    rows = mask.reshape(-1, n_i)
    changes = np.empty((len(rows), n_i + 1), dtype=bool)
    changes[:, 0], changes[:, -1] = rows[:, 0], rows[:, -1]
    np.not_equal(rows[:, 1:], rows[:, :-1], out=changes[:, 1:-1])
    ends = np.flatnonzero(changes)
    ends -= ends // (n_i + 1)  # the last end of a row is the first sample of the next
    return Runs(mask.shape, ends[::2].astype(np.int64), ends[1::2].astype(np.int64))
