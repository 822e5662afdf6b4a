"""Raise the worst scaled Jacobian of hexes: settle all, raise floors under the worst, mend those that are poor."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.device import Buffer
from gpubspline.mesh.floors import CAP, Effort, Placed, better, climb, copy, placed, polish
from gpubspline.mesh.mend import POOR, as_long_as_now, loosened, mend
from gpubspline.mesh.movable import Goal, Movable
from gpubspline.mesh.quasi_newton import descend

EDGES = 0.005
"""Weight of even edges while all hexes are improved."""

TANGLED, LOOSE = 0.3, ((0.5, True), (0.5, False), (1.0, False))
"""Where hexes stay inverted after the first descent those below this have the surface nodes round them loosened by so
many target lengths. First, where there are bodies that touch, only those between them: that changes no outer surface.
"""

AGAIN = 3
"""Most times that the first descent goes on where hexes are left below that."""


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
        best = better(best, relaxed(hexes, copy(hexes, best.x), slack, effort))
    for loose, within in LOOSE if effort.loosen else ():
        if best.least > 0:
            break
        slack = loosened(hexes, best, TANGLED, loose, within=within)
        if np.array_equal(slack, best.slack):
            continue
        hexes = hexes.with_slack(slack)
        best = better(best, relaxed(hexes, copy(hexes, best.x), slack, effort))
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
    return hexes, better(best, polish(hexes, colours, climb(hexes, colours, mended, effort), effort))


def relaxed(hexes: Movable, x: Buffer, slack: NDArray[Any], effort: Effort) -> Placed:
    """Lower the energy of all hexes."""
    x, _ = descend(hexes, x, Goal(1.0, 2, EDGES), steps=effort.steps, cap=CAP)
    return placed(hexes, x, slack)
