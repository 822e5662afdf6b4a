"""Multigrid for structured hex8 meshes, the preconditioner whose iterations hardly grow with refinement.

The finest grid is the elements themselves, whose matrix is never formed, where their product is fast. Coarse grids take
every second node of the directions in which nodes lie close, and have one 3 x 3 block for each pair of neighbouring
nodes. Their matrices are P^T S P with linear interpolation P in the grid's indices, so that they are positive definite
whatever the shape of coarse elements. Each grid is smoothed by Chebyshev's iteration over the nodes' own blocks; the
coarsest is solved directly. All of it may be in float32: it only steers the conjugate gradients, which work in float64.
"""

from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.analysis.banded import Banded, banded
from gpubspline.analysis.grid import Elements, Grid, blocks_of, empty_stencil, largest_eigenvalue, padding
from gpubspline.analysis.stiffness import Stiffness
from gpubspline.analysis.transfer import CLOSE, Counts, Transfer, coarsened, is_direct, spacing_of
from gpubspline.device import Buffer, Device

CYCLES = 2
"""Of each grid after the first, for one of the grid before it, where there are more than"""
FEW = 4
"""grids."""


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
    fine = (*grid.counts[:2], grid.n, grid.pad)
    coarse = (*way.counts[:2], int(np.prod(way.counts)), padding(way.counts))
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
    way, spacing = coarsened(k.device, counts, spacing_of(counts, points), close)
    finest = Elements(k.device, counts, k.inverse_blocks(free), free, way, 1.0, k)
    grids: list[Grid] = [replace(finest, largest=largest_eigenvalue(finest))] if close else []
    stencil = _products(finest, way, ~held.T)
    while not is_direct(way.counts):
        counts = way.counts
        way, spacing = coarsened(k.device, counts, spacing)
        grids.append(blocks_of(k.device, counts, stencil, way))
        stencil = _coarsen(counts, stencil, k.device, way)
    grids.append(blocks_of(k.device, way.counts, stencil))
    return Multigrid(grids, banded(k.device.get(stencil), k.device.get(grids[-1].free), way.counts))


def _products(finest: Elements, way: Transfer, free: NDArray[np.bool_]) -> Buffer:
    """P^T K P by its products with vectors that are 1 at every third coarse node, of which each node has one near.

    Arguments
    ---------
    free: (3, n), which directions are.
    """
    device, n, pad = finest.device, int(np.prod(way.counts)), padding(way.counts)
    stencil, forces = empty_stencil(device, way.counts), device.empty(3 * finest.n)
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


def _coarsen(counts: Counts, stencil: Buffer, device: Device, way: Transfer) -> Buffer:
    """P^T S P, one direction after another: each makes the next one's work less."""
    begin = 0
    for axis, count in enumerate(way.counts):
        if count < counts[axis]:
            u, v, w = (count if d == axis else counts[d] for d in range(3))
            after = (u, v, w)
            coarse = empty_stencil(device, after)
            where = (*counts, axis, count, begin, way.centre, way.side, coarse)
            device.launch("stencil.coarsen", (27, int(np.prod(after))), stencil, *where)
            counts, stencil = after, coarse
        begin += count
    return stencil
