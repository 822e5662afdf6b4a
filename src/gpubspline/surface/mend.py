"""Small faults of surfaces that can be mended in one way only: triangles given twice, fins, loose bits, small holes.

What is not small stays as it is, for ``check`` to refuse. No library does this under a licence that may be depended on
and without VTK, which is optional here: MeshFix, MeshLab and CGAL are under the GPL, trimesh closes holes of three and
four edges alone.
"""

from dataclasses import dataclass

import numpy as np

from gpubspline.surface.edges import Edges, find_edges
from gpubspline.surface.surface import Floats, Integers, Surface, spelled

SMALL = 0.01
"""Of the surface's area: what one piece that is dropped, and all that closes holes, may have."""

MOST_DROPPED = 0.05
"""Of the surface's area: what all pieces that are dropped may have."""

MOST_EDGES = 24
"""Of a hole that is closed."""

ROUNDS = 4


@dataclass(frozen=True)
class Mending:
    """Something that was mended: how many, what, the first word with an s a plural, and the place of the first, mm."""

    count: int
    what: str
    place: Floats

    def __str__(self) -> str:
        """One phrase."""
        what = self.what if self.count > 1 else self.what.replace("s ", " ", 1)
        return f"{self.count:,} {what}, the first at {spelled(self.place)}"


def mended(surface: Surface) -> tuple[Surface, list[Mending]]:
    """Drop triangles given twice, fins, loose bits and small open bodies, close small holes; and tell what was done."""
    found: list[Mending] = []
    for step in (_each_once, _without_flaps, _without_holes, _without_open_bodies):
        surface, done = step(surface)
        found += done
    return surface, found


def _each_once(surface: Surface) -> tuple[Surface, list[Mending]]:
    _, first = np.unique(np.sort(surface.triangles, axis=1), axis=0, return_index=True)
    again = np.ones(len(surface.triangles), dtype=bool)
    again[first] = False
    return _without(surface, np.flatnonzero(again), "triangles given twice dropped")


def _without(surface: Surface, dropped: Integers, what: str) -> tuple[Surface, list[Mending]]:
    if not len(dropped):
        return surface, []
    rest = Surface(surface.points, np.delete(surface.triangles, dropped, axis=0))
    return rest, [Mending(len(dropped), what, surface.corners[dropped[0]].mean(axis=0))]


def _without_flaps(surface: Surface) -> tuple[Surface, list[Mending]]:
    """Drop small pieces without which the rest is whole where they were: fins, walls inside, loose triangles."""
    found: list[Mending] = []
    for _ in range(ROUNDS):
        edges = find_edges(surface.triangles)
        flaps = _flaps(surface, edges)
        if not len(flaps) or _area(surface, flaps) > MOST_DROPPED * surface.area_mm2:
            break
        surface, done = _without(surface, flaps, "triangles of fins, inner walls or loose bits dropped")
        found += done
    return surface, found


def _area(surface: Surface, triangles: Integers) -> float:
    return float(np.linalg.norm(surface.normals[triangles], axis=1).sum() / 2)


def _flaps(surface: Surface, edges: Edges) -> Integers:
    """Triangles of the pieces that can go, the smallest first, as long as each leaves no edge open behind."""
    piece = edges.connected(edges.count == 2)
    areas = np.bincount(piece, np.linalg.norm(surface.normals, axis=1) / 2)
    border = np.flatnonzero((edges.count != 2)[edges.number])
    key = piece[border % len(piece)] * len(edges.count) + edges.number[border]
    key, own = np.unique(key, return_counts=True)
    of_piece, edge = np.divmod(key, len(edges.count))
    pieces, start = np.unique(of_piece, return_index=True)
    parts = np.split(np.arange(len(key)), start[1:])
    left, gone = edges.count.copy(), np.zeros(len(areas), dtype=bool)
    for n in np.argsort(areas[pieces], kind="stable"):
        after = left[edge[parts[n]]] - own[parts[n]]
        if areas[pieces[n]] <= SMALL * areas.sum() and (after != 1).all():
            left[edge[parts[n]]] = after
            gone[pieces[n]] = True
    return np.flatnonzero(gone[piece])


def _without_holes(surface: Surface) -> tuple[Surface, list[Mending]]:
    """Close small holes: by a triangle, or by triangles from the middle of the loop."""
    loops = [loop for loop in _loops(find_edges(surface.triangles)) if len(loop) <= MOST_EDGES]
    fans = [_fan(surface.points[loop]) for loop in loops]
    if not loops or sum(area for _, area in fans) > SMALL * surface.area_mm2:
        return surface, []
    points, triangles = [surface.points], [surface.triangles]
    for n, (loop, (middle, _)) in enumerate(zip(loops, fans, strict=True)):
        centre = np.full(len(loop), len(surface.points) + n)
        points.append(middle[None])
        fan = np.stack([loop, np.roll(loop, -1), centre], axis=1)
        triangles.append(loop[None] if len(loop) == 3 else fan)
    longest = max(np.linalg.norm(np.diff(surface.points[[*loop, loop[0]]], axis=0), axis=1).sum() for loop in loops)
    what = f"holes of up to {max(map(len, loops))} edges closed, the longest {longest:.3g} mm round"
    return Surface(np.concatenate(points), np.concatenate(triangles)), [Mending(len(loops), what, fans[0][0])]


def _loops(edges: Edges) -> list[Integers]:
    """Points of loops of open edges, against the direction of their triangles; no point twice in one."""
    after: dict[int, list[int]] = {}
    for a, b in edges.sides[(edges.count == 1)[edges.number]].tolist():
        after.setdefault(b, []).append(a)
    loops, way = [], list[int]()
    while after:
        way = way or [next(iter(after))]
        on = after.get(way[-1])
        if not on:  # no loop: triangles there face either way
            after.pop(way.pop(), None)
            continue
        point = on.pop()
        if not on:
            del after[way[-1]]
        if point in way:
            first = way.index(point)
            loops.append(np.array(way[first:]))
            way = way[: first + 1] if first else []
        else:
            way.append(point)
    return loops


def _fan(loop: Floats) -> tuple[Floats, float]:
    """Middle (3,) of a loop (n, 3), and the area of the triangles from there."""
    middle = loop.mean(axis=0)
    to = loop - middle
    return middle, float(np.linalg.norm(np.cross(to, np.roll(to, -1, axis=0)), axis=1).sum() / 2)


def _without_open_bodies(surface: Surface) -> tuple[Surface, list[Mending]]:
    """Leave out bodies that are open where a closed one is larger: the largest alone is kept in any case."""
    edges = find_edges(surface.triangles)
    body = edges.connected(edges.count > 1)
    areas = np.bincount(body, np.linalg.norm(surface.normals, axis=1) / 2)
    is_open = np.zeros(len(areas), dtype=bool)
    is_open[body[edges.owner[(edges.count == 1)[edges.number]]]] = True
    if not is_open.any() or is_open[np.argmax(areas)]:
        return surface, []
    rest, _ = _without(surface, np.flatnonzero(is_open[body]), "")
    place = surface.corners[np.argmax(is_open[body])].mean(axis=0)
    return rest, [Mending(int(is_open.sum()), "open shells smaller than the largest body left out", place)]
