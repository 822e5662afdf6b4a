"""How far the surface of a mesh lies from the surface of the region it was made from."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpubspline.ct.region import Region
from gpubspline.ct.sampler import Sampler
from gpubspline.device import Device
from gpubspline.mesh.elements import ELEMENTS
from gpubspline.mesh.mesh import Mesh

Floats = NDArray[np.float64]

_SIMPSON = np.array([1.0, 4.0, 1.0]) / 6
_FLAT_VOXELS = 0.5
"""A mesh that extends less than this along a voxel axis is a slice across it."""


@dataclass(frozen=True)
class SurfaceDistance:
    """Distance from the mesh's surface to the region's, mm, without sign: mean over the area, 95th percentile, most."""

    mean: float
    p95: float
    max: float

    def to_dict(self) -> dict[str, float]:
        """Plain numbers, for JSON."""
        return {"mean": self.mean, "p95": self.p95, "max": self.max}


def surface_distance(mesh: Mesh, region: Region, device: Device, side: str | None = None) -> SurfaceDistance:
    """Distance from the mesh's surface to the region's surface.

    The region's signed distance is sampled trilinearly at 3 x 3 points of every outer face of a hex mesh, on its true
    geometry (corners, midway, centre; 3 points of every outer edge of a quad mesh), each weighted by its area.

    Where the scan cuts the body, so does its region end: the outermost voxel centres bound it there, and the cut ends
    of a mesh that reaches them count as on the surface. A slice is not cut along its own normal.

    Arguments
    ---------
    mesh: hexes, or quads of one slice.
    region: its distance is in mm, negative inside, on a grid that may be oblique or sheared.
    side: one side of a structured mesh, such as ``"w0"``, instead of all.
    """
    return summarise_distances(*distances(mesh, region, device, side))


def distances(
    mesh: Mesh, region: Region, device: Device, side: str | None = None, flat: NDArray[np.bool_] | None = None
) -> tuple[Floats, Floats]:
    """Distances (s,), mm, at points of the mesh's surface, and the area (s,), mm2, that each stands for.

    ``flat``: ``flat_axes`` of the whole mesh, where ``mesh`` is a part of it.
    """
    points, weights = surface_points(mesh, side)
    distance = sample_distance(region, points, device)
    flat = flat_axes(mesh, region) if flat is None else flat
    return np.abs(np.maximum(distance, _outside_scan(region, points, flat))), weights


def summarise_distances(size: Floats, weights: Floats) -> SurfaceDistance:
    """Summary of distances (s,), mm, each with its weight; zeros where there is no surface, as of a crop all inside."""
    if not size.size:
        return SurfaceDistance(0.0, 0.0, 0.0)
    order = np.argsort(size)
    share = np.cumsum(weights[order]) / weights.sum()
    at_95 = order[min(int(np.searchsorted(share, 0.95)), size.size - 1)]
    return SurfaceDistance(float(np.average(size, weights=weights)), float(size[at_95]), float(size.max()))


def flat_axes(mesh: Mesh, region: Region) -> NDArray[np.bool_]:
    """(3,) voxel axes i, j, k that the mesh does not extend along: it is a slice across them."""
    inverse = np.linalg.inv(region.affine)[:3, :3].astype(mesh.points.dtype)
    extent = np.array([np.ptp(row @ mesh.planes) for row in inverse])
    return np.asarray((extent < _FLAT_VOXELS) | (np.array(region.shape) == 1))


def surface_points(mesh: Mesh, side: str | None = None) -> tuple[Floats, Floats]:
    """Points (s, 3), mm, on the outer faces of a mesh, and the area (s,), mm2, that each stands for (mm for edges).

    Simpson's rule: 3 x 3 points of each quad, 3 of each edge.
    """
    element = ELEMENTS[mesh.element.side_name]
    faces = mesh.boundary(side)
    grid = np.stack(np.meshgrid(*[[0.0, 0.5, 1.0]] * element.dimension, indexing="ij"), axis=-1)
    at = grid.reshape(-1, element.dimension)
    weights = _SIMPSON if element.dimension == 1 else np.outer(_SIMPSON, _SIMPSON).ravel()
    nodes = mesh.points[faces].astype(np.float64)
    tangents = [np.einsum("gk,fkc->fgc", gradient, nodes) for gradient in element.gradient(at)]
    normal = tangents[0] if element.dimension == 1 else np.cross(*tangents)
    points = np.einsum("gk,fkc->fgc", element.shape(at), nodes)
    return points.reshape(-1, 3), (np.linalg.norm(normal, axis=2) * weights).ravel()


def sample_distance(region: Region, points: Floats, device: Device) -> Floats:
    """Signed distance (s,), mm, of a region at points (s, 3), mm; the nearest border value outside its grid."""
    n_k, n_j, n_i = region.distance_mm.shape
    middle = points.mean(axis=0)  # float32 keeps its digits for the distance to the middle, not to the scanner
    to_index = np.linalg.inv(region.affine)[:3].copy()
    to_index[:, 3] += to_index[:, :3] @ middle
    return Sampler(device, middle, device.put(region.distance_mm), (n_i, n_j, n_k), device.put(to_index)).at(points)


def _outside_scan(region: Region, points: Floats, flat: NDArray[np.bool_]) -> Floats:
    """Signed distance (s,), mm, to the parallelepiped of the outermost voxel centres, negative inside.

    The greatest of the distances to its six planes: exact inside. Flat axes have none.
    """
    inverse = np.linalg.inv(region.affine)
    index = points @ inverse[:3, :3].T + inverse[:3, 3]
    gap_mm = 1 / np.linalg.norm(inverse[:3, :3], axis=1)
    beyond = np.maximum(-index, index - (np.array(region.shape) - 1)) * gap_mm
    return np.asarray(beyond[:, ~flat].max(axis=1, initial=-np.inf))
