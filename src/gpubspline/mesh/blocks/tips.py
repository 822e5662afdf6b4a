"""Tips of thin features that stand out of a mesh: a surface node is drawn out to each, and held there.

A spike thinner than an element is smoothed away with what no element can follow. It is measured on the mesh that was
made, and a node of the surface at its foot goes up it until little is left; the hexes round it follow.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from gpubspline.device import Device
from gpubspline.mesh.blocks.level_set import LevelSet
from gpubspline.mesh.coverage import find_outside
from gpubspline.mesh.improve import POOR, Effort, Placed, improve
from gpubspline.mesh.mesh import Mesh
from gpubspline.mesh.movable import FIXED, FREE, Movable
from gpubspline.mesh.neighbourhood import Neighbourhood, hexes_round, neighbourhood
from gpubspline.mesh.validity import certify

Floats = NDArray[np.float64]

OUT = 1.15
"""How far, in elements, a tip may stand out of the mesh."""

LEFT = 1.12
"""What is left of one that stands out farther: to draw it out more than it must makes the hexes round it worse."""

LOOSE = (0.0, 0.15, 0.3)
"""How far, in elements, nodes round it may leave the surface, tried in turn until no hex is poor."""

LONGEST = 1.5
"""Farthest, in elements, that a node is drawn out."""

APART = 6.0
"""Distance, in elements, of tips that do not feel each other: near ones are measured again after the farthest one."""

ROUNDS = 8
"""Most times that tips are looked for."""

MOST = 40
"""Most tips that are tried: a region that has more is porous or rough, and asks for a smaller size."""

RINGS = 4
"""Rings of hexes round a node that move with it."""

WANTED = 0.66
"""Scaled Jacobian beyond which no more is asked of them."""

TINY = 0.03
"""A hex whose least determinant is a smaller part of its mean one is poor, whatever its angles."""


def draw_out(hexes: Movable, best: Placed, level: LevelSet) -> Placed:
    """Draw surface nodes out to tips of the region that its mesh does not reach, as far as no hex gets poor."""
    left, tried = level.places, 0
    for _ in range(ROUNDS):
        out_at, out = stand_out(_points(hexes, best), hexes.cells, left, hexes.device)
        if not len(out):
            break
        for tip in _apart(out_at, out)[: MOST - tried]:
            tried += 1
            made = _drawn(hexes, best, tip, level)
            if made is None:
                left = left[np.linalg.norm(left - tip, axis=1) > OUT]
            else:
                best = made
    return best


def stand_out(points: NDArray[Any], cells: NDArray[np.int32], places: Floats, device: Device) -> tuple[Floats, Floats]:
    """Those of the places (p, 3) that stand out of a mesh farther than ``OUT``, and how far.

    None of them has a node of the mesh's surface as near: few are left to be measured.
    """
    if not len(places):
        return places, np.empty(0)
    mesh = Mesh(points, "hex8", connectivity=cells)
    tree = KDTree(points[mesh.boundary_nodes()])
    places = places[tree.query(places, workers=-1)[0] > OUT]
    if not len(places):
        return places, np.empty(0)
    out, outside = find_outside(mesh, places, device)
    kept = outside & (out > OUT)
    return places[kept], out[kept]


def _apart(places: Floats, out: Floats) -> list[Floats]:
    """Places (p, 3) that stand out farthest, none near a farther one."""
    chosen = list[Floats]()
    for place in places[np.argsort(-out, kind="stable")]:
        if all(np.linalg.norm(place - other) > APART for other in chosen):
            chosen.append(place)
    return chosen


def _drawn(hexes: Movable, best: Placed, tip: Floats, level: LevelSet) -> Placed | None:
    """Draw the nearest node out to a tip; None where a hex gets poor, or it is too far."""
    points = _points(hexes, best)
    foot = _nearest(hexes, best, points, tip)
    way = tip - points[foot]
    length = float(np.linalg.norm(way))
    around = np.any(hexes.cells == foot, axis=1)
    for loose in LOOSE if length - LEFT <= LONGEST else ():
        slack = best.slack.copy()
        ring = np.unique(hexes.cells[around])
        ring = ring[(slack[ring] >= 0) & (slack[ring] < FREE)]
        slack[ring], slack[foot] = np.maximum(slack[ring], loose), FIXED
        near = neighbourhood(hexes, slack, hexes_round(hexes, around, RINGS))
        given = points[near.nodes]
        given[near.nodes == foot] = level.on_region(points[foot] + way * max(0.0, 1 - LEFT / length))
        made = improve(near.hexes, near.colours, hexes.device.put(given.T), near.slack, Effort(WANTED, loosen=False))
        if _is_sound(near, made, min(POOR, best.least)):
            points[near.nodes] = _points(near.hexes, made)
            x = hexes.device.put(np.ascontiguousarray(points.T))
            return Placed(x, float(hexes.scaled_jacobian(x).min()), slack)
    return None


def _nearest(hexes: Movable, best: Placed, points: Floats, tip: Floats) -> int:
    """Number of the node nearest to a tip that slides on the outer surface alone."""
    first, second = np.array(hexes.device.get(hexes.levels)).reshape(2, -1)
    sliding = np.flatnonzero((best.slack >= 0) & (best.slack < FREE) & (first == 0) & (second < 0))
    return int(sliding[np.argmin(np.linalg.norm(points[sliding] - tip, axis=1))])


def _is_sound(near: Neighbourhood, made: Placed, floor: float) -> bool:
    mesh = Mesh(_points(near.hexes, made), "hex8", connectivity=near.hexes.cells)
    return made.least >= floor and certify(mesh, near.hexes.device).certificate.least_ratio >= TINY


def _points(hexes: Movable, at: Placed) -> Floats:
    """Nodes (n, 3)."""
    return np.asarray(np.array(hexes.device.get(at.x)).reshape(3, -1).T, dtype=np.float64)
