"""Climbing on where floors were not reached: asking for more and for less in turn, and for very little at once."""

from dataclasses import replace
from typing import Any

from numpy.typing import NDArray

from gpubspline.mesh.floors import Effort, Placed, better, climb, copy, raise_to
from gpubspline.mesh.movable import Movable

TURNS = ((0.1, 1e-3), (0.2, 1e-3), (0.05, 1e-3), (0.1, 1e-4), (0.2, 1e-4), (0.05, 1e-4))
"""What ``persist`` asks for in turn: how much more than the floor, and the weight of even edges."""

ROUNDS, GAIN = 3, 0.03
"""Most rounds of these, and what each must gain for another."""

ENOUGH = 0.35
"""Least scaled Jacobian at which ``persist`` stops."""

LOW, LITTLE, CREEPS, CREEP_EDGES = 0.1, 0.02, 3, (1e-3, 1e-4, 1e-5)
"""Least scaled Jacobian below which ``persist`` creeps: by how much at once, how often that is halved, and the weights
of even edges in turn."""


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
            best = better(best, made)
    return best
