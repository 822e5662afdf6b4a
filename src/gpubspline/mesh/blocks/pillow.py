"""From core cells to hexes: the cells, and one layer grown from their boundary outward, the pillow.

Several bodies that touch first get a layer each on their faces towards all others. It ends on the outer surface, which
gets its layer last, so that no outer face has two edges on the curve where an interface ends.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.mesh.blocks.core import Cells

Owners = NDArray[np.int8]

_CORNERS = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1))
"""Lattice steps i, j, k of the vertices of a hex, in VTK's order."""

_FACES = np.array(((0, 4, 7, 3), (1, 2, 6, 5), (0, 1, 5, 4), (3, 7, 6, 2), (0, 3, 2, 1), (4, 5, 6, 7)))
"""Vertices of each face, counter-clockwise seen from outside."""


@dataclass(frozen=True, eq=False)
class Pillowed:
    """Hexes of a core and its pillow, as they are before any node has moved.

    Nodes inside bodies come first, then those of the surface and of interfaces; both in the order of the lattice.

    Attributes
    ----------
    points: (n, 3) float64, lattice coordinates.
    cells: (m, 8) int32 in VTK's order, the core's first.
    owners: (m,) int8 body of each hex, from 1.
    n_core: nodes inside bodies.
    quads: (f, 4) int32 outward faces of the surface.
    interfaces: (g, 4) int32 faces between bodies, outward from the body of the lower number.
    sides: (g, 2) int8 the bodies that each of these lies between, the lower first.
    bodies: (n,) bodies that each node belongs to, as bits; the lowest bit for the surface.
    colours: (n,) from 0; nodes of one colour share no hex.
    """

    points: NDArray[np.float64]
    cells: NDArray[np.int32]
    owners: Owners
    n_core: int
    quads: NDArray[np.int32]
    interfaces: NDArray[np.int32]
    sides: Owners
    bodies: NDArray[np.int64]
    colours: NDArray[np.int8]

    @property
    def n_nodes(self) -> int:
        """Number of nodes."""
        return len(self.points)


@dataclass(eq=False)
class _Layered:
    """Hexes that gain layers: node numbers (m, 8), owners (m,), and each node's lattice vertex and copy of it."""

    cells: NDArray[np.int64]
    owners: Owners
    vertex: NDArray[np.int64]
    copy: NDArray[np.int64]

    def faces(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """(6 m, 4) faces of all hexes, by face, then hex, and (6 m,) the hex beyond each, -1 outside."""
        faces = np.concatenate([self.cells[:, face] for face in _FACES])
        corners = np.sort(faces, axis=1)
        n = len(self.vertex)
        _, pair = np.unique(corners[:, 0] * n + corners[:, 1], return_inverse=True)
        order = np.argsort(pair * n + corners[:, 2], kind="stable")  # three corners tell a face
        key = (pair * n + corners[:, 2])[order]
        beyond = np.full(len(faces), -1)
        first = np.flatnonzero(key[1:] == key[:-1])
        one, other = order[first], order[first + 1]
        beyond[one], beyond[other] = other % len(self.cells), one % len(self.cells)
        return faces, beyond

    def shrink(self, within: NDArray[np.bool_], chosen: NDArray[np.bool_], faces: NDArray[np.int64]) -> None:
        """Take the hexes ``within`` (m,) back from ``chosen`` ones of their faces, and fill the gap with a layer."""
        quads = faces[chosen]
        opened = np.unique(quads)
        renumbered = np.arange(len(self.vertex))
        renumbered[opened] = len(self.vertex) + np.arange(len(opened))
        inner = renumbered[quads]
        new_owners = np.tile(self.owners, 6)[chosen]
        self.cells[within] = renumbered[self.cells[within]]
        self.cells = np.concatenate([self.cells, np.concatenate([inner, quads], axis=1)])
        self.owners = np.concatenate([self.owners, new_owners])
        copied = self.vertex[opened]
        self.copy = np.concatenate([self.copy, np.bincount(self.vertex)[copied] + _earlier(copied)])
        self.vertex = np.concatenate([self.vertex, copied])

    def part(self, group: NDArray[np.bool_], other: NDArray[np.bool_]) -> None:
        """Grow a layer inside the group (m,) on its faces towards the other (m,)."""
        faces, beyond = self.faces()
        chosen = np.tile(group, 6) & (beyond >= 0) & other[beyond]
        if chosen.any():
            self.shrink(group, chosen, faces)


def pillow(cells: Cells | Owners) -> Pillowed:
    """Grow a layer of hexes on a repaired core (n_k, n_j, n_i), which leaves the border free.

    ``cells``: whether each lattice cell is inside, or the body it belongs to, 0 outside.
    """
    owner_of = np.asarray(cells, dtype=np.int8)
    lattice = tuple(n + 1 for n in cells.shape)
    inside = np.stack(np.nonzero(owner_of), axis=1)[:, ::-1]  # i, j, k
    corners = _vertex_numbers(inside[:, None, :] + np.array(_CORNERS), lattice)
    used, numbers = np.unique(corners, return_inverse=True)
    owners = owner_of[owner_of != 0]
    made = _Layered(numbers.reshape(-1, 8), owners, np.arange(len(used)), np.zeros(len(used), dtype=np.int64))
    several = int(owners.max()) > 1
    for body in range(1, int(owners.max()) + 1) if several else ():
        made.part(made.owners == body, made.owners != body)
    faces, beyond = made.faces()
    made.shrink(np.ones(len(made.cells), dtype=bool), beyond < 0, faces)
    at = np.stack(np.unravel_index(used, lattice), axis=1)[:, ::-1]
    return _numbered(made, at)


def _numbered(made: _Layered, at: NDArray[np.int64]) -> Pillowed:
    """Number nodes anew, inside first; ``at`` (vertices, 3) is where the lattice vertices are."""
    faces, beyond = made.faces()
    own = np.tile(made.owners, 6)
    outside = beyond < 0
    between = ~outside & (own < made.owners[beyond])
    bodies = np.zeros(len(made.vertex), dtype=np.int64)
    np.bitwise_or.at(bodies, made.cells.ravel(), np.repeat(np.int64(1) << made.owners.astype(np.int64), 8))
    bodies[faces[outside]] |= 1
    held = (bodies & (bodies - 1)) != 0
    order = np.lexsort((made.copy, made.vertex, held))
    number = np.empty(len(order), dtype=np.int32)
    number[order] = np.arange(len(order), dtype=np.int32)
    points, copy = at[made.vertex[order]], made.copy[order]
    return Pillowed(
        points=points.astype(np.float64),
        cells=number[made.cells],
        owners=made.owners,
        n_core=int(np.count_nonzero(~held)),
        quads=number[faces[outside]],
        interfaces=number[faces[between]],
        sides=np.stack([own[between], made.owners[beyond[between]]], axis=1),
        bodies=bodies[order],
        colours=((points & 1) @ np.array([1, 2, 4]) + 8 * copy).astype(np.int8),
    )


def _earlier(values: NDArray[np.int64]) -> NDArray[np.int64]:
    """(n,) how many times each value has stood before."""
    order = np.argsort(values, kind="stable")
    first = np.searchsorted(values[order], values)
    place = np.empty(len(values), dtype=np.int64)
    place[order] = np.arange(len(values))
    return place - first


def count_hexes(cells: Cells) -> int:
    """How many hexes the pillowed core will have."""
    faces = 0
    for axis in range(3):
        low = np.moveaxis(np.pad(cells, 1), axis, 0)
        faces += int(np.count_nonzero(low[:-1] != low[1:]))
    return int(np.count_nonzero(cells)) + faces


def _vertex_numbers(at: NDArray[Any], lattice: tuple[int, ...]) -> NDArray[Any]:
    _, n_j, n_i = lattice
    return np.asarray((at[..., 2] * n_j + at[..., 1]) * n_i + at[..., 0])
