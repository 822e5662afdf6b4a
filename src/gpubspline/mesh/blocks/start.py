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

    surface = averaging(_held_alike(hexes) - core, ((0, 1),), hexes.n_nodes - core, both_ways=False)
    for _ in range(PULLS):
        x[core:] = 0.5 * (x[core:] + surface @ x[core:])
        x[core:] = 0.5 * (x[core:] + on_level()[core:])
    x[core:] = on_level()[core:]
    inside = averaging(hexes.cells, _EDGES, hexes.n_nodes)[:core]
    for _ in range(RELAXATIONS):
        x[:core] = inside @ x
    return device.put(np.ascontiguousarray(x.T))


def _held_alike(hexes: Pillowed) -> NDArray[np.int32]:
    """(e, 2) surface edges from a node to one between the same bodies or more, or from one without such to itself."""
    faces = np.concatenate([hexes.quads, hexes.interfaces])
    ends = np.concatenate([faces[:, side] for side in _SIDES])
    ends = np.concatenate([ends, ends[:, ::-1]])
    bodies = hexes.bodies[ends]
    alike = ends[(bodies[:, 0] & ~bodies[:, 1]) == 0]
    alone = np.setdiff1d(faces, alike[:, 0])
    return np.concatenate([alike, np.stack([alone, alone], axis=1)])


def averaging(cells: NDArray[np.int32], edges: tuple[tuple[int, int], ...], n: int, both_ways: bool = True) -> Any:
    """Sparse matrix (n, n) that takes nodal values to the mean over the nodes that are an edge away."""
    ends = np.concatenate([cells[:, edge] for edge in edges])
    rows, columns = (np.concatenate([ends, ends[:, ::-1]]) if both_ways else ends).T
    matrix = csr_matrix((np.ones(len(rows), dtype=np.float32), (rows, columns)), shape=(n, n))
    neighbours = np.diff(matrix.indptr)
    matrix.data = np.repeat((1 / np.maximum(neighbours, 1)).astype(np.float32), neighbours)
    return matrix
