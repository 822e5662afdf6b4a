"""Points inside the sections: a square in the middle, and rings from it to the contour.

       ring of P = 2 (U - 1) + 2 (V - 1) places, counter-clockwise from the square's corner (0, 0)

+-----------------+          v1      square: U x V points
| \\             / |       +------+   ring:   P x R points, the first of them those of the square's border
|   +---------+   |    u0 |      | u1
|   |         |   |       |      |   blocks round it: v0 (u from 0 up), u1, v1, u0, each between two of the
|   +---------+   |       +------+   square's corners and the contour
| /             \\ |          v0
+-----------------+
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.linalg import splu

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

INNER = 0.5
"""Size of the square in the contour's, for transfinite placement."""

ROUND = 0.5
"""How far its sides go from straight to the contour's own shape."""


@dataclass(frozen=True)
class Layout:
    """Numbers of the points of a section.

    Attributes
    ----------
    u, v: points along the square's sides.
    r: points from the square to the contour, both included.
    """

    u: int
    v: int
    r: int

    @property
    def around(self) -> int:
        """Points along the contour."""
        return 2 * (self.u + self.v - 2)

    @property
    def count(self) -> int:
        """Points of a section."""
        return self.u * self.v + self.around * (self.r - 1)

    @cached_property
    def square(self) -> Integers:
        """(u, v) numbers of the square's points."""
        return np.arange(self.u * self.v).reshape(self.u, self.v)

    @cached_property
    def ring(self) -> Integers:
        """(around, r) numbers of the points from the square's border to the contour."""
        s = self.square
        border = np.concatenate([s[:-1, 0], s[-1, :-1], s[:0:-1, -1], s[0, :0:-1]])
        outer = self.u * self.v + np.arange(self.around * (self.r - 1)).reshape(self.r - 1, self.around).T
        return np.concatenate([border[:, None], outer], axis=1)

    @property
    def blocks(self) -> dict[str, Integers]:
        """Numbers of the points of the five blocks: ``centre`` (u, v), the others (r, along the side)."""
        closed = np.vstack([self.ring, self.ring[:1]])
        ends = np.cumsum([0, self.u - 1, self.v - 1, self.u - 1, self.v - 1])
        sides = {name: closed[ends[n] : ends[n + 1] + 1].T for n, name in enumerate(("v0", "u1", "v1", "u0"))}
        return {"centre": self.square, **sides}

    @cached_property
    def quads(self) -> Integers:
        """(q, 4) counter-clockwise corners of the section's quads."""
        s, closed = self.square, np.vstack([self.ring, self.ring[:1]])
        inner = np.stack([s[:-1, :-1], s[1:, :-1], s[1:, 1:], s[:-1, 1:]], axis=-1).reshape(-1, 4)
        outer = np.stack([closed[:-1, :-1], closed[:-1, 1:], closed[1:, 1:], closed[1:, :-1]], axis=-1).reshape(-1, 4)
        return np.concatenate([inner, outer])


def harmonic(layout: Layout, border: Floats) -> Floats:
    """Place every point in the middle of its neighbours, all contours at once.

    Within a convex contour no quad folds (Tutte 1963); rings grow outwards in proportion to their size, as a conformal
    map would have it.

    Arguments
    ---------
    border: (around, l, 2) points on the contours.

    Returns: (count, l, 2).
    """
    edges = np.sort(np.concatenate([layout.quads[:, [a, (a + 1) % 4]] for a in range(4)]), axis=1)
    i, j = np.unique(edges, axis=0).T
    both = np.concatenate([i, j]), np.concatenate([j, i])
    weights = coo_array((np.ones(2 * len(i)), both), shape=(layout.count,) * 2).tocsc()
    fixed = layout.ring[:, -1]
    free = np.setdiff1d(np.arange(layout.count), fixed)
    system = coo_array((weights.sum(axis=1)[free], (np.arange(len(free)),) * 2)).tocsc() - weights[free][:, free]
    right = weights[free][:, fixed] @ border.reshape(len(fixed), -1)
    placed = np.empty((layout.count, *border.shape[1:]))
    placed[fixed] = border
    placed[free] = splu(system.tocsc()).solve(right).reshape(len(free), *border.shape[1:])
    return placed


def transfinite(layout: Layout, border: Floats) -> Floats:
    """Place the square at half the contour's size, its inside and the rings by blending (Gordon and Hall 1973).

    Arguments and result as of ``harmonic``.
    """
    u, v = layout.u - 1, layout.v - 1
    centre = border.mean(axis=0)
    scaled = centre + INNER * (border - centre)
    corners = np.cumsum([0, u, v, u, v])
    square = np.empty_like(scaled)
    for first, last in pairwise(corners.tolist()):
        t = np.linspace(0, 1, last - first, endpoint=False)[:, None, None]
        chord = (1 - t) * scaled[first] + t * scaled[last % layout.around]
        square[first:last] = (1 - ROUND) * chord + ROUND * scaled[first:last]
    placed = np.empty((layout.count, *border.shape[1:]))
    share = np.linspace(0, 1, layout.r)[None, :, None, None]
    placed[layout.ring] = (1 - share) * square[:, None] + share * border[:, None]
    s = layout.square
    a, b = np.linspace(0, 1, u + 1)[:, None, None, None], np.linspace(0, 1, v + 1)[None, :, None, None]
    sides = {"v0": placed[s[:, 0]], "v1": placed[s[:, -1]], "u0": placed[s[0]], "u1": placed[s[-1]]}
    along_v = (1 - b) * sides["v0"][:, None] + b * sides["v1"][:, None]
    along_u = (1 - a) * sides["u0"][None] + a * sides["u1"][None]
    both = (1 - a) * (1 - b) * placed[s[0, 0]] + a * (1 - b) * placed[s[-1, 0]]
    both = both + (1 - a) * b * placed[s[0, -1]] + a * b * placed[s[-1, -1]]
    placed[s] = along_u + along_v - both
    return placed


def corner_sines(layout: Layout, placed: Floats) -> Floats:
    """Least sine of a corner of each quad (q, l) of points (count, l, 2): 1 where square, 0 or less where it folds."""
    corners = placed[layout.quads]
    after, before = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    cross = after[..., 0] * before[..., 1] - after[..., 1] * before[..., 0]
    length = np.linalg.norm(after, axis=-1) * np.linalg.norm(before, axis=-1)
    return np.asarray((cross / np.maximum(length, 1e-300)).min(axis=1))
