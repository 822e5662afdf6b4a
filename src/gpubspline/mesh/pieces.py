"""A surface of quads cut into small triangles, and its curves into segments, with what touches each: to walk on."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

Floats = NDArray[np.float64]
Integers = NDArray[Any]


CREASE_DEGREES = 30.0
"""Between a face and the mean of those round a point from which they meet there in creases instead of smoothly."""


@dataclass(frozen=True, eq=False)
class Edges:
    """Edges of quads (f, 4), each once.

    Attributes
    ----------
    ends: (e, 2) nodes, the lower number first.
    of_face: (f, 4) edge from each corner to the next.
    faces: (e, 2) first and last face that has the edge.
    count: (e,) how many have.
    """

    ends: Integers
    of_face: Integers
    faces: Integers
    count: Integers


def edges_of(quads: Integers) -> Edges:
    """Find the edges of quads."""
    ends = np.sort(np.stack([quads, np.roll(quads, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    unique, own, count = np.unique(ends, axis=0, return_inverse=True, return_counts=True)
    own = own.reshape(-1)
    order = np.argsort(own, kind="stable")
    first = np.cumsum(count) - count
    faces = np.stack([order[first], order[first + count - 1]], axis=1) // 4
    return Edges(unique, own.reshape(-1, 4), faces, count)


def bilinear(corners: Floats, cuts: int) -> Floats:
    """Points (f, cuts + 1, cuts + 1, c) at even parameters of quads (f, 4, c), from corner 0 to 1 and from 0 to 3."""
    return np.asarray(np.einsum("abk,fkc->fabc", _weights(cuts), corners))


def bulged(corners: Floats, normals: Floats, cuts: int) -> Floats:
    """The same of quads that bulge as the normals (f, 4, 3) at their corners say: half way to the tangent planes there.

    Exact to second order. Source: Boubekeur and Alexa 2008 (Phong tessellation).
    """
    flat = bilinear(corners, cuts)
    off = np.einsum("fabkc,fkc->fabk", flat[..., None, :] - corners[:, None, None], normals)
    return np.asarray(flat - 0.5 * np.einsum("abk,fabk,fkc->fabc", _weights(cuts), off, normals))


def bent(ends: Floats, directions: Floats, cuts: int) -> Floats:
    """Points (e, cuts - 1, 3) within edges (e, 2, 3) that bend as the directions (e, 2, 3) at their ends say."""
    at = np.linspace(0.0, 1.0, cuts + 1)[1:-1, None]
    share = np.concatenate([1 - at, at], axis=1)
    flat = np.einsum("ak,ekc->eac", share, ends)
    along = np.einsum("eakc,ekc->eak", flat[:, :, None] - ends[:, None], directions)
    tangent = ends[:, None] + along[..., None] * directions[:, None]
    return np.asarray(0.5 * (flat + np.einsum("ak,eakc->eac", share, tangent)))


def _weights(cuts: int) -> Floats:
    """(cuts + 1, cuts + 1, 4) of the corners of a quad."""
    at = np.linspace(0.0, 1.0, cuts + 1)
    a, b = at[:, None], at[None, :]
    return np.stack([(1 - a) * (1 - b), a * (1 - b), a * b, (1 - a) * b], axis=-1)


def number(quads: Integers, edges: Edges, n: int, cuts: int) -> Integers:
    """Numbers (f, cuts + 1, cuts + 1) of the points of cut quads: nodes, then those of edges, then those inside."""
    k = cuts - 1
    numbers = np.empty((len(quads), cuts + 1, cuts + 1), dtype=np.int64)
    for corner, (a, b) in enumerate(((0, 0), (cuts, 0), (cuts, cuts), (0, cuts))):
        numbers[:, a, b] = quads[:, corner]
    inner = np.arange(k)
    middle = slice(1, cuts)
    sides: tuple[tuple[tuple[Any, Any], int, int, int], ...] = (
        ((middle, 0), 0, 0, 1),
        ((cuts, middle), 1, 1, 2),
        ((middle, cuts), 2, 3, 2),
        ((0, middle), 3, 0, 3),
    )
    for (a, b), side, begin, end in sides:
        turned = quads[:, begin] > quads[:, end]
        numbers[:, a, b] = n + edges.of_face[:, side, None] * k + np.where(turned[:, None], k - 1 - inner, inner)
    first = n + len(edges.ends) * k
    numbers[:, middle, middle] = first + np.arange(len(quads) * k * k).reshape(-1, k, k)
    return numbers


def triangles_of(numbers: Integers) -> Integers:
    """Triangles (2 f cuts^2, 3), those of a face together."""
    a, b, c, d = numbers[:, :-1, :-1], numbers[:, 1:, :-1], numbers[:, 1:, 1:], numbers[:, :-1, 1:]
    two = np.stack([np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)], axis=-2)
    return np.asarray(two.reshape(-1, 3))


def segments_of(edges: Edges, chosen: Integers, n: int, cuts: int) -> Integers:
    """Segments (chosen * cuts, 3) of edges, as triangles whose second and third corner are one."""
    k = cuts - 1
    inner = n + chosen[:, None] * k + np.arange(k)
    chain = np.concatenate([edges.ends[chosen, :1], inner, edges.ends[chosen, 1:]], axis=1)
    return np.stack([chain[:, :-1], chain[:, 1:], chain[:, 1:]], axis=-1).reshape(-1, 3)


def touching(pieces: Integers, group: Integers, closed: Integers) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Other pieces of its group that share a point with each piece, (pieces + 1,) where they begin and what they are.

    ``closed``: numbers of points through which segments do not go on.
    """
    points = int(pieces.max()) + 1
    through = np.ones(points, dtype=bool)
    through[closed] = False
    used = through[pieces] | (pieces[:, 1] != pieces[:, 2])[:, None]
    rows = np.broadcast_to(np.arange(len(pieces))[:, None], pieces.shape)[used]
    keys = (group[:, None].astype(np.int64) * points + pieces)[used]
    _, columns = np.unique(keys, return_inverse=True)
    has = csr_matrix(
        (np.ones(len(rows), dtype=np.int32), (rows, columns.reshape(-1))), shape=(len(pieces), columns.max() + 1)
    )
    meets = (has @ has.T).tocsr()
    meets.setdiag(0)
    meets.eliminate_zeros()
    meets.sort_indices()
    return meets.indptr.astype(np.int32), meets.indices.astype(np.int32)


def corner_normals(places: Floats, faces: Integers, group: Integers) -> Floats:
    """Unit normals (f, k, 3) at the corners of triangles or quads, the same for all of one group that share a point.

    Where those turn too much at a point, each face keeps its own there.
    """
    k = faces.shape[1]
    corners = places[faces]
    weighted = np.cross(corners[:, 2] - corners[:, 0], corners[:, k - 1] - corners[:, 1])
    return _agreed(faces, group, weighted, _unit(weighted))


def directions(places: Floats, segments: Integers, group: Integers) -> Floats:
    """Unit directions (s, 3, 3) at the ends of segments, the same, but for the sign, for both of a group at a point."""
    way = places[segments[:, 1]] - places[segments[:, 0]]
    own = _unit(way)
    ends = segments[:, :2]
    found = np.stack([own] * 3, axis=1)
    if not len(segments):
        return found
    _, key, count = np.unique(_keys(ends, group), return_inverse=True, return_counts=True)
    key = key.reshape(-1)
    order = np.argsort(key, kind="stable")
    first = (np.cumsum(count) - count)[count == 2]
    one, other = order[first], order[first + 1]
    turned = np.where((one % 2 == other % 2), -1.0, 1.0)[:, None]  # both begin, or both end, there
    mean = _unit(own[one // 2] + turned * own[other // 2])
    even = np.einsum("sc,sc->s", mean, own[one // 2]) > np.cos(np.radians(CREASE_DEGREES))
    found[one[even] // 2, one[even] % 2] = mean[even]
    found[other[even] // 2, other[even] % 2] = (turned * mean)[even]
    found[:, 2] = found[:, 1]
    return found


def _agreed(faces: Integers, group: Integers, weighted: Floats, own: Floats) -> Floats:
    k = faces.shape[1]
    _, key = np.unique(_keys(faces, group), return_inverse=True)
    key, face = key.reshape(-1), np.repeat(np.arange(len(faces)), k)
    count = int(key.max()) + 1
    mean = _unit(np.stack([np.bincount(key, weighted[face, axis], count) for axis in range(3)], axis=1))
    least = np.ones(count)
    np.minimum.at(least, key, np.einsum("pc,pc->p", mean[key], own[face]))
    even = (least > np.cos(np.radians(CREASE_DEGREES)))[key]
    return np.where(even[:, None], mean[key], own[face]).reshape(len(faces), k, 3)


def _keys(faces: Integers, group: Integers) -> Integers:
    return np.asarray(group[:, None].astype(np.int64) * (int(faces.max()) + 1) + faces).reshape(-1)


def _unit(vectors: Floats) -> Floats:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-30))
