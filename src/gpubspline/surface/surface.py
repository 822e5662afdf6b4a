"""A closed, oriented triangle surface in millimetres."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gpubspline.errors import InputError
from gpubspline.shown import brief

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles on shared vertices.

    Attributes
    ----------
    points: (n, 3) float64, LPS mm.
    triangles: (m, 3) int64 numbers of points; counter-clockwise seen from outside.

    Raises
    ------
    InputError where shapes or numbers do not fit, or a coordinate is not finite.
    """

    points: Floats
    triangles: Integers

    __repr__ = brief

    def __post_init__(self) -> None:
        """Check once, at the door."""
        points = np.ascontiguousarray(self.points, dtype=np.float64)
        triangles = np.ascontiguousarray(self.triangles, dtype=np.int64)
        if points.ndim != 2 or points.shape[1] != 3 or triangles.ndim != 2 or triangles.shape[1] != 3:
            raise InputError(f"expected points (n, 3) and triangles (m, 3), got {points.shape} and {triangles.shape}")
        if not len(triangles) or not 0 <= triangles.min() <= triangles.max() < len(points):
            raise InputError(f"expected triangles of the points 0 to {len(points) - 1}, got {triangles.shape}")
        if not np.isfinite(points).all():
            bad = int(np.count_nonzero(~np.isfinite(points).all(axis=1)))
            raise InputError(f"expected finite coordinates, got NaN or infinity in {bad} of {len(points)} points")
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "triangles", triangles)

    @cached_property
    def corners(self) -> Floats:
        """(m, 3, 3) the coordinates of each triangle's vertices."""
        return np.asarray(self.points[self.triangles])

    @property
    def box(self) -> tuple[Floats, Floats]:
        """Least and greatest coordinates, (3,) each."""
        return np.asarray(self.corners.min(axis=(0, 1))), np.asarray(self.corners.max(axis=(0, 1)))

    @property
    def volume_mm3(self) -> float:
        """Enclosed volume, mm3, by the divergence theorem; negative where triangles face inwards."""
        a, b, c = np.moveaxis(self.corners - self.points.mean(axis=0), 1, 0)
        return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)

    @property
    def area_mm2(self) -> float:
        """Area of all triangles, mm2."""
        return float(np.linalg.norm(self.normals, axis=1).sum() / 2)

    @cached_property
    def normals(self) -> Floats:
        """(m, 3) outward normals, as long as twice the triangles' areas."""
        a, b, c = np.moveaxis(self.corners, 1, 0)
        return np.asarray(np.cross(b - a, c - a))

    @property
    def euler(self) -> int:
        """Euler characteristic: 2 for a sphere, 0 for a torus, summed over bodies."""
        return len(np.unique(self.triangles)) - len(unique_edges(self.triangles)) + len(self.triangles)


def unique_edges(triangles: Integers) -> Integers:
    """(e, 2) the edges of triangles (m, 3), each once, lower point first."""
    sides = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    return np.asarray(np.unique(sides, axis=0))


def spelled(place: Floats) -> str:
    """Coordinates of a place in mm, for a message: two decimals, more where all are small, as of models in metres."""
    greatest = float(np.abs(place).max())
    decimals = int(np.clip(3 - np.floor(np.log10(greatest)), 2, 9)) if greatest > 0 else 2
    return "(" + ", ".join(f"{x:.{decimals}f}" for x in place) + ") mm"
