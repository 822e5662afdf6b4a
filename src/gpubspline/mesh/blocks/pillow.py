"""From core cells to hexes: the cells, and one layer grown from their boundary outward, the pillow."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.mesh.blocks.core import Cells

_CORNERS = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1))
"""Lattice steps i, j, k of the vertices of a hex, in VTK's order."""

_FACES = {
    (-1, 0, 0): (0, 4, 7, 3),
    (1, 0, 0): (1, 2, 6, 5),
    (0, -1, 0): (0, 1, 5, 4),
    (0, 1, 0): (3, 7, 6, 2),
    (0, 0, -1): (0, 3, 2, 1),
    (0, 0, 1): (4, 5, 6, 7),
}
"""Vertices of each face, counter-clockwise seen from outside."""


@dataclass(frozen=True, eq=False)
class Pillowed:
    """Hexes of a core and its pillow, as they are before any node has moved.

    Nodes of the core come first, in the order of the lattice, then those of the surface, one for each node of the
    core's boundary and at the same place.

    Attributes
    ----------
    points: (n, 3) float64, lattice coordinates.
    cells: (m, 8) int32 in VTK's order, the core's first.
    n_core: nodes of the core.
    below: (n - n_core,) the core's node under each node of the surface.
    quads: (f, 4) int32 outward faces of the surface.
    colours: (n,) 0 to 15; nodes of one colour share no hex.
    """

    points: NDArray[np.float64]
    cells: NDArray[np.int32]
    n_core: int
    below: NDArray[np.int64]
    quads: NDArray[np.int32]
    colours: NDArray[np.int8]

    @property
    def n_nodes(self) -> int:
        """Number of nodes."""
        return len(self.points)


def pillow(cells: Cells) -> Pillowed:
    """Grow a layer of hexes on a repaired core (n_k, n_j, n_i), which leaves the border free."""
    lattice = tuple(n + 1 for n in cells.shape)
    inside = np.stack(np.nonzero(cells), axis=1)[:, ::-1]  # i, j, k
    corners = _vertex_numbers(inside[:, None, :] + np.array(_CORNERS), lattice)
    used, numbers = np.unique(corners, return_inverse=True)
    core = numbers.reshape(-1, 8).astype(np.int32)
    inner = np.concatenate(
        [core[_open_towards(cells, inside, step)][:, face] for step, face in _FACES.items()], dtype=np.int32
    )
    below = np.unique(inner)
    above = np.full(len(used), -1, dtype=np.int32)
    above[below] = len(used) + np.arange(len(below), dtype=np.int32)
    at = np.stack(np.unravel_index(used, lattice), axis=1)[:, ::-1]
    colour = (at & 1) @ np.array([1, 2, 4])
    return Pillowed(
        points=np.concatenate([at, at[below]]).astype(np.float64),
        cells=np.concatenate([core, np.concatenate([inner, above[inner]], axis=1)]),
        n_core=len(used),
        below=below.astype(np.int64),
        quads=above[inner],
        colours=np.concatenate([colour, 8 + colour[below]]).astype(np.int8),
    )


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


def _open_towards(cells: Cells, inside: NDArray[Any], step: tuple[int, int, int]) -> NDArray[np.bool_]:
    i, j, k = (inside + np.array(step)).T
    return np.asarray(~cells[k, j, i])
