"""Raise the worst scaled Jacobian of hexes: descent of an energy, then single nodes against the worst corners."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.device import Buffer
from gpubspline.mesh.movable import FREE, Goal, Movable, node_sizes, node_slots
from gpubspline.mesh.neighbourhood import edge_lengths, hexes_round, neighbourhood, target_lengths
from gpubspline.mesh.quasi_newton import descend

CAP = 0.3
"""Farthest a node goes in one step, in sizes of its smallest element."""

EDGES = 0.005
"""Weight of even edges while all hexes are improved."""

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

TANGLED, LOOSE = 0.3, ((0.5, True), (0.5, False), (1.0, False))
"""Where hexes stay inverted after the first descent those below this have the surface nodes round them loosened by so
many target lengths. First, where there are bodies that touch, only those between them: that changes no outer surface.
"""

AGAIN = 3
"""Most times that the first descent goes on where hexes are left below that."""

POOR, SLACK = 0.6, (0.0, 0.1, 0.2, 0.3, 0.5, 1.0)
"""Hexes below this that no floor was reached for are mended alone, from where all were settled: round after round, with
the surface nodes of those left loosened by so many target lengths once hardly any fewer are left than before. First,
where there are bodies that touch, only those between them.
"""

MENDINGS, FEWER = 16, 0.8
"""Most rounds of it, and what share of the poor hexes may be left of a round without the next slack."""

THIN = 0.15
"""Hexes are then asked to be as long as they are, as this part of their target length at least: one in a sheet thinner
than an element has the sheet's thickness, and would push its sides out.
"""

MARGIN, ROUND_POOR = 0.02, 4
"""By how much more than that they are raised, and rings of hexes round them that move too."""


TURNS = ((0.1, 1e-3), (0.2, 1e-3), (0.05, 1e-3), (0.1, 1e-4), (0.2, 1e-4), (0.05, 1e-4))
"""What ``persist`` asks for in turn: how much more than the floor, and the weight of even edges."""

ROUNDS, GAIN = 3, 0.03
"""Most rounds of these, and what each must gain for another."""

ENOUGH = 0.35
"""Least scaled Jacobian at which ``persist`` stops."""


LOW, LITTLE, CREEPS, CREEP_EDGES = 0.1, 0.02, 3, (1e-3, 1e-4, 1e-5)
"""Least scaled Jacobian below which ``persist`` creeps: by how much at once, how often that is halved, and the weights
of even edges in turn."""


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


def improve(
    hexes: Movable, colours: NDArray[Any], x: Buffer, slack: NDArray[Any], effort: Effort | None = None
) -> Placed:
    """Lower the energy of all hexes, then raise the floor under the worst.

    Arguments
    ---------
    colours: (n,) from 0; nodes of one colour share no hex.
    x: (3, n) on the hexes' device; what it holds is lost.
    slack: (n,) of the hexes.
    """
    effort = effort or Effort()
    return lift(hexes, colours, settle(hexes, x, slack, effort), effort)[1]


def settle(hexes: Movable, x: Buffer, slack: NDArray[Any], effort: Effort) -> Placed:
    """Lower the energy of all hexes, again where some stay tangled, at last with surface nodes round them let go."""
    best = relaxed(hexes, x, slack, effort)
    for _ in range(AGAIN):
        if best.least >= TANGLED:
            break
        best = _better(best, relaxed(hexes, copy(hexes, best.x), slack, effort))
    for loose, within in LOOSE if effort.loosen else ():
        if best.least > 0:
            break
        slack = loosened(hexes, best, TANGLED, loose, within=within)
        if np.array_equal(slack, best.slack):
            continue
        hexes = hexes.with_slack(slack)
        best = _better(best, relaxed(hexes, copy(hexes, best.x), slack, effort))
    return best


def lift(hexes: Movable, colours: NDArray[Any], settled: Placed, effort: Effort) -> tuple[Movable, Placed]:
    """Raise the floor under the worst hex; where it stays poor mend those that are, and raise it from there.

    Returns
    -------
    the hexes, whose targets are ``as_long_as_now`` where some were mended, and their nodes.
    """
    hexes = hexes.with_slack(settled.slack)
    best = polish(hexes, colours, climb(hexes, colours, settled, effort), effort)
    if best.least >= min(POOR, effort.goal) or not effort.loosen:
        return hexes, best
    hexes = as_long_as_now(hexes, settled.x)
    mended = mend(hexes, colours, settled, effort)
    hexes = hexes.with_slack(mended.slack)
    return hexes, _better(best, polish(hexes, colours, climb(hexes, colours, mended, effort), effort))


def mend(hexes: Movable, colours: NDArray[Any], best: Placed, effort: Effort) -> Placed:
    """Raise hexes that are poor, moving those round them alone, with surface nodes of what stays poor let go."""
    floor, latest = min(POOR, effort.goal), best
    between = bool((np.array(hexes.device.get(hexes.levels)).reshape(2, -1)[0] > 0).any())
    turns = [(loose, within) for loose in SLACK for within in ((True, False) if between else (False,))]
    below = hexes.scaled_jacobian(latest.x) < floor
    for _ in range(MENDINGS):
        if best.least >= floor or not turns:
            break
        slack = loosened(hexes, latest, floor, turns[0][0], within=turns[0][1])
        near = hexes_round(hexes, hexes.scaled_jacobian(latest.x) < floor + 0.5 * MARGIN, ROUND_POOR)
        hexes = hexes.with_slack(slack)
        latest = raise_to(hexes, colours, latest.x, floor + MARGIN, slack, effort, near)
        best, before, below = _better(best, latest), below, hexes.scaled_jacobian(latest.x) < floor
        if np.count_nonzero(below) > FEWER * np.count_nonzero(before):
            turns = turns[1:]
    return best


def as_long_as_now(hexes: Movable, x: Buffer, part: float = THIN) -> Movable:
    """Hexes whose edges should be as long as they are at x (3, n), no longer than they should, or a part of that."""
    points, targets = np.array(hexes.device.get(x)).reshape(3, -1).T.astype(np.float64), target_lengths(hexes)
    lengths = 2 * np.log(np.clip(edge_lengths(points, hexes.cells).mean(axis=2), part * targets, targets))
    start, slots = node_slots(hexes.cells, hexes.n_nodes)
    scale = hexes.device.put(np.tile(node_sizes(lengths, start, slots), 3))
    return replace(hexes, log_lengths=hexes.device.put(lengths), scale=scale)


def relaxed(hexes: Movable, x: Buffer, slack: NDArray[Any], effort: Effort) -> Placed:
    """Lower the energy of all hexes."""
    x, _ = descend(hexes, x, Goal(1.0, 2, EDGES), steps=effort.steps, cap=CAP)
    return placed(hexes, x, slack)


def climb(hexes: Movable, colours: NDArray[Any], best: Placed, effort: Effort) -> Placed:
    """Raise floor after floor, until two in turn are not reached."""
    missed, floor = 0, max(0.1, best.least + 0.5 * RISE)
    x = best.x
    while best.least < effort.goal and missed < 2:
        floor = min(floor, effort.goal)
        few = _few_round(hexes, x, floor, effort)
        made = raise_to(hexes, colours, copy(hexes, x), floor, best.slack, effort, few)
        missed = 0 if made.least >= floor else missed + 1
        best, x = _better(best, made), made.x
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


def persist(hexes: Movable, colours: NDArray[Any], best: Placed, effort: Effort) -> list[Placed]:
    """Climb again and again, asking for more and for less and with edges freer to stretch, while that gains.

    What stops one descent, a few hexes that give way to each other, often does not stop the next. Before, creep where
    no floor was reached at all.

    Returns
    -------
    what was given and what was reached after it, each better than the one before.
    """
    reached = [best]

    def keep(made: Placed) -> None:
        if made.least > reached[-1].least:
            reached.append(made)

    if 0 < best.least < LOW:
        keep(creep(hexes, colours, best, effort))
        if reached[-1].least >= LOW:  # climbs from there gain hundredths at most, for as long again
            return reached
    for _ in range(ROUNDS):
        before = reached[-1].least
        for ahead, edges in TURNS:
            if reached[-1].least >= min(effort.goal, ENOUGH):
                return reached
            keep(climb(hexes, colours, reached[-1], replace(effort, ahead=ahead, edges=edges)))
        if reached[-1].least < before + GAIN:
            break
    return reached


def creep(hexes: Movable, colours: NDArray[Any], best: Placed, effort: Effort) -> Placed:
    """Raise the floor by little at a time, and by half as much again and again where that is not reached.

    Where many hexes are hardly better than the worst, a descent that asks for more raises the many at the cost of a
    few, which end inverted; for this little only the worst go, and those they push.
    """
    for edges in CREEP_EDGES:
        missed = 0
        while missed < CREEPS and best.least < effort.goal:
            little = LITTLE * 0.5**missed
            gentle = replace(effort, ahead=little, edges=edges)
            made = raise_to(hexes, colours, copy(hexes, best.x), best.least + little, best.slack, gentle)
            missed = 0 if made.least >= best.least + 0.5 * little else missed + 1
            best = _better(best, made)
    return best


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


def loosened(
    hexes: Movable, at: Placed, floor: float, loose: float, *, rings: int = 1, within: bool = False
) -> NDArray[Any]:
    """Slack (n,) with that of surface nodes within some rings of hexes below a floor raised to ``loose``.

    ``within``: of those between bodies alone.
    """
    near = np.zeros(hexes.n_nodes, dtype=bool)
    near[hexes.cells[hexes.scaled_jacobian(at.x) < floor]] = True
    for _ in range(rings - 1):
        near[hexes.cells[near[hexes.cells].any(axis=1)]] = True
    sliding = (at.slack >= 0) & (at.slack < FREE)
    if within:
        first, second = np.array(hexes.device.get(hexes.levels)).reshape(2, -1)
        sliding &= (first > 0) | (second >= 0)
    return np.where(near & sliding, np.maximum(at.slack, loose), at.slack)


def placed(hexes: Movable, x: Buffer, slack: NDArray[Any]) -> Placed:
    """Nodes with their least scaled Jacobian."""
    return Placed(x, float(hexes.scaled_jacobian(x).min()), slack)


def copy(hexes: Movable, x: Buffer) -> Buffer:
    """The same nodes in another buffer."""
    out = hexes.device.empty(hexes.planes * hexes.n_nodes)
    hexes.device.launch("optimize.move", hexes.n_nodes, x, hexes.planes, x, hexes.n_nodes, 0.0, 1.0, hexes.scale, out)
    return out


def _better(old: Placed, new: Placed) -> Placed:
    return new if new.least > old.least else old
