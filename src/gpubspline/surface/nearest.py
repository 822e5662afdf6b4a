"""Distance of points from a surface."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.device import Buffer, Device
from gpubspline.surface.bins import Bins, bin_triangles
from gpubspline.surface.surface import Floats, Surface

ANY_RING = 1 << 20


@dataclass(frozen=True, eq=False)
class Finder:
    """A surface on a device, ready to be asked for its nearest triangles.

    Attributes
    ----------
    middle: (3,) mm, subtracted from all coordinates, so that float32 keeps its digits.
    """

    device: Device
    middle: Floats
    bins: Bins
    n_triangles: int
    corners: Buffer
    start: Buffer
    listed: Buffer

    def nearest(self, points: Floats, reach_mm: float | None = None) -> tuple[NDArray[Any], NDArray[np.int32]]:
        """Distance (n,), mm, of points (n, 3) from the surface, and the number (n,) of the nearest triangle.

        Where nothing is found within ``reach_mm``, which may be taken for a little more, both are -1.
        """
        rings = ANY_RING if reach_mm is None else max(1, int(np.ceil(reach_mm / self.bins.size)))
        rings = min(rings, max(self.bins.shape))
        distance, triangle = self.device.empty(len(points)), self.device.empty(len(points), np.int32)
        origin = (float(x) for x in self.bins.origin - self.middle)
        grid = (self.start, self.listed, *self.bins.shape, *origin, float(self.bins.size))
        self.device.launch(
            "triangles.nearest",
            len(points),
            *self._planes(points),
            self.corners,
            self.n_triangles,
            *grid,
            rings,
            len(points),
            distance,
            triangle,
        )
        return np.asarray(self.device.get(distance)), np.asarray(self.device.get(triangle))

    def given(self, points: Floats, triangle: NDArray[np.int32]) -> NDArray[Any]:
        """Distance (n,), mm, of points (n, 3) from one triangle each."""
        distance = self.device.empty(len(points))
        number = self.device.put(triangle)
        planes = self._planes(points)
        self.device.launch(
            "triangles.given", len(points), *planes, self.corners, self.n_triangles, number, len(points), distance
        )
        return np.asarray(self.device.get(distance))

    def _planes(self, points: Floats) -> list[Buffer]:
        return [self.device.put(plane) for plane in np.ascontiguousarray((points - self.middle).T)]


def finder(surface: Surface, device: Device, bin_mm: float | None = None) -> Finder:
    """Bring a surface to a device; ``bin_mm`` is the edge of the bins that are searched in turn."""
    bins = bin_triangles(surface, bin_mm)
    low, high = surface.box
    middle = (low + high) / 2
    corners = device.put(np.ascontiguousarray((surface.corners - middle).reshape(-1, 9).T))
    return Finder(
        device, middle, bins, len(surface.triangles), corners, device.put(bins.start), device.put(bins.listed)
    )
