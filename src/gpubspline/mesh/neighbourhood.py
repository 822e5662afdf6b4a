"""The hexes round some of a mesh's, as a small mesh of movable nodes: what is wrong in one place is mended there."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.mesh.colouring import colour_nodes
from gpubspline.mesh.movable import FIXED, Movable, movable

Floats = NDArray[np.float64]

_ALONG = {
    8: (((0, 1), (3, 2), (4, 5), (7, 6)), ((0, 3), (1, 2), (4, 7), (5, 6)), ((0, 4), (1, 5), (2, 6), (3, 7))),
    4: (((0, 1), (3, 2)), ((0, 3), (1, 2))),
}
"""Ends of the edges along u, v and w of hexes, along u and v of quads."""


@dataclass(frozen=True, eq=False)
class Neighbourhood:
    """Part of a mesh, whose rim stays where it is.

    Attributes
    ----------
    hexes: the part, its nodes and elements numbered anew.
    nodes, elements: their numbers in the whole.
    colours: (n,) from 0; nodes of one colour share no hex.
    slack: (n,) of its nodes.
    """

    hexes: Movable
    nodes: NDArray[Any]
    elements: NDArray[Any]
    colours: NDArray[Any]
    slack: NDArray[Any]


def hexes_round(whole: Movable, chosen: NDArray[np.bool_], rings: int) -> NDArray[np.bool_]:
    """Whether each hex (m,) has all its nodes within some rings of the ``chosen`` (m,) ones."""
    cells, near = whole.cells, np.zeros(whole.n_nodes, dtype=bool)
    near[cells[chosen]] = True
    for _ in range(rings):
        near[cells[near[cells].any(axis=1)]] = True
    return np.asarray(near[cells].all(axis=1))


def neighbourhood(
    whole: Movable, slack: NDArray[Any], own: NDArray[np.bool_], colours: NDArray[Any] | None = None
) -> Neighbourhood:
    """Cut out some hexes (m,).

    Arguments
    ---------
    slack: (n,) of the whole's nodes.
    colours: of these, where they are known.
    """
    cells = whole.cells
    rim = np.zeros(whole.n_nodes, dtype=bool)
    rim[cells[~own]] = True
    nodes, numbers = np.unique(cells[own], return_inverse=True)
    held = np.where(rim[nodes], FIXED, slack[nodes])
    levels = np.array(whole.device.get(whole.levels)).reshape(2, -1)[:, nodes]
    lengths = np.array(whole.device.get(whole.log_lengths)).reshape(3, -1)[:, own]
    part_cells = numbers.reshape(-1, 8).astype(np.int32)
    part = movable(part_cells, len(nodes), held, whole.level, whole.device, lengths, levels)
    colours = colour_nodes(part_cells, len(nodes)) if colours is None else colours[nodes]
    return Neighbourhood(part, nodes, np.flatnonzero(own), colours, held)


def target_lengths(hexes: Movable) -> Floats:
    """(3, m) that the edges of hexes along u, v, w should have."""
    logarithms = np.array(hexes.device.get(hexes.log_lengths)).reshape(3, -1).astype(np.float64)
    return np.asarray(np.exp(0.5 * logarithms))


def with_targets(hexes: Movable, lengths: Floats) -> Movable:
    """Hexes with other target lengths (3, m); steps stay as long as they were."""
    return replace(hexes, log_lengths=hexes.device.put(2 * np.log(lengths)))


def edge_lengths(points: Floats, cells: NDArray[np.int32]) -> Floats:
    """(3, m, 4) of the edges of hexes (m, 8) along u, v, w; (2, m, 2) of quads (m, 4)."""
    ends = [
        [np.linalg.norm(points[cells[:, b]] - points[cells[:, a]], axis=1) for a, b in row]
        for row in _ALONG[cells.shape[1]]
    ]
    return np.asarray(np.array(ends).transpose(0, 2, 1))


def least_determinant(points: Floats, cells: NDArray[np.int32]) -> Floats:
    """(m,) least Jacobian determinant at a corner of each hex over the mean of its eight."""
    least, total = np.full(len(cells), np.inf), np.zeros(len(cells))
    for corner in range(8):
        edges = []
        for axis in range(3):
            low, high = next(pair for pair in _ALONG[8][axis] if corner in pair)
            edges.append(points[cells[:, high]] - points[cells[:, low]])
        determinant = np.einsum("mx,mx->m", np.cross(edges[0], edges[1]), edges[2])
        least, total = np.minimum(least, determinant), total + determinant
    return np.asarray(8 * least / np.where(total > 0, total, np.inf))
