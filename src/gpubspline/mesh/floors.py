"""Floors under the worst hex, raised in turn: descent of an energy, then single nodes by their worst corners."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.device import Buffer
from gpubspline.mesh.movable import Goal, Movable
from gpubspline.mesh.neighbourhood import hexes_round, neighbourhood
from gpubspline.mesh.quasi_newton import descend

CAP = 0.3
"""Farthest a node goes in one step, in sizes of its smallest element."""

FLOOR_EDGES = 0.001
"""Weight of even edges while the worst hexes are improved."""

AHEAD = 0.1
"""How much more than the floor the energy asks of a corner."""

CEILING = 0.75
"""Highest floor tried. Four hexes round a convex corner of a core allow 4 / (3 sqrt 3) = 0.77."""

RISE = 0.05
"""From one floor to the next."""

RINGS, FEW, MANY = 4, 0.25, 30_000
"""Only hexes within so many rings of those below a floor are moved to raise them, where these are no greater share of
all, and all are so many: the larger a mesh, the smaller the share, while descents of a small one take little.
"""

SWEEPS = 4
"""Most rounds of moves of single nodes at a floor."""

REACH, HALVINGS, TRIES = 0.1, 4, 8
"""First step of a single node, in sizes of its smallest element, how often it is halved, and most steps it takes."""

POLISH, PATIENCE, POLISHES = 0.02, 3, 40
"""At last single nodes are moved to raise hexes less than so much above the worst, until so many rounds in turn gain
nothing, or that many are done: a round costs less than a step of descent.
"""

SHORTEST = 0.2
"""Where single nodes move, an edge of so many sizes of their smallest element counts like a corner at the floor, a
shorter one like a worse one: scaled Jacobians do not see lengths.
"""

ANY_LENGTH: dict[str, Any] = {"polishes": 0, "shortest": 1e-6}
"""Effort for meshes that are meant to have short edges: none counts, and nodes are not moved on and on."""


@dataclass(frozen=True, eq=False)
class Placed:
    """Nodes (3, n) on a device, the least scaled Jacobian between them, and how far each may be off the surface."""

    x: Buffer
    least: float
    slack: NDArray[Any]


@dataclass(frozen=True, eq=False)
class Effort:
    """What is done to improve hexes; the bench switches parts off.

    Attributes
    ----------
    goal: floor beyond which nothing is asked.
    steps, floor_steps: of descent, of all hexes and at each floor.
    sweeps: most rounds of moves of single nodes at each floor.
    polishes: most rounds of them at last.
    shortest: edges, in sizes of a node's smallest element, that count like a corner at the floor where it moves.
    few: hexes near those below a floor are moved alone where they are no greater share of all.
    loosen: whether surface nodes may leave the surface where hexes stay poor.
    ahead, edges: how much more than the floor the energy asks of a corner, and its weight of even edges.
    """

    goal: float = CEILING
    steps: int = 80
    floor_steps: int = 60
    sweeps: int = SWEEPS
    polishes: int = POLISHES
    shortest: float = SHORTEST
    few: float = FEW
    loosen: bool = True
    ahead: float = AHEAD
    edges: float = FLOOR_EDGES


def climb(hexes: Movable, colours: NDArray[Any], best: Placed, effort: Effort) -> Placed:
    """Raise floor after floor, until two in turn are not reached."""
    missed, floor = 0, max(0.1, best.least + 0.5 * RISE)
    x = best.x
    while best.least < effort.goal and missed < 2:
        floor = min(floor, effort.goal)
        few = _few_round(hexes, x, floor, effort)
        made = raise_to(hexes, colours, copy(hexes, x), floor, best.slack, effort, few)
        missed = 0 if made.least >= floor else missed + 1
        best, x = better(best, made), made.x
        if floor >= effort.goal:
            break
        floor = max(floor + RISE, best.least + 0.5 * RISE)
        if few is not None and floor > effort.goal - 0.5 * RISE:  # the next is of many: one for both
            floor = effort.goal
    return best


def _few_round(hexes: Movable, x: Buffer, floor: float, effort: Effort) -> NDArray[np.bool_] | None:
    """Hexes (m,) within some rings of those below a floor, or None where these are not few."""
    if effort.few == 0 or hexes.n_elements < MANY or hexes.n_corners != 8 or hexes.planes != 3:
        return None
    near = hexes_round(hexes, hexes.scaled_jacobian(x) < floor, RINGS)
    return near if 0 < near.mean() <= effort.few else None


def raise_to(
    hexes: Movable,
    colours: NDArray[Any],
    x: Buffer,
    floor: float,
    slack: NDArray[Any],
    effort: Effort,
    few: NDArray[np.bool_] | None = None,
) -> Placed:
    """Bring the hexes at x to a floor, as many as will go; ``few`` (m,): those that move alone."""
    if few is None:
        return placed(hexes, _raised(hexes, colours, x, floor, effort), slack)
    near, points = neighbourhood(hexes, slack, few, colours), np.array(hexes.device.get(x)).reshape(3, -1)
    part = hexes.device.put(np.ascontiguousarray(points[:, near.nodes]))
    part = _raised(near.hexes, near.colours, part, floor, effort)
    points[:, near.nodes] = np.array(hexes.device.get(part)).reshape(3, -1)
    return placed(hexes, hexes.device.put(points), slack)


def _raised(hexes: Movable, colours: NDArray[Any], x: Buffer, floor: float, effort: Effort) -> Buffer:
    x, _ = descend(hexes, x, Goal(floor + effort.ahead, 2, effort.edges), steps=effort.floor_steps, cap=CAP)
    for _ in range(effort.sweeps):
        if not sweep(hexes, colours, x, floor, effort.shortest):
            break
    return x


def polish(hexes: Movable, colours: NDArray[Any], best: Placed, effort: Effort) -> Placed:
    """Move single nodes round the worst hexes for as long as that raises the least."""
    x, idle = copy(hexes, best.x), 0
    for _ in range(effort.polishes):
        if best.least >= effort.goal or idle == PATIENCE:
            break
        sweep(hexes, colours, x, min(best.least + POLISH, effort.goal), effort.shortest)
        made = placed(hexes, x, best.slack)
        idle = 0 if made.least > best.least else idle + 1
        best = best if idle else replace(made, x=copy(hexes, x))
    return best


def sweep(hexes: Movable, colours: NDArray[Any], x: Buffer, floor: float, shortest: float) -> int:
    """Move each node of a hex below the floor to where its own worst corner is best; gives how many there were.

    ``shortest``: edges that count like a corner at the floor, in sizes of the node's smallest element.
    """
    below = hexes.scaled_jacobian(x) < floor
    if not below.any():
        return 0
    nodes = np.unique(hexes.cells[below]).astype(np.int32)
    nodes = nodes[np.argsort(colours[nodes], kind="stable")]
    counts = np.bincount(colours[nodes])
    moved, device = hexes.device.put(nodes), hexes.device
    table = (hexes.nodes, hexes.n_corners, hexes.n_elements, hexes.start, hexes.slots, hexes.slack, hexes.levels, moved)
    for first, count in zip(np.cumsum(counts) - counts, counts, strict=True):
        how = (
            int(first),
            int(count),
            float(floor),
            floor / shortest,
            REACH,
            hexes.scale,
            HALVINGS,
            TRIES,
            *hexes.level.arguments,
        )
        device.launch("optimize.improve", int(count), x, hexes.slid(x), hexes.n_nodes, *table, *how)
    return len(nodes)


def placed(hexes: Movable, x: Buffer, slack: NDArray[Any]) -> Placed:
    """Nodes with their least scaled Jacobian."""
    return Placed(x, float(hexes.scaled_jacobian(x).min()), slack)


def copy(hexes: Movable, x: Buffer) -> Buffer:
    """The same nodes in another buffer."""
    out = hexes.device.empty(hexes.planes * hexes.n_nodes)
    hexes.device.launch("optimize.move", hexes.n_nodes, x, hexes.planes, x, hexes.n_nodes, 0.0, 1.0, hexes.scale, out)
    return out


def better(old: Placed, new: Placed) -> Placed:
    """The one whose worst hex is better, the old where they are alike."""
    return new if new.least > old.least else old
