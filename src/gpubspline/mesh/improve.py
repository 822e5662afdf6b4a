"""Raise the worst scaled Jacobian of hexes: descent of an energy, then single nodes against the worst corners."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.device import Buffer
from gpubspline.mesh.movable import Goal, Movable
from gpubspline.mesh.quasi_newton import descend

CAP = 0.3
"""Farthest a node goes in one step, in target lengths."""

EDGES = 0.005
"""Weight of even edges while all hexes are improved."""

FLOOR_EDGES = 0.001
"""Weight of even edges while the worst hexes are improved."""

AHEAD = 0.1
"""How much more than the floor the energy asks of a corner."""

CEILING = 0.75
"""Highest floor tried. Four hexes round a convex corner of a core allow 4 / (3 sqrt 3) = 0.77."""

RISE = 0.05
"""From one floor to the next, at least."""

SWEEPS = 6
"""Most rounds of moves of single nodes at a floor."""

REACH, HALVINGS, TRIES = 0.1, 4, 8
"""First step of a single node, in target lengths, how often it is halved, and most steps it takes."""


@dataclass(frozen=True, eq=False)
class Placed:
    """Nodes on a device and the least scaled Jacobian of the hexes between them."""

    x: Buffer
    least: float


def improve(hexes: Movable, colours: NDArray[Any], x: Buffer, *, goal: float = CEILING, steps: int = 80) -> Placed:
    """Lower the energy of all hexes, then raise the floor under the worst as far as ``goal``.

    Arguments
    ---------
    colours: (n,) from 0; nodes of one colour share no hex.
    x: (3, n) on the hexes' device; what it holds is lost.
    """
    x, _ = descend(hexes, x, Goal(1.0, 2, EDGES), steps=steps, cap=CAP)
    best = placed(hexes, x)
    floor = max(0.1, best.least + 0.5 * RISE)
    while best.least < goal:
        floor = min(floor, goal)
        best = _better(best, raise_to(hexes, colours, copy(hexes, best.x), floor))
        if floor >= goal:
            break
        floor = max(floor + RISE, best.least + 0.5 * RISE)
    return best


def raise_to(hexes: Movable, colours: NDArray[Any], x: Buffer, floor: float, steps: int = 60) -> Placed:
    """Bring the hexes at x to a floor, as many as will go."""
    x, _ = descend(hexes, x, Goal(floor + AHEAD, 2, FLOOR_EDGES), steps=steps, cap=CAP)
    for _ in range(SWEEPS):
        if not sweep(hexes, colours, x, floor):
            break
    return placed(hexes, x)


def sweep(hexes: Movable, colours: NDArray[Any], x: Buffer, floor: float) -> int:
    """Move each node of a hex below the floor to where its own worst corner is best; gives how many there were."""
    below = hexes.scaled_jacobian(x) < floor
    if not below.any():
        return 0
    nodes = np.unique(hexes.cells[below]).astype(np.int32)
    nodes = nodes[np.argsort(colours[nodes], kind="stable")]
    counts = np.bincount(colours[nodes])
    moved, device = hexes.device.put(nodes), hexes.device
    table = (hexes.nodes, hexes.n_elements, hexes.start, hexes.slots, hexes.slack, hexes.levels, moved)
    for first, count in zip(np.cumsum(counts) - counts, counts, strict=True):
        how = (int(first), int(count), REACH, HALVINGS, TRIES, *hexes.level.arguments)
        device.launch("optimize.improve", int(count), x, hexes.n_nodes, *table, *how)
    return len(nodes)


def placed(hexes: Movable, x: Buffer) -> Placed:
    """Nodes with their least scaled Jacobian."""
    return Placed(x, float(hexes.scaled_jacobian(x).min()))


def copy(hexes: Movable, x: Buffer) -> Buffer:
    """The same nodes in another buffer."""
    out = hexes.device.empty(3 * hexes.n_nodes)
    hexes.device.launch("optimize.move", hexes.n_nodes, x, x, hexes.n_nodes, 0.0, 1.0, out)
    return out


def _better(old: Placed, new: Placed) -> Placed:
    return new if new.least > old.least else old
