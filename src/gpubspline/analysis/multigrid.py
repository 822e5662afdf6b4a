"""Multigrid for structured hex8 meshes, the preconditioner whose iterations hardly grow with refinement.

The finest grid is the elements themselves, whose matrix is never formed, where their product is fast. Coarse grids take
every second node of the directions in which nodes lie close, and have one 3 x 3 block for each pair of neighbouring
nodes. Their matrices are P^T S P with linear interpolation P in the grid's indices, so that they are positive definite
whatever the shape of coarse elements. Each grid is smoothed by Chebyshev's iteration over the nodes' own blocks; the
coarsest is solved directly. All of it may be in float32: it only steers the conjugate gradients, which work in float64.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.analysis.banded import Banded, banded, bandwidth
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
DIRECT = 2_000_000
"""Numbers in the band of a matrix that is solved directly."""
CLOSE = 1.7
"""Directions are coarsened whose nodes lie closer than this, times the closest direction."""
SHORTEST = 0.05
"""Of an edge, in mean ones of its direction."""

TILE = 8
"""Nodes whose blocks lie together."""

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
    functions: of each direction the values (fine, coarse) of coarse nodes' functions, on the host.
    """

    counts: Counts
    centre: Buffer
    side: Buffer
    below: Buffer
    above: Buffer
    functions: list[NDArray[Any]]


@dataclass(frozen=True, eq=False)
class Grid(ABC):
    """One level: the inverse (6, n) of its nodes' own blocks, its vectors and the way to the next coarser grid."""

    device: Device
    counts: Counts
    inverse: Buffer
    free: Buffer
    transfer: Transfer | None
    largest: float

    @property
    def n(self) -> int:
        """Number of nodes."""
        return int(np.prod(self.counts))

    @property
    def pad(self) -> int:
        """Zeros before and after each plane of a vector."""
        return 0

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

    @abstractmethod
    def step(self, b: Buffer, x: Buffer, out: Buffer, step: float, keep: float = 1.0, still: bool = False) -> None:
        """Out = keep x + step B (b - S x); where ``still``, x is 0."""

    @abstractmethod
    def defect(self, b: Buffer, x: Buffer, r: Buffer) -> None:
        """R = b - S x."""

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


@dataclass(frozen=True, eq=False)
class Elements(Grid):
    """The finest grid."""

    k: Stiffness

    def step(self, b: Buffer, x: Buffer, out: Buffer, step: float, keep: float = 1.0, still: bool = False) -> None:
        """Out = keep x + step B (b - K x); where ``still``, x is 0."""
        y = self.vectors[3]
        if not still:
            self.k.apply(x, self.free, y)
        how = (int(still), keep, float(step), self.n, out)
        self.device.launch("stencil.relax", self.n, y, self.inverse, b, x, *how)

    def defect(self, b: Buffer, x: Buffer, r: Buffer) -> None:
        """R = b - K x."""
        self.k.apply(x, self.free, r)
        self.device.launch("vectors.combine", self.padded, b, 1.0, -1.0, self.padded, r)


@dataclass(frozen=True, eq=False)
class Blocks(Grid):
    """A grid of 27 blocks a node; see ``stencil.py``."""

    stencil: Buffer

    @property
    def pad(self) -> int:
        """Zeros before and after each plane of a vector."""
        return _pad(self.counts)

    def step(self, b: Buffer, x: Buffer, out: Buffer, step: float, keep: float = 1.0, still: bool = False) -> None:
        """Out = keep x + step B (b - S x); where ``still``, x is 0."""
        how = (int(still), keep, float(step), *self.counts[:2], self.n, self.pad, out)
        self.device.launch("stencil.smooth", _whole_tiles(self.n), self.stencil, self.inverse, b, x, *how)

    def defect(self, b: Buffer, x: Buffer, r: Buffer) -> None:
        """R = b - S x."""
        how = (*self.counts[:2], self.n, self.pad, r)
        self.device.launch("stencil.defect", _whole_tiles(self.n), self.stencil, b, x, *how)


def _pad(counts: Counts) -> int:
    """As far as neighbours lie, and a tile."""
    return counts[0] * counts[1] + counts[0] + TILE


def _whole_tiles(n: int) -> int:
    return -(-n // TILE) * TILE


def _stencil(device: Device, counts: Counts) -> Buffer:
    return device.put(np.zeros(243 * _whole_tiles(int(np.prod(counts))), device.real))


@dataclass(frozen=True, eq=False)
class Multigrid:
    """Grids from fine to coarse, and the factor of the coarsest's matrix."""

    grids: list[Grid]
    coarsest: Banded

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
            grid.write(x, self.coarsest.solve(grid.read(b)))
            return
        for cycle in range(cycles):
            grid.smooth(still=cycle == 0)
            _restrict(grid, self.grids[level + 1])
            self.descend(level + 1)
            _prolong(self.grids[level + 1], grid)
            grid.smooth(still=False)


def _restrict(grid: Grid, coarser: Grid) -> None:
    b, x, _, r = grid.vectors
    grid.defect(b, x, r)
    assert grid.transfer is not None
    _restrict_vector(grid, r, grid.transfer, coarser.vectors[0])


def _restrict_vector(grid: Grid, r: Buffer, way: Transfer, out: Buffer) -> None:
    fine, coarse = (*grid.counts[:2], grid.n, grid.pad), (*way.counts[:2], int(np.prod(way.counts)), _pad(way.counts))
    how = (*fine, *coarse, way.centre, way.side, out)
    grid.device.launch("stencil.restrict_vector", way.counts[::-1], r, *how)


def _prolong(coarser: Grid, grid: Grid) -> None:
    way = grid.transfer
    assert way is not None
    coarse, fine = (*coarser.counts[:2], coarser.n, coarser.pad), (*grid.counts[:2], grid.n, grid.pad)
    how = (*coarse, way.below, way.above, grid.free, *fine, grid.vectors[1])
    grid.device.launch("stencil.prolong", grid.counts[::-1], coarser.vectors[1], *how)


def multigrid(k: Stiffness, counts: Counts, points: NDArray[Any], held: NDArray[np.bool_]) -> Multigrid:
    """Make the grids of a structured hex8 mesh.

    Arguments
    ---------
    k: its stiffness, on the device that is to work.
    counts: nodes per direction; points: (n, 3), mm; held: (n, 3), which directions are.
    """
    free = k.device.put(np.ascontiguousarray(~held.T, dtype=np.float64))
    # elements whose product is slower than that of blocks are gathered in blocks at once
    close = 0.0 if k.structure is None else CLOSE
    way, spacing = _transfer(k.device, counts, _spacing(counts, points), close)
    finest = Elements(k.device, counts, k.inverse_blocks(free), free, way, 1.0, k)
    grids: list[Grid] = [replace(finest, largest=_largest(finest))] if close else []
    stencil = _products(finest, way, ~held.T)
    while not _is_direct(way.counts):
        counts = way.counts
        way, spacing = _transfer(k.device, counts, spacing)
        grids.append(_blocks(k.device, counts, stencil, way))
        stencil = _coarsen(counts, stencil, k.device, way)
    grids.append(_blocks(k.device, way.counts, stencil))
    return Multigrid(grids, banded(k.device.get(stencil), k.device.get(grids[-1].free), way.counts))


def _products(finest: Elements, way: Transfer, free: NDArray[np.bool_]) -> Buffer:
    """P^T K P by its products with vectors that are 1 at every third coarse node, of which each node has one near.

    Arguments
    ---------
    free: (3, n), which directions are.
    """
    device, n, pad = finest.device, int(np.prod(way.counts)), _pad(way.counts)
    stencil, forces = _stencil(device, way.counts), device.empty(3 * finest.n)
    y = device.empty(3 * (n + pad) + pad)
    for place in product(*(range(min(3, count)) for count in way.counts)):
        u, v, w = (values[:, at::3].sum(axis=1) for values, at in zip(way.functions, place, strict=True))
        values = np.multiply.outer(w, np.multiply.outer(v, u)).ravel()
        for column in range(3):
            displacement = np.zeros((3, finest.n), device.real)
            displacement[column] = values * free[column]
            finest.k.apply(device.put(displacement), finest.free, forces)
            _restrict_vector(finest, forces, way, y)
            how = (*way.counts[:2], n, pad, *place, column, stencil)
            device.launch("stencil.set_column", way.counts[::-1], y, *how)
    device.wait()
    return stencil


def _spacing(counts: Counts, points: NDArray[Any]) -> list[float]:
    """Distance of neighbours along each direction, mm: that whose coupling, by 1 / distance^2, is their mean.

    Edges count as no shorter than ``SHORTEST``: one without length couples without end.
    """
    grid = points.reshape(*counts[::-1], 3).astype(np.float64)
    squares = [np.sum(np.diff(grid, axis=axis) ** 2, axis=-1) for axis in (2, 1, 0)]
    return [float(np.mean(1 / np.maximum(square, SHORTEST**2 * square.mean())) ** -0.5) for square in squares]


def _is_direct(counts: Counts) -> bool:
    return 3 * int(np.prod(counts)) * bandwidth(counts) <= DIRECT


def _transfer(
    device: Device, counts: Counts, spacing: list[float], close: float = CLOSE
) -> tuple[Transfer, list[float]]:
    """Coarsen the directions in which nodes lie close; none where the grid itself can be solved directly."""
    least = min((size for size, n in zip(spacing, counts, strict=True) if n > 2), default=0.0)
    limit = 0.0 if _is_direct(counts) else close * least
    halved = [n > 2 and size < limit for size, n in zip(spacing, counts, strict=True)]
    centres = [_centres(n) if half else np.arange(n) for n, half in zip(counts, halved, strict=True)]
    sides, below, above, functions = [], [], [], []
    for n, centre in zip(counts, centres, strict=True):
        gap = np.diff(centre) == 2
        sides.append(np.stack([np.append(False, gap), np.append(gap, False)], axis=1).ravel() * 0.5)
        below.append(np.searchsorted(centre, np.arange(n), side="right") - 1)
        above.append(np.where(centre[below[-1]] < np.arange(n), 0.5, 0.0))
        functions.append(np.eye(len(centre) + 1)[below[-1]] * (1 - above[-1])[:, None])
        functions[-1] += np.eye(len(centre) + 1)[below[-1] + 1] * above[-1][:, None]
    coarse = (len(centres[0]), len(centres[1]), len(centres[2]))
    centre, side, low, high = (device.put(np.concatenate(rows)) for rows in (centres, sides, below, above))
    spacing = [2 * size if half else size for size, half in zip(spacing, halved, strict=True)]
    return Transfer(coarse, centre, side, low, high, functions), spacing


def _centres(n: int) -> NDArray[Any]:
    """Every second node and the last."""
    return np.unique(np.append(np.arange(0, n, 2), n - 1))


def _blocks(device: Device, counts: Counts, stencil: Buffer, way: Transfer | None = None) -> Blocks:
    n = int(np.prod(counts))
    blocks = device.empty((6, n))
    inverse = device.put(np.zeros(6 * n + TILE, device.real))  # nodes past the last of a tile multiply its end
    device.launch("stencil.own_blocks", n, stencil, n, blocks)
    free = device.put((device.get(blocks)[:3] > 0).astype(device.real))
    device.launch("nodal.invert_blocks", n, blocks, free, n, inverse)
    grid = Blocks(device, counts, inverse, free, way, 1.0, stencil)
    return replace(grid, largest=_largest(grid)) if way else grid


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


def _coarsen(counts: Counts, stencil: Buffer, device: Device, way: Transfer) -> Buffer:
    """P^T S P, one direction after another: each makes the next one's work less."""
    begin = 0
    for axis, count in enumerate(way.counts):
        if count < counts[axis]:
            u, v, w = (count if d == axis else counts[d] for d in range(3))
            after = (u, v, w)
            coarse = _stencil(device, after)
            where = (*counts, axis, count, begin, way.centre, way.side, coarse)
            device.launch("stencil.coarsen", (27, int(np.prod(after))), stencil, *where)
            counts, stencil = after, coarse
        begin += count
    return stencil
