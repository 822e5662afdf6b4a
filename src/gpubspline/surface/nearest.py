"""Distance of points from a surface."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.device import Buffer, Device
from gpubspline.surface.bins import Bins, bin_triangles
from gpubspline.surface.surface import Floats, Surface

ANY_RING = 1 << 20

ROUNDING = 1e-5
"""Of the surface's extent, by which the ball round a triangle is larger."""


@dataclass(frozen=True, eq=False)
class Finder:
    """A surface on a device, ready to be asked for its nearest triangles.

    Attributes
    ----------
    middle: (3,) mm, subtracted from all coordinates, so that float32 keeps its digits.
    corners, balls: (9, n), (4, n), of triangles as the bins list them.
    known: (n_i n_j n_k), where one is listed that counts for all points of a bin, or -1.
    """

    device: Device
    middle: Floats
    bins: Bins
    corners: Buffer
    balls: Buffer
    start: Buffer
    listed: Buffer
    known: Buffer

    def nearest(self, points: Floats, reach_mm: float | None = None) -> tuple[NDArray[Any], NDArray[np.int32]]:
        """Distance (n,), mm, of points (n, 3) from the surface, and the number (n,) of the nearest triangle.

        Where nothing is found within ``reach_mm``, which may be taken for a little more, both are -1.
        """
        rings = ANY_RING if reach_mm is None else max(1, int(np.ceil(reach_mm / self.bins.size)))
        rings = min(rings, max(self.bins.shape))
        distance, triangle = self.device.empty(len(points)), self.device.empty(len(points), np.int32)
        origin = (float(x) for x in self.bins.origin - self.middle)
        lists = (self.start, self.listed, self.known)
        grid = (*lists, *self.bins.shape, *origin, float(self.bins.size))
        self.device.launch(
            "triangles.nearest",
            len(points),
            *self._planes(points),
            self.corners,
            self.balls,
            len(self.bins.listed),
            *grid,
            rings,
            len(points),
            distance,
            triangle,
        )
        return np.asarray(self.device.get(distance)), np.asarray(self.device.get(triangle))

    def _planes(self, points: Floats) -> list[Buffer]:
        return [self.device.put(plane) for plane in np.ascontiguousarray((points - self.middle).T)]


def finder(
    surface: Surface, device: Device, bins: Bins | None = None, known: NDArray[np.int32] | None = None
) -> Finder:
    """Bring a surface to a device.

    Arguments
    ---------
    bins: that are searched in turn; chosen for some triangles a bin where they are not given.
    known: (n_i n_j n_k), for each bin where a triangle is listed that counts for its points wherever it is, so that
        something is always found, and others are left out sooner.
    """
    bins = bin_triangles(surface) if bins is None else bins
    low, high = surface.box
    middle = (low + high) / 2
    corners = surface.corners - middle
    known = np.full(len(bins.start) - 1, -1, np.int32) if known is None else known
    lists = (device.put(array) for array in (bins.start, bins.listed, known))
    of_triangles = (corners.reshape(-1, 9), _balls(corners))
    planes = (device.put(np.ascontiguousarray(array[bins.listed].T)) for array in of_triangles)
    return Finder(device, middle, bins, *planes, *lists)


def _balls(corners: Floats) -> Floats:
    """Centres and radii (n, 4) of balls round triangles (n, 3, 3), larger by more than float32 rounds."""
    centres = np.einsum("nij->nj", corners) / 3
    away = corners - centres[:, None]
    radii = np.sqrt(np.einsum("nij,nij->in", away, away).max(axis=0))
    return np.column_stack([centres, radii + ROUNDING * (radii + np.abs(corners).max(initial=0.0))])
