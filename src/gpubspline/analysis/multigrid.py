"""Multigrid for structured hex8 meshes, the preconditioner whose iterations hardly grow with refinement.

The stiffness is gathered into one 3 x 3 block for each pair of neighbouring nodes; coarse grids take every second node
of the directions in which nodes lie close, and their matrices are P^T S P with linear interpolation P in the grid's
indices, so that they are positive definite whatever the shape of coarse elements. Each grid is smoothed by Chebyshev's
iteration over the nodes' own blocks; the coarsest is solved directly. All of it may be in float32: it only steers the
conjugate gradients, which work in float64.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from gpubspline.analysis.krylov import Vectors
from gpubspline.analysis.stiffness import Stiffness
from gpubspline.device import Buffer, Device

SMOOTHINGS = 4
"""Steps of Chebyshev's iteration before and after the coarse grid, an even number."""
DAMPED = 20.0
"""The ratio of eigenvalues over which they damp."""
POWERS = 12
"""Iterations that find the largest eigenvalue, and what is added for their error:"""
MARGIN = 1.15
CYCLES = 2
"""Of each grid after the first, for one of the grid before it, where there are more than"""
FEW = 4
"""grids."""
DIRECT = 500
"""Nodes that are solved directly."""
CLOSE = 1.7
"""Directions are coarsened whose nodes lie closer than this, times the closest direction."""

Counts = tuple[int, int, int]


@dataclass(frozen=True, eq=False)
class Transfer:
    """From a grid to a coarser one and back; arrays of the three directions one after another.

    Attributes
    ----------
    counts: coarse nodes per direction.
    centre: of each coarse node the fine one at its place.
    side: of each coarse node the values of its function at the fine nodes before and after it.
    below, above: of each fine node the coarse one at or before it, and the share of the one after.
    """

    counts: Counts
    centre: Buffer
    side: Buffer
    below: Buffer
    above: Buffer


@dataclass(frozen=True, eq=False)
class Grid:
    """One level: its matrix, its vectors and the way to the next coarser grid."""

    device: Device
    counts: Counts
    stencil: Buffer
    inverse: Buffer
    free: Buffer
    largest: float
    transfer: Transfer | None

    @property
    def n(self) -> int:
        """Number of nodes."""
        return int(np.prod(self.counts))

    @property
    def pad(self) -> int:
        """Zeros before and after each plane of a vector."""
        return self.counts[0] * self.counts[1] + self.counts[0] + 1

    @property
    def padded(self) -> int:
        """Length of a vector."""
        return 3 * (self.n + self.pad) + self.pad

    @cached_property
    def vectors(self) -> tuple[Buffer, Buffer, Buffer, Buffer]:
        """The right side b, the solution x, the next one d and the defect r."""
        b, x, d, r = (self.device.put(np.zeros(self.padded, self.device.real)) for _ in range(4))
        return b, x, d, r

    def smooth(self, still: bool) -> None:
        """Chebyshev's iteration on x; where ``still``, from x = 0, whatever it was.

        It is Richardson's with the inverse roots of Chebyshev's polynomial for steps, so few that their order does not
        matter, and even in number: x and d change places at each.
        """
        b, x, d, _ = self.vectors
        middle, reach = self.largest * (1 + 1 / DAMPED) / 2, self.largest * (1 - 1 / DAMPED) / 2
        for number in range(SMOOTHINGS):
            root = middle - reach * np.cos((2 * number + 1) * np.pi / (2 * SMOOTHINGS))
            self.step(b, x, d, 1 / root, still=still and number == 0)
            x, d = d, x

    def defect(self, b: Buffer, x: Buffer, r: Buffer) -> None:
        """R = b - S x."""
        self.device.launch("stencil.defect", self.n, self.stencil, b, x, *self.counts[:2], self.n, self.pad, r)

    def read(self, vector: Buffer) -> NDArray[Any]:
        """Components (3, n) of a vector."""
        return self._planes(np.asarray(self.device.get(vector)))

    def write(self, vector: Buffer, values: NDArray[Any]) -> None:
        """Set a vector to components (3, n)."""
        flat = np.zeros(self.padded, self.device.real)
        self._planes(flat)[:] = values
        self.device.launch("vectors.combine", self.padded, self.device.put(flat), 1.0, 0.0, self.padded, vector)

    def _planes(self, flat: NDArray[Any]) -> NDArray[Any]:
        return flat[self.pad :].reshape(3, self.n + self.pad)[:, : self.n]

    def step(self, b: Buffer, x: Buffer, out: Buffer, step: float, keep: float = 1.0, still: bool = False) -> None:
        """Out = keep x + step B (b - S x); where ``still``, x is 0."""
        how = (int(still), keep, float(step), *self.counts[:2], self.n, self.pad, out)
        self.device.launch("stencil.smooth", self.n, self.stencil, self.inverse, b, x, *how)


def _stencil_size(counts: Counts) -> int:
    return -(-int(np.prod(counts)) // 8) * 8 * 243


@dataclass(frozen=True, eq=False)
class Multigrid:
    """Grids from fine to coarse, and the inverse (3 n, 3 n) of the coarsest's matrix."""

    grids: list[Grid]
    coarsest: NDArray[Any]

    def cycle(self, r: NDArray[Any]) -> NDArray[Any]:
        """Apply one V-cycle to a residual (3, n); gives the correction (3, n)."""
        finest = self.grids[0]
        finest.write(finest.vectors[0], r)
        self.descend()
        return finest.read(finest.vectors[1])

    def descend(self, level: int = 0) -> None:
        """Make the x of a grid, the finest one, the correction of its b, a V-cycle or W-cycle.

        Where grids are many, those after the first cycle twice: once alone lets the iterations grow with their number.
        """
        grid = self.grids[level]
        cycles = CYCLES if level and len(self.grids) > FEW else 1
        if level == len(self.grids) - 1:
            b, x, *_ = grid.vectors
            grid.write(x, (self.coarsest @ grid.read(b).ravel()).reshape(3, -1))
            return
        for cycle in range(cycles):
            grid.smooth(still=cycle == 0)
            _restrict(grid, self.grids[level + 1])
            self.descend(level + 1)
            _prolong(self.grids[level + 1], grid)
            grid.smooth(still=False)


def _restrict(grid: Grid, coarser: Grid) -> None:
    b, x, _, r = grid.vectors
    way = grid.transfer
    assert way is not None
    grid.defect(b, x, r)
    fine, coarse = (*grid.counts[:2], grid.n, grid.pad), (*coarser.counts[:2], coarser.n, coarser.pad)
    where = (way.centre, way.side, grid.free, coarser.vectors[0])
    grid.device.launch("stencil.restrict_vector", (3, coarser.n), r, *fine, *coarse, *where)


def _prolong(coarser: Grid, grid: Grid) -> None:
    way = grid.transfer
    assert way is not None
    coarse, fine = (*coarser.counts[:2], coarser.n, coarser.pad), (*grid.counts[:2], grid.n, grid.pad)
    where = (way.below, way.above, grid.free)
    grid.device.launch("stencil.prolong", (3, grid.n), coarser.vectors[1], *coarse, *where, *fine, grid.vectors[1])


def multigrid(k: Stiffness, counts: Counts, points: NDArray[Any], held: NDArray[np.bool_]) -> Multigrid:
    """Make the grids of a structured hex8 mesh.

    Arguments
    ---------
    k: its stiffness, on the device that is to work.
    counts: nodes per direction; points: (n, 3), mm; held: (n, 3), which directions are.
    """
    free = k.device.put(np.ascontiguousarray(~held.T, dtype=np.float64))
    stencil = _assemble(k, counts, free)
    spacing = _spacing(counts, points)
    grids: list[Grid] = []
    while True:
        way, spacing = _transfer(k.device, counts, spacing)
        grids.append(_grid(k.device, counts, stencil, way))
        if way is None:
            break
        stencil = _coarsen(grids[-1], way)
        counts = way.counts
    return Multigrid(grids, _inverse(grids[-1]))


def _assemble(k: Stiffness, counts: Counts, free: Buffer) -> Buffer:
    """Gather the element forces of unit displacements, of each parity and direction."""
    stencil = k.device.put(np.zeros(_stencil_size(counts), k.device.real))
    index = np.indices(counts[::-1]).reshape(3, -1)[::-1]
    colour = (index[0] & 1) + 2 * (index[1] & 1) + 4 * (index[2] & 1)
    for parity in range(8):
        for column in range(3):
            displacement = np.zeros((3, len(colour)), k.device.real)
            displacement[column] = colour == parity
            k.element_forces(k.device.put(displacement))
            where = (k.forces, *counts, parity, column, free, stencil)
            k.device.launch("stencil.add_forces", len(colour), *where)
    k.device.wait()
    return stencil


def _spacing(counts: Counts, points: NDArray[Any]) -> list[float]:
    """Mean distance of neighbours along each direction, mm."""
    grid = points.reshape(*counts[::-1], 3)
    return [float(np.linalg.norm(np.diff(grid, axis=axis), axis=-1).mean()) for axis in (2, 1, 0)]


def _transfer(device: Device, counts: Counts, spacing: list[float]) -> tuple[Transfer | None, list[float]]:
    """Coarsen the directions in which nodes lie close; None where the grid is small enough to be solved directly."""
    if np.prod(counts) <= DIRECT:
        return None, spacing
    least = min(size for size, n in zip(spacing, counts, strict=True) if n > 2)
    halved = [n > 2 and size < CLOSE * least for size, n in zip(spacing, counts, strict=True)]
    centres = [_centres(n) if half else np.arange(n) for n, half in zip(counts, halved, strict=True)]
    sides, below, above = [], [], []
    for n, centre in zip(counts, centres, strict=True):
        gap = np.diff(centre) == 2
        sides.append(np.stack([np.append(False, gap), np.append(gap, False)], axis=1).ravel() * 0.5)
        below.append(np.searchsorted(centre, np.arange(n), side="right") - 1)
        above.append(np.where(centre[below[-1]] < np.arange(n), 0.5, 0.0))
    coarse = (len(centres[0]), len(centres[1]), len(centres[2]))
    arrays = [device.put(np.concatenate(rows)) for rows in (centres, sides, below, above)]
    return Transfer(coarse, *arrays), [2 * size if half else size for size, half in zip(spacing, halved, strict=True)]


def _centres(n: int) -> NDArray[Any]:
    """Every second node and the last."""
    return np.unique(np.append(np.arange(0, n, 2), n - 1))


def _grid(device: Device, counts: Counts, stencil: Buffer, way: Transfer | None) -> Grid:
    n = int(np.prod(counts))
    blocks, inverse = device.empty((6, n)), device.empty((6, n))
    device.launch("stencil.own_blocks", n, stencil, n, blocks)
    free = device.put((device.get(blocks)[:3] > 0).astype(device.real))
    device.launch("nodal.invert_blocks", n, blocks, free, n, inverse)
    grid = Grid(device, counts, stencil, inverse, free, 1.0, way)
    return Grid(device, counts, stencil, inverse, free, _largest(grid), way) if way else grid


def _largest(grid: Grid) -> float:
    """The largest eigenvalue of B S, by powers."""
    nothing, x, d, _ = grid.vectors
    vectors, size = Vectors(grid.device, grid.padded), 1.0
    grid.write(x, np.random.default_rng(0).standard_normal((3, grid.n)))
    for _ in range(POWERS):
        vectors.combine(x, 1 / np.sqrt(vectors.dot(x, x)), 0.0, d)
        grid.step(nothing, d, x, -1.0, keep=0.0)
        size = float(np.sqrt(vectors.dot(x, x)))
    return MARGIN * size


def _coarsen(grid: Grid, way: Transfer) -> Buffer:
    """P^T S P, one direction after another: each makes the next one's work less."""
    counts, stencil, begin = grid.counts, grid.stencil, 0
    for axis, count in enumerate(way.counts):
        if count < counts[axis]:
            u, v, w = (count if d == axis else counts[d] for d in range(3))
            after = (u, v, w)
            coarse = grid.device.put(np.zeros(_stencil_size(after), grid.device.real))
            where = (*counts, axis, count, begin, way.centre, way.side, coarse)
            grid.device.launch("stencil.coarsen", (27, int(np.prod(after))), stencil, *where)
            counts, stencil = after, coarse
        begin += count
    return stencil


def _inverse(grid: Grid) -> NDArray[Any]:
    """Inverse (3 n, 3 n) of the grid's matrix, 0 where a direction is not free."""
    n, (n_u, n_v, n_w) = grid.n, grid.counts
    tiles = np.asarray(grid.device.get(grid.stencil), dtype=np.float64).reshape(-1, 27, 3, 3, 8)
    entries = tiles.transpose(1, 2, 3, 0, 4).reshape(27, 3, 3, -1)[..., :n]
    matrix = np.zeros((3, n, 3, n))
    index = np.indices((n_w, n_v, n_u)).reshape(3, -1)
    for o in range(27):
        at = index + np.array([[o // 9 - 1], [o // 3 % 3 - 1], [o % 3 - 1]])
        inside = np.flatnonzero(np.all((at >= 0) & (at < [[n_w], [n_v], [n_u]]), axis=0))
        other = np.ravel_multi_index(tuple(at[:, inside]), (n_w, n_v, n_u))
        for row in range(3):
            for column in range(3):
                matrix[row, inside, column, other] = entries[o, row, column, inside]
    flat = matrix.reshape(3 * n, 3 * n)
    used = np.asarray(grid.device.get(grid.free)).ravel() > 0
    found = np.zeros(flat.shape, grid.device.real)
    part = flat[np.ix_(used, used)]
    found[np.ix_(used, used)] = linalg.inv((part + part.T) / 2)
    return found
