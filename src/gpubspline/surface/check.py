"""Whether triangles close a body, and which way they face."""

import warnings

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, connected_components

from gpubspline.errors import GpubsplineWarning, InputError
from gpubspline.surface.inside import winding_numbers
from gpubspline.surface.surface import Integers, Surface, spelled


def closed(surface: Surface, name: str = "the surface") -> Surface:
    """Give the largest body of the surface, all triangles facing outwards, those of cavities into the cavity.

    Raises
    ------
    InputError, with a place, where an edge belongs to one triangle only (a hole) or to more than two (a fin, bodies
    that touch), or the surface has one side only. What was turned or left out is warned of.
    """
    first, second, same = _neighbours(surface, name)
    turned = _turned(surface, first, second, same, name)
    triangles = np.where(turned[:, None], surface.triangles[:, ::-1], surface.triangles)
    flipped = int(turned.sum())
    if flipped:
        warnings.warn(
            f"{flipped:,} of {len(turned):,} triangles of {name} faced the other way than their neighbours: turned",
            GpubsplineWarning,
            stacklevel=3,
        )
    return _largest(Surface(surface.points, triangles), _bodies(len(turned), first, second), name)


def _neighbours(surface: Surface, name: str) -> tuple[Integers, Integers, NDArray[np.bool_]]:
    """Pairs of triangles across each edge, and whether both run along it in the same direction."""
    t = surface.triangles
    sides = np.concatenate([t[:, [0, 1]], t[:, [1, 2]], t[:, [2, 0]]])
    owner, upward = np.tile(np.arange(len(t)), 3), sides[:, 0] < sides[:, 1]
    key = sides.min(axis=1) * len(surface.points) + sides.max(axis=1)
    order = np.argsort(key, kind="stable")
    _, start, count = np.unique(key[order], return_index=True, return_counts=True)
    alone = _open_sides(owner[order], start, count)
    for wrong, what, advice in (
        (alone, "open", "close its holes, for example with MeshLab's Close Holes, Meshmixer or pymeshfix"),
        (count > 2, "shared by more than two triangles", "remove fins and inner walls, or part the bodies that touch"),
    ):
        if wrong.any():
            place = surface.points[sides[order[start[wrong][0]]]].mean(axis=0)
            raise InputError(
                f"expected {name} to be a closed surface, got {int(wrong.sum()):,} edges that are {what}, the first at "
                f"{spelled(place)}: {advice}"
            )
    one, other = order[start], order[start + 1]
    return owner[one], owner[other], upward[one] == upward[other]


def _open_sides(owner: Integers, start: Integers, count: Integers) -> NDArray[np.bool_]:
    """Edges of one triangle, but for those of fins: of triangles that hang on an edge which others share already."""
    crowded = np.zeros(int(owner.max()) + 1, dtype=bool)
    crowded[owner[np.repeat(count > 2, count)]] = True
    return np.asarray((count == 1) & ~crowded[owner[start]])


def _bodies(n_triangles: int, first: Integers, second: Integers) -> Integers:
    """Number (m,) of the connected body of each triangle."""
    graph = coo_array((np.ones(len(first)), (first, second)), shape=(n_triangles, n_triangles))
    return np.asarray(connected_components(graph, directed=False)[1])


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
    body = _bodies(len(turned), first, second)
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
