"""HU near the surface of a body, which the scan mixes with what lies outside: what it spread there, folded back in.

A scan is the body blurred. Across the surface HU pass from the body's to its surroundings' within about a voxel and
a half: a node on the surface reads half air, and half of what the body has more than its surroundings lies outside.
Mirrored at the surface and added inside, that excess makes the integral of HU over the body what the scan holds of it;
of a straight edge under a symmetrical blur it makes them the body's own HU, up to the surface:

    at the depth t:  HU(t) + HU(-t) - HU(-reach)

Where the surface is put too deep (skin at -200 HU), the excess is of body left out, and must not make skin bone:
no point gets more than the greatest HU below it, and than a layer there that was blurred to half of what it stands out.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from gpubspline.ct.region import Region
from gpubspline.ct.sampler import hu_sampler, sampler
from gpubspline.ct.volume import Volume
from gpubspline.device import Device
from gpubspline.errors import InputError

Floats = NDArray[np.float64]
Values = Callable[[Floats], Floats]
"""Values (s,) at points (s, 3), LPS mm."""

TREATMENTS = ("fold", "none")
"""Of the partial volume at the surface: folded back in, or HU as they lie, as in the paper."""

REACH = 1.5
"""How far the blur goes on either side of the surface, in widths of a voxel along its normal.

A scan's point spread is one to two voxels wide at half its height, and HU between voxels are interpolated."""

BELOW = (1 / 3, 2 / 3, 1.0)
"""Of the reach, where the HU below the surface is read."""


def check_treatment(treatment: str) -> None:
    """Raise InputError for a treatment that is none."""
    if treatment not in TREATMENTS:
        raise InputError(f"expected the partial volume treatment {' or '.join(TREATMENTS)}, got {treatment!r}")


@dataclass(frozen=True, eq=False)
class Folding:
    """Gives the points near a surface what the scan spread outside of it.

    Attributes
    ----------
    distance: of the body's surface, mm, negative inside.
    hu: of the scan.
    edges_mm: (3, 3) the edges of its voxels, a row each.
    step_mm: over which the gradient of the distance is taken.
    """

    distance: Values
    hu: Values
    edges_mm: Floats
    step_mm: float

    def correction(self, points: NDArray[np.floating]) -> Floats:
        """What HU (s,) at points (s, 3), LPS mm, lack; 0 farther than the reach from the surface, on either side.

        A point outside, as far as the reach, takes the HU of its mirror image.
        """
        places: Floats = np.array(points, dtype=np.float64)
        distance, missing = self.distance(places), np.zeros(len(places))
        near = np.flatnonzero(np.abs(distance) < REACH * np.linalg.norm(self.edges_mm, axis=1).sum())
        normal = self._normals(places[near])
        reach = REACH * np.abs(normal @ self.edges_mm.T).sum(axis=1)
        within = np.abs(distance[near]) < reach
        near = near[within]
        if near.size:
            missing[near] = self._missing(places[near], distance[near], normal[within], reach[within])
        return missing

    def _normals(self, points: Floats) -> Floats:
        steps = self.step_mm * np.eye(3)
        slope = np.stack([self.distance(points + s) - self.distance(points - s) for s in steps], axis=1)
        return np.asarray(slope / np.maximum(np.linalg.norm(slope, axis=1), 1e-12)[:, None])

    def _missing(self, points: Floats, distance: Floats, normal: Floats, reach: Floats) -> Floats:
        def at(depth: Floats) -> Floats:
            """HU at a depth below the surface, (s,) mm."""
            return self.hu(points - (depth + distance)[:, None] * normal)

        own, depth = self.hu(points), np.abs(distance)
        inner = np.where(distance < 0, own, at(depth))
        outer = np.where(distance < 0, at(-depth), own)
        excess = np.maximum(outer - at(-reach), 0.0)
        below = np.stack([at(share * reach) for share in BELOW])
        most = below.max(axis=0) + (below.max(axis=0) - below[-1])
        return np.asarray(np.clip(inner + excess, inner, np.maximum(most, inner)) - own)


def folding(volume: Volume, region: Region, points: NDArray[np.floating], device: Device | None = None) -> Folding:
    """Prepare to fold at points of a mesh.

    Arguments
    ---------
    volume: the scan; region: the body, on any grid.
    points: (s, 3), LPS mm, all that are asked for lie in their box.
    device: reads there; on the host where None.
    """
    edges = volume.affine[:3, :3].T.astype(np.float64)
    step = 0.5 * float(region.spacing_mm.min())
    if device is None:
        return Folding(_on_host(region.distance_mm, region.affine), _on_host(volume.hu, volume.affine), edges, step)
    margin = 2 * REACH * np.linalg.norm(edges, axis=1).sum()
    box = np.stack([points.min(axis=0) - margin, points.max(axis=0) + margin])
    distance, hu = sampler(region.distance_mm, region.affine, box, device), hu_sampler(volume, box, device)
    return Folding(distance.at, hu.at, edges, step)


def _on_host(samples: NDArray[np.generic], affine: Floats) -> Values:
    inverse = np.linalg.inv(affine)

    def at(points: Floats) -> Floats:
        index = points @ inverse[:3, :3].T + inverse[:3, 3]
        return np.asarray(ndimage.map_coordinates(samples, index[:, ::-1].T, np.float64, order=1, mode="nearest"))

    return at
