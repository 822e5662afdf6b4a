"""Whether triangles close a body, and which way they face."""

import warnings

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, connected_components

from gpubspline.errors import GpubsplineWarning, InputError
from gpubspline.surface.edges import Edges, find_edges
from gpubspline.surface.inside import winding_numbers
from gpubspline.surface.surface import Integers, Surface, spelled

CLOSE = "close its holes, for example with MeshLab's Close Holes, Meshmixer or pymeshfix"
PART = "remove fins and inner walls, or part the bodies that touch"


def closed(surface: Surface, name: str = "the surface") -> Surface:
    """Give the largest body of the surface, all triangles facing outwards, those of cavities into the cavity.

    Bodies that touch along an edge are one.

    Raises
    ------
    InputError, with a place, where an edge belongs to one triangle only (a hole), or to more than two that do not bound
    bodies (a fin, an inner wall), or the surface has one side only. What was turned or left out is warned of.
    """
    edges = find_edges(surface.triangles)
    _refuse(_open(edges), edges, surface, name, "open", CLOSE)
    first, second = edges.pairs(edges.count == 2)
    same = edges.upward[first] == edges.upward[second]
    turned = _turned(surface, edges.owner[first], edges.owner[second], same, name)
    uneven = np.bincount(edges.number, np.where(edges.upward ^ turned[edges.owner], 1.0, -1.0)) != 0
    _refuse(uneven & (edges.count > 2), edges, surface, name, "shared by more than two triangles", PART)
    _refuse(uneven, edges, surface, name, "open", CLOSE)
    triangles = np.where(turned[:, None], surface.triangles[:, ::-1], surface.triangles)
    flipped = int(turned.sum())
    if flipped:
        warnings.warn(
            f"{flipped:,} of {len(turned):,} triangles of {name} faced the other way than their neighbours: turned",
            GpubsplineWarning,
            stacklevel=3,
        )
    return _largest(Surface(surface.points, triangles), edges.connected(edges.count > 1), name)


def _refuse(wrong: NDArray[np.bool_], edges: Edges, surface: Surface, name: str, what: str, advice: str) -> None:
    if wrong.any():
        place = surface.points[edges.sides[edges.order[edges.start[wrong][0]]]].mean(axis=0)
        raise InputError(
            f"expected {name} to be a closed surface, got {int(wrong.sum()):,} edges that are {what}, the first at "
            f"{spelled(place)}: {advice}"
        )


def _open(edges: Edges) -> NDArray[np.bool_]:
    """Edges of one triangle, but for those of fins: of triangles that hang on an edge which others share already."""
    crowded = np.zeros(len(edges.sides) // 3, dtype=bool)
    crowded[edges.owner[(edges.count > 2)[edges.number]]] = True
    return np.asarray((edges.count == 1) & ~crowded[edges.owner[edges.order[edges.start]]])


def _turned(
    surface: Surface, first: Integers, second: Integers, same: NDArray[np.bool_], name: str
) -> NDArray[np.bool_]:
    """Triangles (m,) to turn so that every two neighbours agree; of each body the smaller part."""
    turned = np.zeros(len(surface.triangles), dtype=bool)
    if not same.any():
        return turned
    weight = np.where(same, 2.0, 1.0)  # an explicit value: 0 would be no edge
    graph = coo_array((weight, (first, second)), shape=(len(turned),) * 2).tocsr()
    graph = graph + graph.T
    body = connected_components(graph, directed=False)[1]
    for number in np.unique(body[first[same]]):
        members = np.flatnonzero(body == number)
        order, parent = breadth_first_order(graph, members[0], directed=False)
        for triangle in order[1:].tolist():
            turned[triangle] = turned[parent[triangle]] ^ (graph[triangle, parent[triangle]] > 1.5)
        if 2 * np.count_nonzero(turned[members]) > len(members):
            turned[members] = ~turned[members]
    wrong = (turned[first] ^ turned[second]) != same
    if wrong.any():
        place = surface.corners[first[wrong][0]].mean(axis=0)
        raise InputError(
            f"expected {name} to have an inside and an outside, got a one-sided surface, like a Moebius strip, at "
            f"{spelled(place)}: make it anew from what it came from"
        )
    return turned


def _largest(surface: Surface, body: Integers, name: str) -> Surface:
    """Keep the largest body and the cavities in it, the one facing outwards, the others towards themselves.

    The part of the greatest volume is within no other. What lies in its cavities is another body.
    """
    parts = [Surface(surface.points, surface.triangles[body == number]) for number in range(int(body.max()) + 1)]
    largest = max(parts, key=lambda part: abs(part.volume_mm3))
    held = [part for part in parts if part is not largest and _holds(largest, part)]
    cavities = [part for part in held if not any(_holds(other, part) for other in held if other is not part)]
    inwards = [(part.volume_mm3 < 0) != (part is not largest) for part in (largest, *cavities)]
    if any(inwards):
        what = "is inside out" if len(inwards) == 1 else f"has {sum(inwards)} of {len(inwards)} closed parts inside out"
        warnings.warn(f"{name} {what}: turned", GpubsplineWarning, stacklevel=4)
    if len(parts) > len(inwards):
        others = f"{len(parts) - len(inwards)} more than the largest, which is kept"
        warnings.warn(f"{name} has several bodies, {others}", GpubsplineWarning, stacklevel=4)
    turned = [
        part.triangles[:, ::-1] if wrong else part.triangles
        for part, wrong in zip((largest, *cavities), inwards, strict=True)
    ]
    kept, triangles = np.unique(np.concatenate(turned), return_inverse=True)
    return Surface(surface.points[kept], triangles.reshape(-1, 3))


def _holds(outer: Surface, inner: Surface) -> bool:
    """Whether a closed part lies within another: whether its first point does."""
    place = inner.corners[0, 0]
    low, high = outer.box
    if (place < low).any() or (place > high).any():
        return False
    affine = np.eye(4)
    affine[:3, 3] = place
    return bool(winding_numbers(outer, affine, (1, 1, 1))[0, 0, 0] != 0)
