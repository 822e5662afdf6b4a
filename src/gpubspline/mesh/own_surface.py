"""The surface of a mesh as its boundary nodes walk on it: smooth parts, and the curves where they meet or end."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from gpubspline.device import Device
from gpubspline.mesh.movable import FIXED, FREE, Level, put_pieces
from gpubspline.mesh.pieces import (
    Edges,
    bent,
    bulged,
    corner_normals,
    directions,
    edges_of,
    number,
    segments_of,
    touching,
    triangles_of,
)
from gpubspline.surface.nearest import finder
from gpubspline.surface.surface import Surface

Floats = NDArray[np.float64]
Integers = NDArray[Any]

SHARP_DEGREES = 60.0
"""Angle between the normals of two faces from which their edge is kept: nodes go along it, not across. A node at which
such edges turn by as much stays."""

CUTS, PIECES = (1, 16), 2_000_000
"""Least and most parts that each edge of a face is cut into, and triangles wanted."""


@dataclass(frozen=True, eq=False)
class Held:
    """What holds the nodes of a mesh.

    Attributes
    ----------
    level: the pieces that nodes walk on.
    slack: (n,) 0 on the surface, ``FIXED`` where more than two parts meet or a curve turns sharply, ``FREE`` inside.
    levels: (2, n) whose second row is 0 for nodes on a curve, else -1.
    at: (n,) piece that each node begins on.
    group: (n_pieces,) number of the part or curve that each piece belongs to.
    segments: (s, 2, 3) ends of the pieces of curves, the last ones.
    surface: all faces as they are, cut: the first pieces.
    """

    level: Level
    slack: Floats
    levels: NDArray[np.int32]
    at: NDArray[np.int64]
    group: NDArray[np.int64]
    segments: Floats
    surface: Surface

    def found(self, points: Floats, device: Device) -> NDArray[np.int64]:
        """Piece (n,) of its own part or curve that each node is nearest to at points (n, 3)."""
        at = np.array(self.at)
        on_curve = self.levels[1] >= 0
        own = np.flatnonzero((self.slack == 0) & ~on_curve)
        at[own] = finder(self.surface, device).nearest(points[own])[1]
        n_triangles, middles = len(self.surface.triangles), self.surface.corners.mean(axis=1)
        for node in own[self.group[at[own]] != self.group[self.at[own]]]:
            others = np.flatnonzero(self.group[:n_triangles] == self.group[self.at[node]])
            at[node] = others[np.argmin(np.linalg.norm(middles[others] - points[node], axis=1))]
        for node in np.flatnonzero((self.slack == 0) & on_curve):
            others = np.flatnonzero(self.group[n_triangles:] == self.group[self.at[node]])
            off = np.linalg.norm(self.segments[others].mean(axis=1) - points[node], axis=1)
            at[node] = n_triangles + others[np.argmin(off)]
        return at


def hold(points: Floats, quads: Integers, device: Device, cut: Floats | None = None) -> Held:
    """Let nodes walk on the quads that they are on, and where parts of them meet or end along their edges.

    Arguments
    ---------
    points: (n, 3) coordinates.
    quads: (f, 4) outward faces of the boundary of hexes, or all elements of a mesh of quads.
    cut: (f, c + 1, c + 1, 3) what the faces look like between their corners, at even parameters from corner 0 to 1 and
        from corner 0 to 3; as the normals of what is round their corners say unless given.
    """
    n, edges = len(points), edges_of(quads)
    parts = smooth_parts(points, quads, edges)
    shape = (
        bulged(points[quads], corner_normals(points, quads, parts), max(1, cuts_for(quads) // 2))
        if cut is None
        else cut
    )
    cuts = shape.shape[1] - 1
    numbers = number(quads, edges, n, cuts)
    places = np.zeros((int(numbers.max()) + 1, 3))
    places[numbers] = shape
    places[quads] = points[quads]
    kept = np.flatnonzero((edges.count != 2) | (parts[edges.faces[:, 0]] != parts[edges.faces[:, 1]]))
    curve = _curves(edges, kept, parts)
    if cut is None:
        ends = edges.ends[kept]
        inner = n + kept[:, None] * (cuts - 1) + np.arange(cuts - 1)
        places[inner] = bent(points[ends], directions(points, ends[:, [0, 1, 1]], curve)[:, :2], cuts)
    slack, on_curve = _who_stays(points, quads, parts, edges, kept, curve)
    triangles, segments = triangles_of(numbers), segments_of(edges, kept, n, cuts)
    pieces = np.concatenate([triangles, segments])
    group = np.concatenate([np.repeat(parts, 2 * cuts**2), parts.max() + 1 + np.repeat(curve, cuts)])
    start, around = touching(pieces, group, np.flatnonzero(slack == FIXED))
    at = np.zeros(n, dtype=np.int64)
    for some, first in ((triangles, 0), (segments, len(triangles))):
        own = np.flatnonzero(some < n)
        node = some.reshape(-1)[own]
        right = on_curve[node] == (first > 0)
        at[node[right]] = first + own[right] // 3
    levels = np.stack([np.zeros(n), np.where(on_curve, 0, -1)]).astype(np.int32)
    normals = [
        corner_normals(places, triangles, group[: len(triangles)]),
        directions(places, segments, np.repeat(curve, cuts)),
    ]
    level = put_pieces(places[pieces], np.concatenate(normals), start, around, device)
    return Held(level, slack, levels, at, group, places[segments[:, :2]], Surface(places, triangles))


def cuts_for(quads: Integers) -> int:
    """Parts that each edge of quads (f, 4) is to be cut into."""
    return min(max(int(np.sqrt(PIECES / (2 * len(quads)))), CUTS[0]), CUTS[1])


def smooth_parts(points: Floats, quads: Integers, edges: Edges) -> NDArray[np.int64]:
    """Number (f,) of the smooth part that each face belongs to, the largest part first; ``edges`` of the quads."""
    corners = points[quads]
    normals = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-30)[:, None]
    a, b = edges.faces[edges.count > 1].T
    smooth = np.einsum("ec,ec->e", normals[a], normals[b]) > np.cos(np.radians(SHARP_DEGREES))
    joined = coo_matrix((np.ones(smooth.sum()), (a[smooth], b[smooth])), shape=(len(quads), len(quads)))
    _, labels = connected_components(joined, directed=False)
    by_size = np.argsort(-np.bincount(labels), kind="stable")
    return np.asarray(np.argsort(by_size)[labels])


def _curves(edges: Edges, kept: Integers, parts: Integers) -> Integers:
    """Number of the curve that each kept edge belongs to: edges between the same parts, or at the end of one."""
    sides = np.sort(parts[edges.faces[kept]], axis=1)
    rim = edges.count[kept] == 1
    key = np.stack([sides[:, 0], np.where(rim, -1, sides[:, 1]), edges.count[kept]], axis=1)
    return np.unique(key, axis=0, return_inverse=True)[1].reshape(-1) if len(kept) else np.zeros(0, dtype=np.int64)


def _who_stays(
    points: Floats, quads: Integers, parts: Integers, edges: Edges, kept: Integers, curve: Integers
) -> tuple[Floats, NDArray[np.bool_]]:
    """Slack (n,) and whether each node (n,) is on a curve: where two edges of one go on without a sharp turn."""
    n = len(points)
    node, own = edges.ends[kept].reshape(-1), np.repeat(np.arange(len(kept)), 2)
    order = np.argsort(node, kind="stable")
    count = np.bincount(node, minlength=n)
    first = np.cumsum(count) - count
    two = np.flatnonzero(count == 2)
    one, other = own[order[first[two]]], own[order[first[two] + 1]]
    far = [edges.ends[kept[side]].sum(axis=1) - two for side in (one, other)]
    ways = [points[end] - points[two] for end in far]
    ways = [way / np.maximum(np.linalg.norm(way, axis=1), 1e-30)[:, None] for way in ways]
    straight = -np.einsum("ec,ec->e", *ways) > np.cos(np.radians(SHARP_DEGREES))
    on_curve = np.zeros(n, dtype=bool)
    on_curve[two[straight & (curve[one] == curve[other])]] = True
    touched = np.unique(np.stack([quads.ravel(), np.repeat(parts, 4)], axis=1), axis=0)[:, 0]
    of_parts = np.bincount(touched, minlength=n)
    stays = ~on_curve & ((count > 0) | (of_parts > 1))
    return np.where(of_parts == 0, FREE, np.where(stays, FIXED, 0.0)), on_curve
