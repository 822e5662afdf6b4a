"""How far the region's surface lies from the mesh's, what the mesh leaves out, and its topology: the way back.

``mesh/distance.py`` asks of every place on the mesh how far the region is: a part of the region without mesh goes
unseen. Here it is the region that asks.
"""

from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from gpubspline.ct.region import Region
from gpubspline.ct.signed_distance import find_crossings
from gpubspline.device import Device
from gpubspline.errors import InputError
from gpubspline.mesh.distance import SurfaceDistance, sample_distance, summarise_distances
from gpubspline.mesh.elements import ELEMENTS
from gpubspline.mesh.mesh import Mesh
from gpubspline.surface.nearest import finder
from gpubspline.surface.surface import Surface

Floats = NDArray[np.float64]

MOST_PLACES = 200_000
"""Places on the region's surface that are measured; of more, every so manieth."""

LEFT_OUT = 1.0
"""Distance from the mesh, in voxel diagonals, from which a part of the region is left out."""

OFF = 0.5
"""Distance of a surface node from the region's surface, in voxel edges, from which it counts as off it."""


@dataclass(frozen=True, eq=False)
class Coverage:
    """What of a region a mesh covers.

    Attributes
    ----------
    distance: from the region's surface to the mesh's, mm.
    lost: parts of the region outside the mesh: places (x, y, z) and distances from the mesh, mm, farthest first.
    off_surface: number of surface nodes off the region's surface by more than half a voxel, and the most, mm.
    euler: Euler characteristics of the mesh and of the region's voxels.
    """

    distance: SurfaceDistance
    lost: tuple[tuple[tuple[float, float, float], float], ...]
    off_surface: tuple[int, float]
    euler: tuple[int, int]

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers and lists, for JSON, by the summary's keys."""
        return {
            "region_distance_mm": self.distance.to_dict(),
            "lost_features": [{"place_mm": list(place), "out_mm": out} for place, out in self.lost],
            "off_surface_nodes": {"count": self.off_surface[0], "max_mm": self.off_surface[1]},
            "euler": {"mesh": self.euler[0], "region": self.euler[1]},
        }


def cover(mesh: Mesh, region: Region, device: Device, least_mm: float | None = None) -> Coverage:
    """Measure what of a region a hex mesh covers.

    ``least_mm``: distance from the mesh from which a part of the region is left out; None takes ``LEFT_OUT`` voxels.
    Raises InputError for quads.
    """
    places, weights = surface_places(region)
    measured, outward = find_outside(mesh, places, device)
    diagonal = float(np.linalg.norm(region.spacing_mm))
    out = outward & (measured > (LEFT_OUT * diagonal if least_mm is None else least_mm))
    return Coverage(
        summarise_distances(measured, weights),
        _clusters(places[out], measured[out], 2 * diagonal),
        _off_surface(mesh, region, OFF * float(region.spacing_mm.mean()), device),
        (euler_of_mesh(mesh), euler_of_voxels(region.mask)),
    )


def find_outside(mesh: Mesh, places: Floats, device: Device) -> tuple[Floats, NDArray[np.bool_]]:
    """Distance (n,), mm, of places (n, 3) from the surface of a hex mesh, and whether they are outside it."""
    surface = mesh_surface(mesh)
    distance, triangle = finder(surface, device).nearest(places)
    outward = np.einsum("ij,ij->i", places - surface.corners[triangle, 0], surface.normals[triangle]) > 0
    return distance.astype(np.float64), outward


def mesh_surface(mesh: Mesh) -> Surface:
    """Triangles of the outer faces of a hex mesh: four a face, through its middle; sixteen of a face of order 2."""
    if mesh.element.dimension != 3:
        raise InputError(f"expected hexes to have a surface, got {mesh.element_type}")
    face = ELEMENTS[mesh.element.side_name]
    steps = np.linspace(0, 1, face.order + 1)
    corners = [np.array(at) for at in product(range(face.order), repeat=2)]
    at = np.array([(a, b) for b in steps for a in steps] + [(c + 0.5) / face.order for c in corners])
    n, middle = face.order + 1, (face.order + 1) ** 2
    triangles = []
    for number, (a, b) in enumerate(corners):
        ring = [b * n + a, b * n + a + 1, (b + 1) * n + a + 1, (b + 1) * n + a]
        triangles += [(ring[k], ring[(k + 1) % 4], middle + number) for k in range(4)]
    nodes = mesh.points[mesh.boundary()].astype(np.float64)
    points = np.einsum("gk,fkc->fgc", face.shape(at), nodes)
    first = len(at) * np.arange(len(nodes))
    numbers = first[:, None, None] + np.array(triangles)
    return Surface(points.reshape(-1, 3), numbers.reshape(-1, 3))


def surface_places(region: Region) -> tuple[Floats, Floats]:
    """Places (n, 3), mm, where grid edges cross the region's surface, and the area (n,), mm2, that each stands for.

    A patch of surface is crossed by the edges along each axis as often as its projection along that axis has grid
    points, so that an area of normal n is crossed sum |n . e_a| / (area of a grid face) times.
    """
    steps = region.affine[:3, :3]
    volume = abs(float(np.linalg.det(steps)))
    gradient = np.gradient(region.distance_mm.astype(np.float32), edge_order=1) if min(region.mask.shape) > 1 else None
    places, weights = [], []
    for edge in find_crossings(region.mask, region.distance_mm):
        every = max(1, -(-3 * len(edge.near) // MOST_PLACES))
        near, fraction = edge.near[::every], edge.fraction[::every]
        k, j, i = np.unravel_index(near, region.mask.shape)
        at = np.stack([i, j, k], axis=1).astype(np.float64)
        at[:, edge.axis] += fraction
        places.append(at @ steps.T + region.affine[:3, 3])
        weights.append(every * _area_each(gradient, (k, j, i), steps, volume))
    return np.concatenate(places), np.concatenate(weights)


def _area_each(gradient: Any, at: tuple[NDArray[Any], ...], steps: Floats, volume: float) -> Floats:
    if gradient is None:
        return np.ones(len(at[0]))
    index = np.stack([gradient[2][at], gradient[1][at], gradient[0][at]], axis=1)
    physical = index @ np.linalg.inv(steps)
    normal = physical / np.maximum(np.linalg.norm(physical, axis=1, keepdims=True), 1e-12)
    return np.asarray(volume / np.maximum(np.abs(normal @ steps).sum(axis=1), 1e-12))


def _clusters(places: Floats, distances: Floats, reach: float) -> tuple[tuple[tuple[float, float, float], float], ...]:
    """The farthest place of each cluster of places within reach of one another."""
    if not len(places):
        return ()
    pairs = KDTree(places).query_pairs(reach, output_type="ndarray")
    graph = coo_array((np.ones(len(pairs)), pairs.T), shape=(len(places),) * 2)
    number = connected_components(graph, directed=False)[1]
    order = np.argsort(-distances, kind="stable")
    _, first = np.unique(number[order], return_index=True)
    found = order[np.sort(first)]
    rows = zip(*places[found].T.tolist(), distances[found].tolist(), strict=True)
    return tuple(((x, y, z), out) for x, y, z, out in rows)


def _off_surface(mesh: Mesh, region: Region, limit_mm: float, device: Device) -> tuple[int, float]:
    """Surface nodes off the region's surface, those of ends that the scan cuts left out."""
    nodes = mesh.boundary_nodes()
    points = mesh.points[nodes].astype(np.float64)
    inverse = np.linalg.inv(region.affine)
    index = points @ inverse[:3, :3].T + inverse[:3, 3]
    last = np.array(region.shape) - 1
    inside = np.all((index > 0.01) & (index < last - 0.01), axis=1)
    if not inside.any():
        return 0, 0.0
    off = np.abs(sample_distance(region, points[inside], device))
    return int(np.count_nonzero(off > limit_mm)), float(off.max())


def euler_of_mesh(mesh: Mesh) -> int:
    """Euler characteristic of the solid: half of its surface's, 1 for a ball, 0 for a ring, 2 for a hollow ball."""
    faces = mesh.boundary()[:, :4].astype(np.int64)
    sides = np.sort(np.concatenate([faces[:, [a, (a + 1) % 4]] for a in range(4)]), axis=1)
    edges = len(np.unique(sides[:, 0] * mesh.n_nodes + sides[:, 1]))
    return (len(np.unique(faces)) - edges + len(faces)) // 2


def euler_of_voxels(mask: NDArray[np.bool_]) -> int:
    """Euler characteristic of voxels that faces connect: voxels, less shared faces, plus edges, less corners."""
    total = 0
    for along in product((False, True), repeat=3):
        shared = mask
        for axis in range(3):
            if along[axis]:
                low = np.moveaxis(shared, axis, 0)
                shared = np.moveaxis(low[:-1] & low[1:], 0, axis)
        total += (-1) ** sum(along) * int(np.count_nonzero(shared))
    return total
