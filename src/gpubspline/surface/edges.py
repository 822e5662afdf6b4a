"""Edges of triangles, and which triangles meet at each."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from gpubspline.surface.surface import Integers


@dataclass(frozen=True, eq=False)
class Edges:
    """The edges of triangles (m, 3), and their sides: side n is one of triangle n % m.

    Attributes
    ----------
    sides: (3 m, 2) points of each side, in the triangle's order.
    number: (3 m,) the edge of each side.
    count: (e,) sides of each edge: 1 where the surface is open, 2 where it is a surface.
    order, start: sides edge by edge, and where those of each edge begin.
    """

    sides: Integers
    number: Integers
    count: Integers
    order: Integers
    start: Integers

    @property
    def owner(self) -> Integers:
        """(3 m,) the triangle of each side."""
        return np.tile(np.arange(len(self.sides) // 3), 3)

    @property
    def upward(self) -> NDArray[np.bool_]:
        """(3 m,) whether each side runs from its lower point to its higher."""
        return np.asarray(self.sides[:, 0] < self.sides[:, 1])

    def pairs(self, shared_by: NDArray[np.bool_]) -> tuple[Integers, Integers]:
        """Sides one after the other at the chosen edges (e,): at an edge of two triangles one pair, of three two."""
        after = np.flatnonzero(np.diff(self.number[self.order]) == 0)
        after = after[shared_by[self.number[self.order[after]]]]
        return self.order[after], self.order[after + 1]

    def connected(self, shared_by: NDArray[np.bool_]) -> Integers:
        """Number (m,) of the piece of each triangle, where triangles hang together across the chosen edges (e,)."""
        one, other = self.pairs(shared_by)
        m = len(self.sides) // 3
        graph = coo_array((np.ones(len(one)), (one % m, other % m)), shape=(m, m))
        return np.asarray(connected_components(graph, directed=False)[1])


def find_edges(triangles: Integers) -> Edges:
    """Number the edges of triangles (m, 3)."""
    sides = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    key = sides.min(axis=1) * (int(triangles.max(initial=0)) + 1) + sides.max(axis=1)
    _, number, count = np.unique(key, return_inverse=True, return_counts=True)
    number = number.reshape(-1)
    order = np.argsort(number, kind="stable")
    return Edges(sides, number, count, order, np.concatenate([[0], np.cumsum(count)[:-1]]))
