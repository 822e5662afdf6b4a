"""HU from inside the body for what lies on its surface, whose voxels are half air."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpubspline.ct.region import Region
from gpubspline.ct.sampler import Sampler, sampler
from gpubspline.device import Device
from gpubspline.errors import InputError

Floats = NDArray[np.float64]

SHARES = (0.25, 0.5, 0.75, 1.0)
"""Of the way to the depth, where a thin part is probed: the deepest of them is taken."""


@dataclass(frozen=True, eq=False)
class Inset:
    """Moves places nearer than a depth to the surface of a region, inside or outside, down to that depth.

    What lies farther outside is in a gap that the mesh bridges, not on the surface, and stays.

    Attributes
    ----------
    distance: signed distance of the region, mm, negative inside.
    step_mm: over which its gradient is taken.
    depth_mm: below the surface.
    """

    distance: Sampler
    step_mm: float
    depth_mm: float

    def move(self, points: Floats) -> Floats:
        """Move points (s, 3), LPS mm, that need it.

        Along the gradient of the distance, and no farther than to where a thin part is deepest.
        """
        points = np.array(points, dtype=np.float64)
        depth = self.distance.at(points)
        near = np.flatnonzero(np.abs(depth) < self.depth_mm)
        if near.size:
            points[near] = self._inwards(points[near], depth[near])
        return points

    def _inwards(self, points: Floats, distance: Floats) -> Floats:
        steps = self.step_mm * np.eye(3)
        slope = np.stack([self.distance.at(points + s) - self.distance.at(points - s) for s in steps], axis=1)
        normal = slope / np.maximum(np.linalg.norm(slope, axis=1), 1e-12)[:, None]
        way = (self.depth_mm + distance)[:, None] * normal
        best, deepest = points, distance
        for share in SHARES:
            moved = points - share * way
            there = self.distance.at(moved)
            better = there < deepest
            best, deepest = np.where(better[:, None], moved, best), np.where(better, there, deepest)
        return best


def inset(region: Region, depth_mm: float, points: NDArray[np.floating], device: Device) -> Inset:
    """Prepare to move points of a mesh.

    Arguments
    ---------
    region: the body.
    depth_mm: below its surface.
    points: (s, 3), LPS mm, all that may be moved lie in their box.

    Raises
    ------
    InputError for a depth that is not positive.
    """
    if not 0 < depth_mm < np.inf:
        raise InputError(f"expected a positive depth below the surface in mm, got {depth_mm:g}")
    return Inset(
        sampler(region.distance_mm, region.affine, np.asarray(points, dtype=np.float64), device),
        0.5 * float(region.spacing_mm.min()),
        depth_mm,
    )
