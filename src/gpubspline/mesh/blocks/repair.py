"""Make the core's boundary a surface that a layer of hexes can grow from.

Round a lattice vertex lie 2 x 2 x 2 cells. Of the 256 ways in which they are inside or outside, 104 are sound:

* the cells inside are connected by faces, and so are those outside: the boundary is a manifold there;
* no two boundary faces at the vertex look in opposite directions: there is a direction outward from all of them.

Cells are flipped, those nearest to the surface first, until every vertex is sound.
"""

from itertools import product

import numpy as np
from numpy.typing import NDArray

from gpubspline.mesh.blocks.core import Cells

ROUNDS = 400
"""Most rounds of flips; a core that needs more is too porous for its lattice."""

AGAIN = 0.5
"""What a cell's distance counts more, in elements, each time it has been flipped: no flip is undone for ever."""

_AXES = (1, 2, 4)


def _connected(members: set[int]) -> bool:
    reached, waiting = set[int](), [min(members)] if members else []
    while waiting:
        cell = waiting.pop()
        reached.add(cell)
        waiting += [cell ^ axis for axis in _AXES if cell ^ axis in members - reached]
    return reached == members


def _is_sound(pattern: int) -> bool:
    inside = {cell for cell in range(8) if pattern >> cell & 1}
    outside = set(range(8)) - inside
    for axis in _AXES:
        if len({bool(cell & axis) for cell in inside if cell ^ axis in outside}) == 2:
            return False
    return _connected(inside) and _connected(outside)


SOUND: NDArray[np.bool_] = np.array([_is_sound(pattern) for pattern in range(256)])
"""Whether a vertex is sound, by its pattern: bit a + 2 b + 4 c for the cell a, b, c steps up i, j, k."""


def patterns(cells: Cells) -> NDArray[np.uint8]:
    """Pattern (n_k + 1, n_j + 1, n_i + 1) of each lattice vertex; beyond the border is outside."""
    padded = np.pad(cells, 1).astype(np.uint8)
    found = np.zeros(tuple(n + 1 for n in cells.shape), dtype=np.uint8)
    for bit in range(8):
        window = tuple(slice(s, s + n) for s, n in zip(_steps(bit), found.shape, strict=True))
        found |= padded[window] << np.uint8(bit)
    return found


def _steps(bit: int) -> tuple[int, int, int]:
    """Steps along k, j, i of a bit's cell."""
    return bit >> 2 & 1, bit >> 1 & 1, bit & 1


def repair(cells: Cells, means: NDArray[np.float32]) -> tuple[Cells, int, NDArray[np.int64]]:
    """Flip cells until every vertex is sound: ``repair_owners`` of one body.

    Arguments
    ---------
    cells: (n_k, n_j, n_i) bool; those along the border stay outside.
    means: same shape, level set of each cell, in elements.

    Returns
    -------
    cells; how many differ from those given; unsound vertices (n, 3) k, j, i that are left, none if all went well.
    """
    cost = np.abs(means)
    owners, changed, unsound = repair_owners(cells.astype(np.int8), np.stack([cost, cost]))
    return owners > 0, changed, unsound


def repair_owners(
    owners: NDArray[np.int8], costs: NDArray[np.float32]
) -> tuple[NDArray[np.int8], int, NDArray[np.int64]]:
    """Give cells to other bodies, or to the outside, until every vertex is sound for each body and for their union.

    In each round the cells round unsound vertices are weighed by what they cost for each vertex that the change would
    mend; those that weigh least within their 3 x 3 x 3 neighbourhood change, so that no two changes of a round touch.

    Arguments
    ---------
    owners: (n_k, n_j, n_i) int8, 0 outside, bodies from 1; cells along the border stay outside.
    costs: (1 + bodies, n_k, n_j, n_i) what it costs, in elements of distance, that a cell becomes outside or a body's.

    Returns
    -------
    owners; how many differ from those given; vertices (n, 3) k, j, i that are left unsound, none if all went well.
    """
    given, owners = owners, owners.copy()
    changes = np.zeros(owners.shape, dtype=np.uint8)
    grid = np.full(owners.size, np.inf)
    for _ in range(ROUNDS):
        found = _patterns_of_all(owners, len(costs) - 1)
        unsound = _unsound(found)
        if not len(unsound):
            break
        candidates = _cells_round(unsound, owners.shape)
        at = tuple(candidates.T)
        cost, new = _cheapest(owners[at], found, candidates, costs[:, at[0], at[1], at[2]], changes[at])
        chosen = _independent(candidates, cost, owners.shape, grid)
        at = tuple(candidates[chosen].T)
        owners[at] = new[chosen]
        changes[at] += 1
    unsound = _unsound(_patterns_of_all(owners, len(costs) - 1))
    return owners, int(np.count_nonzero(owners != given)), unsound


def _patterns_of_all(owners: NDArray[np.int8], bodies: int) -> list[NDArray[np.uint8]]:
    """Patterns of the union of all bodies, then, where there are several, of each."""
    several = range(1, bodies + 1) if bodies > 1 else ()
    return [patterns(owners > 0), *(patterns(owners == body) for body in several)]


def _unsound(found: list[NDArray[np.uint8]]) -> NDArray[np.int64]:
    bad = ~SOUND[found[0]]
    for more in found[1:]:
        bad |= ~SOUND[more]
    return np.stack(np.nonzero(bad), axis=1)


def _cells_round(vertices: NDArray[np.int64], shape: tuple[int, ...]) -> NDArray[np.int64]:
    """Cells (c, 3) k, j, i, each once, round vertices (n, 3), but for those along the border."""
    round_them = (vertices[:, None, :] - 1 + np.array([_steps(bit) for bit in range(8)])).reshape(-1, 3)
    allowed = np.all((round_them > 0) & (round_them < np.array(shape) - 1), axis=1)
    flat = np.unique(np.ravel_multi_index(tuple(round_them[allowed].T), shape))
    return np.stack(np.unravel_index(flat, shape), axis=1)


def _cheapest(
    own: NDArray[np.int8],
    found: list[NDArray[np.uint8]],
    candidates: NDArray[np.int64],
    costs: NDArray[np.float32],
    changes: NDArray[np.uint8],
) -> tuple[NDArray[np.float64], NDArray[np.int8]]:
    """(c,) what the cheapest change of each candidate costs, and the owner it gives it to."""
    gains = np.stack([_mended(pattern, candidates) for pattern in found])  # of the union, then of each body
    weighed = np.full((len(costs), len(own)), np.inf)
    for new in range(len(costs)):
        mended = np.where((own == 0) != (new == 0), gains[0], 0)
        for body in range(1, len(gains)):
            mended += np.where((own == body) != (new == body), gains[body], 0)
        moved = costs[new].astype(np.float64) + 0.05 + AGAIN * changes
        worth = np.where(mended > 0, moved / np.maximum(mended, 1), 10.0 + moved * (1 - np.minimum(mended, 0)))
        weighed[new] = np.where(own == new, np.inf, worth)
    best = np.argmin(weighed, axis=0)
    return weighed[best, np.arange(len(own))], best.astype(np.int8)


def _mended(found: NDArray[np.uint8], candidates: NDArray[np.int64]) -> NDArray[np.int64]:
    """(c,) vertices that become sound where each candidate is flipped, less those that become unsound."""
    mended = np.zeros(len(candidates), dtype=np.int64)
    for bit in range(8):  # the cell has this bit at the vertex that lies the other way
        vertex = tuple((candidates + 1 - np.array(_steps(bit))).T)
        before = found[vertex]
        mended += SOUND[before ^ np.uint8(1 << bit)].astype(np.int64) - SOUND[before]
    return mended


def _independent(
    candidates: NDArray[np.int64], cost: NDArray[np.float64], shape: tuple[int, ...], grid: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Candidates that cost least within their 3 x 3 x 3 neighbourhood, ties to the first.

    ``grid`` holds infinity for each cell, flat, before and after.
    """
    rank = np.empty(len(cost), dtype=np.float64)
    rank[np.argsort(cost, kind="stable")] = np.arange(len(cost))
    flat = np.ravel_multi_index(tuple(candidates.T), shape)
    grid[flat] = rank
    steps = [(k * shape[1] + j) * shape[2] + i for k, j, i in product((-1, 0, 1), repeat=3)]
    least = np.minimum.reduce([grid[flat + step] for step in steps])
    grid[flat] = np.inf
    return np.asarray(least == rank)
