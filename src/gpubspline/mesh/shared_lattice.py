"""Lattices inside hexes that meet: what lies on a shared corner, edge or face has one number for all its hexes.

A lattice of degree d has (d + 1)^3 points in each hex. Its points are numbered corners first, as the hexes number
them, then edges, faces and insides. Control points of Bezier blocks, midway nodes of hex20 and hex27 and the nodes of a
refined mesh are all such lattices.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import NDArray

from gpubspline.mesh.elements import ELEMENTS

Integers = NDArray[np.int64]

_HEX20 = ELEMENTS["hex20"].vertices
CORNERS = np.array(_HEX20[:8]) // 2
"""(8, 3) place of each corner, 0 or 1 along u, v, w."""

_MIDWAY = np.array(_HEX20[8:])
EDGE_AXES = np.argmax(_MIDWAY == 1, axis=1)
_EDGE_STARTS = np.where(_MIDWAY == 1, 0, _MIDWAY // 2)
FACES = tuple((axis, side) for axis in range(3) for side in (0, 1))
"""Axis that each face is across, and 0 or 1 for its end."""


def _corner_at(place: NDArray[np.int64]) -> int:
    return int(np.flatnonzero((place == CORNERS).all(axis=1))[0])


_EDGE_CORNERS = np.array(
    [
        (_corner_at(start), _corner_at(start + np.eye(3, dtype=int)[axis]))
        for start, axis in zip(_EDGE_STARTS, EDGE_AXES, strict=True)
    ]
)
_AROUND = ((0, 0), (1, 0), (1, 1), (0, 1))


def _face_corners(axis: int, side: int) -> list[int]:
    return [_corner_at(np.insert(np.array(at), axis, side)) for at in _AROUND]


_FACE_CORNERS = np.array([_face_corners(*face) for face in FACES])


@dataclass(frozen=True, eq=False)
class SharedLattice:
    """The lattice of one degree in all hexes of a mesh.

    Attributes
    ----------
    hexes: (m, 8) corner numbers, VTK's order.
    n_corners: corners of the mesh.
    degree: d, at least 1.
    """

    hexes: Integers
    n_corners: int
    degree: int

    @cached_property
    def edges(self) -> tuple[Integers, Integers]:
        """(e, 2) corners of each edge, the lower number first, and (m, 12) the number of each hex's edges."""
        ends = np.sort(self.hexes[:, _EDGE_CORNERS], axis=2)
        keys, number = np.unique(ends[..., 0] * self.n_corners + ends[..., 1], return_inverse=True)
        return np.stack(np.divmod(keys, self.n_corners), axis=1), number.reshape(-1, 12)

    @cached_property
    def faces(self) -> tuple[Integers, Integers]:
        """(f,) how many hexes have each face, and (m, 6) the number of each hex's faces."""
        corners = np.sort(self.hexes[:, _FACE_CORNERS], axis=2).astype(np.int64)
        _, pair = np.unique(corners[..., 0] * self.n_corners + corners[..., 1], return_inverse=True)
        keys = pair.reshape(corners.shape[:2]) * self.n_corners + corners[..., 2]  # three corners tell a face
        _, number, count = np.unique(keys, return_inverse=True, return_counts=True)
        return count, number.reshape(-1, 6)

    @property
    def starts(self) -> tuple[int, int, int, int]:
        """Number of the first point on edges, on faces and inside, and of all points."""
        between = self.degree - 1
        on_edges = self.n_corners
        on_faces = on_edges + len(self.edges[0]) * between
        inside = on_faces + len(self.faces[0]) * between**2
        return on_edges, on_faces, inside, inside + len(self.hexes) * between**3

    @cached_property
    def numbers(self) -> Integers:
        """(m, d + 1, d + 1, d + 1) number of each hex's lattice points along u, v, w."""
        d, m = self.degree, len(self.hexes)
        numbers = np.empty((m, d + 1, d + 1, d + 1), dtype=np.int64)
        for corner, (a, b, c) in enumerate(CORNERS * d):
            numbers[:, a, b, c] = self.hexes[:, corner]
        if d == 1:
            return numbers
        on_edges, on_faces, inside, _ = self.starts
        for edge, (start, axis) in enumerate(zip(_EDGE_STARTS * d, EDGE_AXES, strict=True)):
            at = (slice(None), *(slice(1, d) if i == axis else int(start[i]) for i in range(3)))
            numbers[at] = on_edges + self.edges[1][:, edge, None] * (d - 1) + self._along(edge)
        for face, (axis, side) in enumerate(FACES):
            at = (slice(None), *(side * d if i == axis else slice(1, d) for i in range(3)))
            numbers[at] = on_faces + self.faces[1][:, face, None, None] * (d - 1) ** 2 + self._within(face)
        own = np.arange(m)[:, None] * (d - 1) ** 3 + np.arange((d - 1) ** 3)
        numbers[:, 1:d, 1:d, 1:d] = inside + own.reshape(m, d - 1, d - 1, d - 1)
        return numbers

    @property
    def corners(self) -> Integers:
        """(m, 2, 2, 2) corners of each hex along u, v, w."""
        return np.asarray(self.numbers[:, :: self.degree, :: self.degree, :: self.degree])

    @cached_property
    def on_boundary(self) -> NDArray[np.bool_]:
        """(n,) whether each point lies on a face that one hex alone has."""
        marked = np.zeros(self.starts[-1], dtype=bool)
        for face, (axis, side) in enumerate(FACES):
            outer = self.faces[0][self.faces[1][:, face]] == 1
            marked[np.take(self.numbers[outer], side * self.degree, axis=1 + axis)] = True
        return marked

    def _along(self, edge: int) -> Integers:
        """(m, d - 1) order of an edge's points, which is counted from its lower corner."""
        first, last = self.hexes[:, _EDGE_CORNERS[edge]].T
        upward = np.arange(self.degree - 1)
        return np.where((first < last)[:, None], upward, upward[::-1])

    def _within(self, face: int) -> Integers:
        """(m, d - 1, d - 1) order of a face's points, counted from its lowest corner, first to its lower neighbour."""
        around = self.hexes[:, _FACE_CORNERS[face]]
        lowest = np.argmin(around, axis=1)
        after, before = (np.take_along_axis(around, (lowest[:, None] + step) % 4, axis=1)[:, 0] for step in (1, 3))
        return np.asarray(_face_orders(self.degree)[lowest, (before < after).astype(int)])


def _face_orders(degree: int) -> Integers:
    """(4, 2, d - 1, d - 1) order of a face's inner points for each lowest corner, and each of its lower neighbours."""
    inner = np.arange(1, degree)
    orders = np.empty((4, 2, degree - 1, degree - 1), dtype=np.int64)
    for lowest, turned in product(range(4), (0, 1)):
        origin = np.array(_AROUND[lowest])
        one, other = (np.array(_AROUND[(lowest + step) % 4]) - origin for step in ((3, 1) if turned else (1, 3)))
        first, second = (values.ravel() for values in np.meshgrid(inner, inner, indexing="ij"))
        s, t = origin[:, None] * degree + one[:, None] * first + other[:, None] * second
        orders[lowest, turned, s - 1, t - 1] = np.arange((degree - 1) ** 2)
    return orders
