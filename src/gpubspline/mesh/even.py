"""Longer shortest edges where scaled Jacobians, which do not see lengths, let hexes shrink at a corner."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gpubspline.device import Buffer
from gpubspline.mesh.floors import CAP, Placed
from gpubspline.mesh.movable import Goal, Movable
from gpubspline.mesh.neighbourhood import (
    Neighbourhood,
    edge_lengths,
    hexes_round,
    least_determinant,
    neighbourhood,
    target_lengths,
    with_targets,
)
from gpubspline.mesh.quasi_newton import descend

Floats = NDArray[np.float64]

SHORT, SMALL = 0.2, 0.2
"""Hexes with an edge below so many target lengths, or a determinant below this part of their mean one, are mended."""

RINGS = 2
"""Rings of hexes round them that move too."""

LEAST_TARGET = 0.5
"""Edges are drawn to the mean of the four of their direction, but not to less than this part of their target."""

STAGES = ((0.1, 0.005, 60), (0.05, 0.002, 100), (0.02, 0.0005, 100), (0.01, 0.0002, 300))
"""How much more than the floor is asked of corners, the weight of even edges, and the most steps of descent.

First edges are drawn out, then scaled Jacobians are raised again. Moves of single nodes, which see nothing else, would
draw the edges in again.
"""

GIVEN = 0.005
"""Most that the worst scaled Jacobian may lose."""


def even_out(hexes: Movable, best: Placed) -> Placed:
    """Raise the least determinant of hexes, over their mean one, where edges are short."""
    device = hexes.device
    points = np.array(device.get(best.x)).reshape(3, -1).T.astype(np.float64)
    shortest = (edge_lengths(points, hexes.cells).min(axis=2) / target_lengths(hexes)).min(axis=0)
    bad = (shortest < SHORT) | (least_determinant(points, hexes.cells) < SMALL)
    if not bad.any():
        return best
    near = neighbourhood(hexes, best.slack, hexes_round(hexes, bad, RINGS))
    own = points[near.nodes]
    x = _drawn_out(near, own, best.least)
    points[near.nodes] = moved = np.array(device.get(x)).reshape(3, -1).T
    raised = least_determinant(moved, near.hexes.cells).min() > least_determinant(own, near.hexes.cells).min()
    if not raised or near.hexes.scaled_jacobian(x).min() < best.least - GIVEN:
        return best
    x = device.put(points.T)
    return replace(best, x=x, least=float(hexes.scaled_jacobian(x).min()))


def _drawn_out(near: Neighbourhood, own: Floats, floor: float) -> Buffer:
    targets = np.maximum(edge_lengths(own, near.hexes.cells).mean(axis=2), LEAST_TARGET * target_lengths(near.hexes))
    hexes = with_targets(near.hexes, targets)
    x = hexes.device.put(own.T)
    for ahead, weight, steps in STAGES:
        x, _ = descend(hexes, x, Goal(floor + ahead, 2, weight), steps=steps, cap=CAP)
    return x
