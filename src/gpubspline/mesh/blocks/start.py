"""Where the optimiser starts: the surface pulled on to the level set, the inside relaxed."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from gpubspline.device import Buffer
from gpubspline.mesh.blocks.pillow import Pillowed
from gpubspline.mesh.movable import Movable

PULLS = 12
"""Rounds in which the surface is averaged and goes half the way to the level set."""

RELAXATIONS = 20
"""Rounds in which the inside is averaged."""

_EDGES = ((0, 1), (3, 2), (4, 5), (7, 6), (0, 3), (1, 2), (4, 7), (5, 6), (0, 4), (1, 5), (2, 6), (3, 7))
_SIDES = ((0, 1), (1, 2), (2, 3), (3, 0))


def start(hexes: Pillowed, movable: Movable) -> Buffer:
    """Nodes (3, n) on the device of ``movable``, those of the surface on the level set."""
    device, core = movable.device, hexes.n_core
    x = hexes.points.astype(np.float32)

    def on_level() -> NDArray[Any]:
        buffer = device.put(np.ascontiguousarray(x.T))
        movable.slide(buffer)
        return np.asarray(np.array(device.get(buffer)).reshape(3, -1).T)

    surface = averaging(hexes.quads - core, _SIDES, hexes.n_nodes - core)
    for _ in range(PULLS):
        x[core:] = 0.5 * (x[core:] + surface @ x[core:])
        x[core:] = 0.5 * (x[core:] + on_level()[core:])
    x[core:] = on_level()[core:]
    inside = averaging(hexes.cells, _EDGES, hexes.n_nodes)[:core]
    for _ in range(RELAXATIONS):
        x[:core] = inside @ x
    return device.put(np.ascontiguousarray(x.T))


def averaging(cells: NDArray[np.int32], edges: tuple[tuple[int, int], ...], n: int) -> Any:
    """Sparse matrix (n, n) that takes nodal values to the mean over the nodes that are an edge away."""
    ends = np.concatenate([cells[:, edge] for edge in edges])
    rows, columns = np.concatenate([ends, ends[:, ::-1]]).T
    matrix = csr_matrix((np.ones(len(rows), dtype=np.float32), (rows, columns)), shape=(n, n))
    counts = np.maximum(np.diff(matrix.indptr), 1)
    matrix.data = np.repeat((1 / counts).astype(np.float32), counts * (np.diff(matrix.indptr) > 0))
    return matrix
