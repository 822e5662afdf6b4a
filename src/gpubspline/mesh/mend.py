"""Poor hexes mended alone, with surface nodes round them let go, from where all were settled."""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.device import Buffer
from gpubspline.mesh.floors import Effort, Placed, better, raise_to
from gpubspline.mesh.movable import FREE, Movable, node_sizes, node_slots
from gpubspline.mesh.neighbourhood import edge_lengths, hexes_round, target_lengths

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
        best, before, below = better(best, latest), below, hexes.scaled_jacobian(latest.x) < floor
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
