"""One grid of a multigrid: its vectors, its smoother and its defect, of elements or of blocks between neighbours."""

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.analysis.krylov import Vectors
from gpubspline.analysis.stiffness import Stiffness
from gpubspline.analysis.transfer import Counts, Transfer
from gpubspline.device import Buffer, Device

SMOOTHINGS = 4
"""Steps of Chebyshev's iteration before and after the coarse grid, an even number."""
DAMPED = 20.0
"""The ratio of eigenvalues over which they damp."""
POWERS = 12
"""Iterations that find the largest eigenvalue, and what is added for their error:"""
MARGIN = 1.15

TILE = 8
"""Nodes whose blocks lie together."""


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
        return padding(self.counts)

    def step(self, b: Buffer, x: Buffer, out: Buffer, step: float, keep: float = 1.0, still: bool = False) -> None:
        """Out = keep x + step B (b - S x); where ``still``, x is 0."""
        how = (int(still), keep, float(step), *self.counts[:2], self.n, self.pad, out)
        self.device.launch("stencil.smooth", whole_tiles(self.n), self.stencil, self.inverse, b, x, *how)

    def defect(self, b: Buffer, x: Buffer, r: Buffer) -> None:
        """R = b - S x."""
        how = (*self.counts[:2], self.n, self.pad, r)
        self.device.launch("stencil.defect", whole_tiles(self.n), self.stencil, b, x, *how)


def padding(counts: Counts) -> int:
    """As far as neighbours lie, and a tile."""
    return counts[0] * counts[1] + counts[0] + TILE


def whole_tiles(n: int) -> int:
    """Nodes of as many whole tiles as n nodes take."""
    return -(-n // TILE) * TILE


def empty_stencil(device: Device, counts: Counts) -> Buffer:
    """Blocks (27, 9) of every node, of whole tiles, all 0."""
    return device.put(np.zeros(243 * whole_tiles(int(np.prod(counts))), device.real))


def blocks_of(device: Device, counts: Counts, stencil: Buffer, way: Transfer | None = None) -> Blocks:
    """The grid of a stencil; on the coarsest, which has no ``way`` on, no eigenvalue is needed."""
    n = int(np.prod(counts))
    blocks = device.empty((6, n))
    inverse = device.put(np.zeros(6 * n + TILE, device.real))  # nodes past the last of a tile multiply its end
    device.launch("stencil.own_blocks", n, stencil, n, blocks)
    free = device.put((device.get(blocks)[:3] > 0).astype(device.real))
    device.launch("nodal.invert_blocks", n, blocks, free, n, inverse)
    grid = Blocks(device, counts, inverse, free, way, 1.0, stencil)
    return replace(grid, largest=largest_eigenvalue(grid)) if way else grid


def largest_eigenvalue(grid: Grid) -> float:
    """The largest eigenvalue of B S, by powers."""
    nothing, x, d, _ = grid.vectors
    vectors, size = Vectors(grid.device, grid.padded), 1.0
    grid.write(x, np.random.default_rng(0).standard_normal((3, grid.n)))
    for _ in range(POWERS):
        vectors.combine(x, 1 / np.sqrt(vectors.dot(x, x)), 0.0, d)
        grid.step(nothing, d, x, -1.0, keep=0.0)
        size = float(np.sqrt(vectors.dot(x, x)))
    return MARGIN * size
