"""A grid of cubes over a surface, each with the triangles that may pass through it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpubspline.surface.boxes import walk_boxes
from gpubspline.surface.surface import Floats, Integers, Surface

MOST_BINS = 1 << 22
TRIANGLES = 4.0
"""Wanted in a bin that the surface passes through, on average."""


@dataclass(frozen=True, eq=False)
class Bins:
    """Cubes, i fastest.

    Attributes
    ----------
    origin: (3,) the low corner, mm.
    size: edge of a cube, mm.
    shape: (n_i, n_j, n_k).
    start: (n_i n_j n_k + 1,) where the triangles of each bin begin in ``listed``.
    listed: numbers of triangles.
    """

    origin: Floats
    size: float
    shape: tuple[int, int, int]
    start: NDArray[np.int32]
    listed: NDArray[np.int32]

    def index_of(self, points: Floats) -> Integers:
        """Index (..., 3) of the bin of each point (..., 3); the nearest one for points outside."""
        at = np.floor((points - self.origin) / self.size).astype(np.int64)
        return np.asarray(np.clip(at, 0, np.array(self.shape) - 1))

    def occupied(self) -> NDArray[np.bool_]:
        """(n_k, n_j, n_i) bins with a triangle."""
        return np.diff(self.start).reshape(self.shape[::-1]) > 0


def bin_triangles(surface: Surface, size: float | None = None) -> Bins:
    """List the triangles of each bin; ``size`` in mm is chosen for some triangles a bin where it is not given."""
    low, high = surface.box
    extent = high - low
    size = float(np.sqrt(TRIANGLES * surface.area_mm2 / len(surface.triangles))) if size is None else size
    size = max(size, 1e-9 * float(extent.max()))
    while np.prod(np.floor(extent / size) + 1) > MOST_BINS:
        size *= 1.26
    shape = (np.floor(extent / size) + 1).astype(int)
    bins = Bins(low, size, (int(shape[0]), int(shape[1]), int(shape[2])), np.zeros(0, np.int32), np.zeros(0, np.int32))
    triangle, where = _pairs(surface, bins)
    order = np.argsort(where, kind="stable")
    count = np.bincount(where, minlength=int(shape.prod()))
    start = np.concatenate([[0], np.cumsum(count)]).astype(np.int32)
    return Bins(low, size, bins.shape, start, triangle[order].astype(np.int32))


def _pairs(surface: Surface, bins: Bins) -> tuple[Integers, Integers]:
    """Triangles and the flat numbers of the bins that they may pass through: in their box, and met by their plane."""
    corners, normals = surface.corners, surface.normals
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    unit = normals / np.where(length > 0, length, 1.0)
    reach = 0.5 * bins.size * np.abs(unit).sum(axis=1) * (1 + 1e-9)
    rounding = 1e-9 * bins.size
    low, high = bins.index_of(corners.min(axis=1) - rounding), bins.index_of(corners.max(axis=1) + rounding)
    found = []
    for triangle, cell in walk_boxes(low, high):
        centre = bins.origin + (cell + 0.5) * bins.size
        off = np.abs(np.einsum("ij,ij->i", centre - corners[triangle, 0], unit[triangle]))
        kept = off <= reach[triangle] + rounding
        number = (cell[kept, 2] * bins.shape[1] + cell[kept, 1]) * bins.shape[0] + cell[kept, 0]
        found.append((triangle[kept], number))
    return np.concatenate([t for t, _ in found]), np.concatenate([n for _, n in found])
