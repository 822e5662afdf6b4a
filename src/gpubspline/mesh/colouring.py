"""Colours of nodes such that no two of one element are alike, so that all of one colour may move at once."""

import numpy as np
from numpy.typing import NDArray

from gpubspline.errors import InputError
from gpubspline.mesh.movable import node_slots

MOST_COLOURS = 63


def colour_nodes(cells: NDArray[np.int32], n_nodes: int) -> NDArray[np.int8]:
    """Colours (n,) from 0 of the nodes of cells (m, k), the same each time.

    In each round the nodes whose number, in an order drawn by a fixed seed, is the highest among the uncoloured nodes
    of all their cells take the lowest colour that none of their neighbours has.

    Source: Jones and Plassmann 1993.
    """
    start, slots = node_slots(cells, n_nodes)
    used = np.flatnonzero(np.diff(start))
    own = slots % len(cells)
    rank = np.random.default_rng(0).permutation(n_nodes) + 1
    colours = np.full(n_nodes, -1, dtype=np.int64)
    taken = np.zeros(len(cells), dtype=np.int64)  # bits of the colours that a cell's nodes have
    while True:
        waiting = np.where(colours < 0, rank, 0)
        highest = np.maximum.reduceat(waiting[cells].max(axis=1)[own], start[used])
        chosen = used[(highest == waiting[used]) & (highest > 0)]
        if not chosen.size:
            break
        around = np.bitwise_or.reduceat(taken[own], start[used])[np.searchsorted(used, chosen)]
        lowest = ~around & (around + 1)
        if lowest.max() >= 1 << MOST_COLOURS or lowest.min() <= 0:
            raise InputError(f"expected a mesh that {MOST_COLOURS} colours do for, got nodes of very many elements")
        colours[chosen] = np.round(np.log2(lowest)).astype(np.int64)
        bits = np.zeros(n_nodes, dtype=np.int64)
        bits[chosen] = lowest
        taken |= np.bitwise_or.reduce(bits[cells], axis=1)
    return np.maximum(colours, 0).astype(np.int8)
