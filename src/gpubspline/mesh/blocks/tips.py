"""Tips of thin features that stand out of a mesh: a surface node is drawn out to each, and held there.

A spike thinner than an element is smoothed away with what no element can follow. It is measured on the mesh that was
made, and a node of the surface at its foot goes up it until little is left; the hexes round it follow.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from gpubspline.device import Device
from gpubspline.mesh.blocks.level_set import ON_SURFACE, LevelSet
from gpubspline.mesh.blocks.reach import MOST_LOST
from gpubspline.mesh.coverage import find_outside
from gpubspline.mesh.floors import Effort, Placed
from gpubspline.mesh.improve import improve
from gpubspline.mesh.mend import POOR
from gpubspline.mesh.mesh import Mesh
from gpubspline.mesh.movable import FIXED, FREE, Movable
from gpubspline.mesh.neighbourhood import Neighbourhood, hexes_round, neighbourhood
from gpubspline.mesh.validity import certify

Floats = NDArray[np.float64]

OUT = 1.15
"""How far, in elements, a tip may stand out of the mesh."""

LEFT = 1.13
"""What is left of one that stands out farther: to draw it out more than it must makes the hexes round it worse."""

FEET = 3
"""How many of the nodes near a tip are tried, the nearest first."""

WAYS = tuple((foot, loose) for loose in (0.0, 0.15, 0.3) for foot in range(FEET))
"""Which of them is drawn out to it, and how far, in elements, nodes round that one may leave the surface: tried in turn
until it costs little, else the way that leaves the best hexes is taken.
"""

CHEAP, GAINED = 0.62, 0.01
"""Worst scaled Jacobian that is cheap, whatever it was before; by how much a way must be better than earlier ones."""

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
    """Draw surface nodes out to tips of the region that its mesh does not reach, as far as no hex gets poor.

    Tips that stand out no farther than allowed are followed where that costs nothing, others by the way that costs
    least.
    """
    left, tried = level.places, 0
    for _ in range(ROUNDS):
        out_at, out = stand_out(_points(hexes, best), hexes.cells, left, hexes.device)
        if not len(out):
            break
        for number in _apart(out_at, out)[: MOST - tried]:
            tip, tried = out_at[number], tried + 1
            made = _drawn(hexes, best, tip, level, needed=bool(out[number] > MOST_LOST))
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


def _apart(places: Floats, out: Floats) -> list[int]:
    """Numbers of places (p, 3) that stand out farthest, none near a farther one."""
    chosen = list[int]()
    for number in np.argsort(-out, kind="stable"):
        if all(np.linalg.norm(places[number] - places[other]) > APART for other in chosen):
            chosen.append(int(number))
    return chosen


def _drawn(hexes: Movable, best: Placed, tip: Floats, level: LevelSet, *, needed: bool) -> Placed | None:
    """Draw a node out to a tip; None where a hex gets poor, it is too far, or worse hexes do not pay for it.

    ``needed``: the tip stands out farther than allowed. Others are followed only where that costs nothing.
    """
    points = _points(hexes, best)
    cheap = min(best.least, CHEAP if needed else WANTED)
    floor = min(best.least, POOR) if needed else cheap
    taken: tuple[Neighbourhood, Placed, NDArray[Any]] | None = None
    feet = _nearest(hexes, best, points, tip)
    for foot, loose in WAYS if needed else WAYS[:FEET]:
        if taken is not None and taken[1].least >= cheap:
            break
        target = _target(points[feet[foot]], tip, level, needed=needed) if foot < len(feet) else None
        way = None if target is None else _pulled(hexes, best, points, feet[foot], target, loose)
        if way is not None and way[1].least >= (floor if taken is None else taken[1].least + GAINED):
            taken = way if _is_sound(way[0], way[1]) else taken
    if taken is None:
        return None
    near, made, slack = taken
    points[near.nodes] = _points(near.hexes, made)
    x = hexes.device.put(np.ascontiguousarray(points.T))
    return Placed(x, float(hexes.scaled_jacobian(x).min()), slack)


def _target(foot: Floats, tip: Floats, level: LevelSet, *, needed: bool) -> Floats | None:
    """Where a node goes so that little is left of a tip; None if too far, or off the surface without need."""
    length = float(np.linalg.norm(tip - foot))
    if length - LEFT > LONGEST:
        return None
    target = level.on_region(foot + (tip - foot) * max(0.0, 1 - LEFT / length))
    on = needed or abs(float(level.region_distance(target[None])[0])) <= ON_SURFACE
    return target if on else None


def _pulled(
    hexes: Movable, best: Placed, points: Floats, foot: int, target: Floats, loose: float
) -> tuple[Neighbourhood, Placed, NDArray[Any]]:
    """Hexes round a node that is drawn out to its target, where their nodes go, and the slack (n,) of all."""
    around = np.any(hexes.cells == foot, axis=1)
    slack = best.slack.copy()
    ring = np.unique(hexes.cells[around])
    ring = ring[(slack[ring] >= 0) & (slack[ring] < FREE)]
    slack[ring], slack[foot] = np.maximum(slack[ring], loose), FIXED
    near = neighbourhood(hexes, slack, hexes_round(hexes, around, RINGS))
    given = points[near.nodes]
    given[near.nodes == foot] = target
    made = improve(near.hexes, near.colours, hexes.device.put(given.T), near.slack, Effort(WANTED, loosen=False))
    return near, made, slack


def _nearest(hexes: Movable, best: Placed, points: Floats, tip: Floats) -> NDArray[Any]:
    """Numbers of the nodes that slide on the outer surface alone, the nearest to a tip first."""
    first, second = np.array(hexes.device.get(hexes.levels)).reshape(2, -1)
    sliding = np.flatnonzero((best.slack >= 0) & (best.slack < FREE) & (first == 0) & (second < 0))
    return sliding[np.argsort(np.linalg.norm(points[sliding] - tip, axis=1), kind="stable")[:FEET]]


def _is_sound(near: Neighbourhood, made: Placed) -> bool:
    mesh = Mesh(_points(near.hexes, made), "hex8", connectivity=near.hexes.cells)
    return certify(mesh, near.hexes.device).certificate.least_ratio >= TINY


def _points(hexes: Movable, at: Placed) -> Floats:
    """Nodes (n, 3)."""
    return np.asarray(np.array(hexes.device.get(at.x)).reshape(3, -1).T, dtype=np.float64)
