"""Mass of a body by its voxels, which that of its mesh is compared with."""

from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.ct.partial_volume import REACH, folding
from gpubspline.ct.region import Region
from gpubspline.ct.sampler import hu_sampler
from gpubspline.ct.volume import Volume
from gpubspline.device import Device
from gpubspline.material.inset import inset
from gpubspline.material.mapping import LawOnDevice

_CHUNK = 1 << 22

PARTED = np.array(list(product((-0.25, 0.25), repeat=3)))
"""(8, 3) Index steps from a voxel's centre to the points that it is read at where the surface crosses it."""


def voxel_mass_g(
    volume: Volume,
    region: Region,
    law: LawOnDevice,
    device: Device,
    surface_depth_mm: float | None = None,
    *,
    partial_volume: str = "none",
) -> float:
    """Mass of a region by its voxels: the density that the law gives each, times its part inside.

    A voxel that the boundary crosses counts by the part of its width along the boundary's normal that lies inside;
    those at the border of the scan count half, since neither region nor mesh goes beyond their centres.

    Arguments
    ---------
    volume, region: on one grid.
    surface_depth_mm: voxels nearer to the surface take their HU from this far inside, as the mesh does.
    partial_volume: ``"fold"`` gives them what the scan spread outside, as the mesh has it; with ``"none"`` a voxel that
        is half air counts its half of a density that is half air's, too.
    """
    part = _parts_inside(region)
    inside = np.flatnonzero(part)
    hu, weight = volume.hu.reshape(-1)[inside].astype(np.float32), part.reshape(-1)[inside].astype(np.float64)
    if surface_depth_mm is not None:
        hu = _read_from_inside(volume, region, inside, hu, surface_depth_mm, device)
    elif partial_volume == "fold":
        hu, weight = _folded(volume, region, inside, hu, weight, device)
    total, size = 0.0, min(_CHUNK, hu.size)
    rho, modulus, poisson = device.empty(size), device.empty(size), device.empty(size)
    piece = device.empty(size, np.int32)
    for first in range(0, hu.size, _CHUNK):
        values = hu[first : first + _CHUNK].astype(device.real)
        law.launch(device.put(values), values.size, rho, modulus, poisson, piece)
        density = device.get(rho)[: values.size]
        total += float(np.dot(weight[first : first + _CHUNK], density.astype(np.float64)))
    return total * volume.voxel_mm3 / 1000


def _read_from_inside(
    volume: Volume, region: Region, inside: NDArray[Any], hu: NDArray[Any], depth_mm: float, device: Device
) -> NDArray[Any]:
    """HU (n,) of the voxels ``inside``, those near the surface read at the depth."""
    near = np.flatnonzero(region.distance_mm.reshape(-1)[inside] > -depth_mm)
    if near.size:
        points = _places(volume, inside[near])
        moved = inset(region, depth_mm, points, device).move(points)
        hu[near] = hu_sampler(volume, moved, device).at(moved)
    return hu


def _folded(
    volume: Volume,
    region: Region,
    inside: NDArray[Any],
    hu: NDArray[Any],
    weight: NDArray[np.float64],
    device: Device,
) -> tuple[NDArray[Any], NDArray[np.float64]]:
    """HU and weight of the voxels ``inside``, with what was spread outside; of crossed ones at points inside."""
    edges = volume.affine[:3, :3].T
    near = region.distance_mm.reshape(-1)[inside] > -REACH * np.linalg.norm(edges, axis=1).sum()
    if not near.any():
        return hu, weight
    fold = folding(volume, region, _places(volume, inside[near]), device)
    values, weights = [hu[~near]], [weight[~near]]
    crossed = near & (weight < 1)
    whole = near & ~crossed
    for first in range(0, inside.size, _CHUNK // 8):
        some = slice(first, first + _CHUNK // 8)
        centres = _places(volume, inside[some][whole[some]])
        values.append(hu[some][whole[some]] + fold.correction(centres))
        weights.append(weight[some][whole[some]])
        places = _places(volume, inside[some][crossed[some]])[:, None] + PARTED @ edges
        in_body = fold.distance(places.reshape(-1, 3)).reshape(places.shape[:2]) < 0
        in_body[~in_body.any(axis=1)] = True
        points = places[in_body]
        values.append(fold.hu(points) + fold.correction(points))
        weights.append(np.repeat(weight[some][crossed[some]] / in_body.sum(axis=1), in_body.sum(axis=1)))
    return np.concatenate(values), np.concatenate(weights)


def _places(volume: Volume, voxels: NDArray[Any]) -> NDArray[np.float64]:
    k, j, i = np.unravel_index(voxels, volume.hu.shape)
    return volume.to_points(np.stack([i, j, k], axis=1))


def _parts_inside(region: Region) -> NDArray[np.float32]:
    """Part (n_k, n_j, n_i) of each voxel that is inside."""
    part = region.mask.astype(np.float32)
    widest = float(region.spacing_mm.sum()) / 2  # half a voxel's width across its diagonal, at the most
    k, j, i = np.nonzero(np.abs(region.distance_mm) < widest)
    near = region.distance_mm[k, j, i]
    width = _width_mm(region, (k, j, i))
    part[k, j, i] = np.clip(0.5 - near / width, 0, 1)
    for axis, size in enumerate(part.shape):
        if size > 1:
            along = np.moveaxis(part, axis, 0)
            along[0] *= 0.5
            along[-1] *= 0.5
    return part


def _width_mm(region: Region, at: tuple[NDArray[Any], ...]) -> NDArray[np.float64]:
    """Width (n,) of voxels along the gradient of the distance, mm: the projections of their edges added up."""
    slopes = []
    for axis, index in enumerate(at):
        steps = []
        for step in (1, -1):
            moved = list(at)
            moved[axis] = np.clip(index + step, 0, region.mask.shape[axis] - 1)
            steps.append((region.distance_mm[tuple(moved)].astype(np.float64), moved[axis]))
        (high, last), (low, first) = steps
        slopes.append((high - low) / np.maximum(last - first, 1))
    # the gradient along an index axis is the distance's change over that edge: slope . edge of the unit normal
    gradient = np.stack(slopes[::-1])  # along i, j, k
    normal = np.linalg.inv(region.affine[:3, :3]).T @ gradient
    length = np.maximum(np.linalg.norm(normal, axis=0), 1e-6)
    return np.asarray(np.maximum(np.abs(gradient).sum(axis=0) / length, 1e-6))
