"""The surface of a mesh as levels that its boundary nodes slide on: one for each smooth part, two where parts meet."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from gpubspline.device import Device
from gpubspline.mesh.movable import FIXED, FREE, Level, put_level
from gpubspline.surface.nearest import finder
from gpubspline.surface.surface import Surface

Floats = NDArray[np.float64]
Integers = NDArray[Any]

SHARP_DEGREES = 60.0
"""Angle between the normals of two faces from which their edge is kept: nodes slide along it, not across."""

MOST_PARTS = 8
"""Smooth parts that are followed; nodes of the others stay."""

MOST_SAMPLES = 8_000_000
"""Of each level."""

FINE = 6
"""Samples along a short edge of the surface: one that one in twenty is shorter than."""

MOST_STEPS = 40
"""Points along a face's edge at which the samples near it are looked for."""

REACH = 4
"""Samples on either side of the surface in which a level is measured."""


@dataclass(frozen=True, eq=False)
class Held:
    """What holds the nodes of a mesh.

    Attributes
    ----------
    level: distances from the smooth parts of the surface.
    slack: (n,) 0 on the surface, ``FIXED`` where three parts meet, ``FREE`` inside.
    levels: (2, n) which of the distances hold a node, -1 for none.
    """

    level: Level
    slack: Floats
    levels: NDArray[np.int32]


def hold(points: Floats, quads: Integers, device: Device) -> Held:
    """Let the boundary nodes of hexes slide on the surface as it is.

    Arguments
    ---------
    points: (n, 3) coordinates.
    quads: (f, 4) outward faces of the boundary.
    """
    parts = smooth_parts(points, quads)
    kept = min(MOST_PARTS, int(parts.max()) + 1)
    slack, levels = _who_holds(parts, quads, len(points), kept)
    low, high = points[quads].min(axis=(0, 1)), points[quads].max(axis=(0, 1))
    edges = np.linalg.norm(points[quads] - points[np.roll(quads, -1, axis=1)], axis=2)
    coarsest = np.cbrt(np.prod(np.maximum(high - low, 1e-3 * np.ptp(points))) / MOST_SAMPLES)
    spacing = float(max(coarsest, np.quantile(edges, 0.05) / FINE))
    counts = np.ceil((high - low) / spacing).astype(int) + 2 * REACH + 1
    origin = (low + high - (counts - 1) * spacing) / 2
    to_index = np.hstack([np.eye(3) / spacing, -origin[:, None] / spacing])
    stacked = np.full((kept, *counts[::-1]), REACH * spacing, dtype=np.float32)
    for part in range(kept):
        own = quads[parts == part]
        k, j, i = np.nonzero(_near(points[own], to_index, stacked.shape[1:]))
        at = np.stack([i, j, k], axis=1) * spacing + origin
        stacked[part, k, j, i] = _plane_distance(points, own, at, REACH * spacing, device)
    return Held(put_level(stacked, to_index, device), slack, levels)


def _near(corners: Floats, to_index: Floats, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Samples within reach of quads (f, 4, 3)."""
    steps = int(np.ceil(np.linalg.norm(to_index[0, 0] * np.ptp(corners, axis=1), axis=1).max() / REACH)) + 1
    along = np.linspace(0, 1, min(steps, MOST_STEPS) + 1)[:, None, None]
    touched = np.zeros(shape, dtype=bool)
    for a, low in ((a, corners[:, 0] * (1 - a) + corners[:, 1] * a) for a in along[:, 0]):
        line = low * (1 - along) + (corners[:, 3] * (1 - a) + corners[:, 2] * a) * along
        i, j, k = np.rint(line.reshape(-1, 3) @ to_index[:, :3].T + to_index[:, 3]).astype(int).T
        touched[k, j, i] = True
    return np.asarray(maximum_filter(touched, size=2 * REACH + 1))


def smooth_parts(points: Floats, quads: Integers) -> NDArray[np.int64]:
    """Number (f,) of the smooth part that each face belongs to, the largest part first."""
    corners = points[quads]
    normals = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-30)[:, None]
    ends = np.sort(np.stack([quads, np.roll(quads, -1, axis=1)], axis=2).reshape(-1, 2), axis=1).astype(np.int64)
    key = ends[:, 0] * len(points) + ends[:, 1]
    order = np.argsort(key, kind="stable")
    same = np.flatnonzero(key[order][1:] == key[order][:-1])
    a, b = order[same] // 4, order[same + 1] // 4
    smooth = np.einsum("ec,ec->e", normals[a], normals[b]) > np.cos(np.radians(SHARP_DEGREES))
    joined = coo_matrix((np.ones(smooth.sum()), (a[smooth], b[smooth])), shape=(len(quads), len(quads)))
    _, labels = connected_components(joined, directed=False)
    by_size = np.argsort(-np.bincount(labels), kind="stable")
    return np.asarray(np.argsort(by_size)[labels])


def _who_holds(parts: Integers, quads: Integers, n: int, kept: int) -> tuple[Floats, NDArray[np.int32]]:
    """Slack (n,) and levels (2, n): the parts that a node's faces belong to."""
    pairs = np.unique(np.stack([quads.ravel(), np.repeat(parts, 4)], axis=1), axis=0)
    node, part = pairs.T
    first = np.searchsorted(node, np.arange(n))
    count = np.bincount(node, minlength=n)
    levels = np.full((2, n), -1, dtype=np.int32)
    levels[0] = np.where(count > 0, part[np.minimum(first, len(part) - 1)], 0)
    levels[1] = np.where(count > 1, part[np.minimum(first + 1, len(part) - 1)], -1)
    stays = (count > 2) | (levels.max(axis=0) >= kept)
    slack = np.where(count == 0, FREE, np.where(stays, FIXED, 0.0))
    return slack, np.where(levels >= kept, 0, levels).astype(np.int32)


def _plane_distance(points: Floats, quads: Integers, at: Floats, reach: float, device: Device) -> NDArray[np.float32]:
    """Signed distance (s,) of points from the plane of the nearest triangle of a part, which goes on beyond its rim."""
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    surface = Surface(points, triangles)
    solid = np.linalg.norm(surface.normals, axis=1) > 1e-12 * np.abs(points).max() ** 2
    surface = Surface(points, triangles[solid])
    _, nearest = finder(surface, device, reach).nearest(at, reach)
    normals = surface.normals / np.linalg.norm(surface.normals, axis=1)[:, None]
    offsets = np.einsum("tc,tc->t", normals, surface.corners[:, 0])
    found = np.maximum(nearest, 0)
    signed = np.einsum("sc,sc->s", normals[found], at) - offsets[found]
    return np.where(nearest < 0, reach, signed).astype(np.float32)
