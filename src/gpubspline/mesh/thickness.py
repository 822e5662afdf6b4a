"""Thickness of a region along its middle surface."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter

from gpubspline.ct.region import Region

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Thickness:
    """Thickness of a region along its middle surface.

    Attributes
    ----------
    places_mm: (n, 3) voxel centres on the middle, LPS.
    thickness_mm: (n,) twice their depth.
    """

    places_mm: Floats
    thickness_mm: Floats

    def least(self, share: float = 0.05) -> float:
        """Thickness, mm, that all but this share of the middle reach: noise of single voxels is left out."""
        return float(np.quantile(self.thickness_mm, share))


def measure_thickness(region: Region) -> Thickness:
    """Find where the distance from the surface is greatest among neighbours, across the features of a region.

    Voxels are on the middle where none of their 26 neighbours lies deeper by more than a third of the way to it: down a
    slope towards the middle a neighbour is deeper by nearly all of it. The ends of the scan bound no feature.
    """
    depth = -region.distance_mm
    spacing = float(region.spacing_mm.min())
    highest = maximum_filter(depth, size=3, mode="nearest")
    middle = region.mask & (highest - depth < spacing / 3) & (depth > 0)
    if not middle.any():
        middle = region.mask & (depth == depth.max())
    k, j, i = np.nonzero(middle)
    places = np.stack([i, j, k], axis=1) @ region.affine[:3, :3].T + region.affine[:3, 3]
    return Thickness(places, 2.0 * depth[middle].astype(np.float64))


def thinnest(region: Region) -> tuple[Thickness, NDArray[np.float64]]:
    """Thickness of a region, and a place (3,), mm, among the thinnest twentieth."""
    thin = measure_thickness(region)
    order = np.argsort(thin.thickness_mm, kind="stable")
    return thin, thin.places_mm[order[int(0.05 * len(order))]]
