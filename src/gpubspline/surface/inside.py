"""Which points of a grid a closed surface holds: crossings counted along each row, exact in sign.

A row crosses a triangle where its place across the rows lies within the triangle's projection. Whether it does is
decided from the sides of the three edges, each computed from the edge's two points in one order, so that triangles that
share an edge agree. A place on an edge counts as if it were moved by (e, e^2) with e towards 0, so that vertices and
edges on grid lines, frequent in practice, are counted once (Edelsbrunner, Muecke 1990).
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.surface.boxes import walk_boxes
from gpubspline.surface.surface import Floats, Integers, Surface

SAMPLED = 1e6
"""Points at which the volume held twice is counted."""


def winding_numbers(surface: Surface, affine: Floats, shape: tuple[int, int, int]) -> NDArray[np.int16]:
    """How often the surface winds round each point of a grid.

    Arguments
    ---------
    surface: closed.
    affine: (4, 4), index (i, j, k) to LPS mm.
    shape: (n_k, n_j, n_i).

    Returns: (n_k, n_j, n_i) int16: 0 outside, 1 inside of outward triangles.
    """
    inverse = np.linalg.inv(affine)
    index = surface.points @ inverse[:3, :3].T + inverse[:3, 3]
    mirrored = np.linalg.det(affine[:3, :3]) < 0  # such a grid sees outward triangles as inward
    triangles = surface.triangles[:, ::-1] if mirrored else surface.triangles
    steps = np.zeros((shape[0], shape[1], shape[2] + 1), dtype=np.int16)
    for row, at, sign in _crossings(index, triangles, shape):
        first = np.clip(np.ceil(at), 0, shape[2]).astype(np.int64)  # the first sample beyond the crossing
        np.add.at(steps.reshape(-1), row * (shape[2] + 1) + first, sign.astype(np.int16))
    return np.cumsum(steps, axis=2, out=steps)[..., :-1]


def doubtful_share(surface: Surface) -> float:
    """Share of the enclosed volume that a closed surface holds twice or inside out: none where it is sound.

    Counted at a million points or so: what is smaller than these are apart is not seen.
    """
    low, high = surface.box
    step = float(np.cbrt(np.prod(high - low) / SAMPLED)) or float((high - low).max()) / SAMPLED ** (1 / 3)
    affine = np.diag([step, step, step, 1.0])
    affine[:3, 3] = low + 0.5 * step
    n_i, n_j, n_k = (max(int(n), 1) for n in np.ceil((high - low) / step))
    winding = winding_numbers(surface, affine, (n_k, n_j, n_i))
    held, doubtful = np.count_nonzero(winding > 0), np.count_nonzero((winding < 0) | (winding > 1))
    return doubtful / held if held else 1.0


def _crossings(index: Floats, triangles: Integers, shape: tuple[int, int, int]) -> Any:
    """Flat numbers (n,) of rows, where (n,) along i they cross a triangle, and 1 on entering, -1 on leaving."""
    low = np.ceil(index[triangles][:, :, 1:].min(axis=1)).astype(np.int64)
    high = np.floor(index[triangles][:, :, 1:].max(axis=1)).astype(np.int64)
    low, high = np.maximum(low, 0), np.minimum(high, [shape[1] - 1, shape[0] - 1])
    for triangle, row in walk_boxes(low, high):
        place = row.astype(np.float64)
        sides = [_side(index, triangles[triangle][:, [a, (a + 1) % 3]], place) for a in range(3)]
        within = (sides[0] == sides[1]) & (sides[1] == sides[2])
        if not within.any():
            continue
        hit, place, side = triangle[within], place[within], sides[0][within]
        yield row[within, 1] * shape[1] + row[within, 0], _along(index[triangles[hit]], place), -side


def _side(index: Floats, edge: Integers, place: Floats) -> NDArray[np.int8]:
    """1 where the place is on the left of each edge (n, 2), seen along i, else -1; never 0."""
    turned = edge[:, 0] > edge[:, 1]
    a, b = index[edge.min(axis=1), 1:], index[edge.max(axis=1), 1:]
    along, to = b - a, place - a
    area = along[:, 0] * to[:, 1] - along[:, 1] * to[:, 0]
    area = np.where(area != 0, area, np.where(along[:, 1] != 0, -along[:, 1], along[:, 0]))
    return np.asarray(np.where((area > 0) != turned, np.int8(1), np.int8(-1)))


def _along(corners: Floats, place: Floats) -> Floats:
    """Where (n,) along i the rows at a place (n, 2) cross triangles (n, 3, 3), within the triangles' extent."""
    a, b, c = np.moveaxis(corners, 1, 0)
    normal = np.cross(b - a, c - a)
    slope = np.einsum("ij,ij->i", normal[:, 1:], a[:, 1:] - place)
    flat = normal[:, 0] == 0
    at = a[:, 0] + slope / np.where(flat, 1.0, normal[:, 0])
    at = np.where(flat, corners[:, :, 0].mean(axis=1), at)
    return np.asarray(np.clip(at, corners[:, :, 0].min(axis=1), corners[:, :, 0].max(axis=1)))
