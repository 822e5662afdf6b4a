"""Mass of a body by its voxels, which that of its mesh is compared with."""

from collections.abc import Mapping
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from gpubspline.ct.partial_volume import REACH, folding
from gpubspline.ct.region import Region
from gpubspline.ct.sampler import hu_sampler
from gpubspline.ct.volume import Volume
from gpubspline.device import Device
from gpubspline.errors import InputError
from gpubspline.material.inset import inset
from gpubspline.material.mapping import LawOnDevice

_CHUNK = 1 << 22

PARTED = np.array(list(product((-0.25, 0.25), repeat=3)))
"""(8, 3) Index steps i, j, k from the centre of a voxel near the surface to those of its eighths."""

_CORNERS = np.array(list(product((-0.5, 0.0, 0.5), repeat=3))).T
"""(3, 27) Index steps to the corners of the eighths."""


def voxel_mass_g(
    volume: Volume,
    region: Region,
    law: LawOnDevice,
    device: Device,
    surface_depth_mm: float | None = None,
    *,
    partial_volume: str = "none",
    by_label: Mapping[int, LawOnDevice] | None = None,
    labels: NDArray[np.integer] | None = None,
) -> float:
    """Mass of a region by its voxels: the density that the law gives each, times its part inside.

    A voxel near the boundary counts by its eighths, each by the part of it within the trilinear boundary; those at the
    border of the scan count half, since neither region nor mesh goes beyond their centres.

    Arguments
    ---------
    volume, region: on one grid.
    surface_depth_mm: voxels nearer to the surface take their HU from this far inside, as the mesh does.
    partial_volume: ``"fold"`` gives them what the scan spread outside, as the mesh has it; with ``"none"`` a voxel that
        is half air counts its half of a density that is half air's, too.
    by_label: laws of some of the ``labels`` (n_k, n_j, n_i) of voxels.

    Raises
    ------
    InputError where laws go by labels and there are none.
    """
    if by_label and labels is None:
        raise InputError("expected the labels of the voxels with laws by label, got none")
    part = _parts_inside(region)
    inside = np.flatnonzero(part)
    how = (device, surface_depth_mm, partial_volume)
    if not by_label or labels is None:
        return _mass_g(volume, region, law, inside, part, *how)
    own, total = labels.reshape(-1)[inside], 0.0
    for label, its_law in by_label.items():
        total += _mass_g(volume, region, its_law, inside[own == label], part, *how)
    return total + _mass_g(volume, region, law, inside[~np.isin(own, list(by_label))], part, *how)


def _mass_g(
    volume: Volume,
    region: Region,
    law: LawOnDevice,
    inside: NDArray[Any],
    part: NDArray[np.float32],
    device: Device,
    surface_depth_mm: float | None,
    partial_volume: str,
) -> float:
    """Mass of the voxels ``inside``, by their flat indices."""
    if not inside.size:
        return 0.0
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
    chosen, border = np.flatnonzero(near), _within_scan(region.mask.shape).reshape(-1)[inside]
    for first in range(0, chosen.size, _CHUNK // 8):
        some = chosen[first : first + _CHUNK // 8]
        shares = _shares_inside(region, inside[some]) * border[some, None] / len(PARTED)
        points = (_places(volume, inside[some])[:, None] + PARTED @ edges)[shares > 0]
        values.append(fold.hu(points) + fold.correction(points))
        weights.append(shares[shares > 0])
    return np.concatenate(values), np.concatenate(weights)


def _places(volume: Volume, voxels: NDArray[Any]) -> NDArray[np.float64]:
    k, j, i = np.unravel_index(voxels, volume.hu.shape)
    return volume.to_points(np.stack([i, j, k], axis=1))


def _parts_inside(region: Region) -> NDArray[np.float32]:
    """Part (n_k, n_j, n_i) of each voxel that is inside."""
    part = region.mask.astype(np.float32)
    widest = float(region.spacing_mm.sum()) / 2  # half a voxel's width across its diagonal, at the most
    near = np.flatnonzero(np.abs(region.distance_mm) < widest)
    for first in range(0, near.size, _CHUNK // 8):
        some = near[first : first + _CHUNK // 8]
        part.reshape(-1)[some] = _shares_inside(region, some).mean(axis=1)
    return part * _within_scan(part.shape)


def _within_scan(shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Part (n_k, n_j, n_i) of each voxel that lies between the outermost centres; an axis of one is a voxel thick."""
    ends = [np.where((np.arange(n) % max(n - 1, 1) == 0) & (n > 1), np.float32(0.5), np.float32(1)) for n in shape]
    return np.asarray(ends[0][:, None, None] * ends[1][:, None] * ends[2])


def _shares_inside(region: Region, voxels: NDArray[Any]) -> NDArray[np.float64]:
    """Part (n, 8) of each eighth of voxels, by their flat indices, that is inside: as if distances were linear in it.

    An eighth lies in one cell between voxel centres, where the distance is trilinear: its middle and its change along
    each axis are means over its corners.
    """
    at = np.unravel_index(voxels, region.mask.shape)
    k, j, i = (index[:, None] + _CORNERS[axis] for index, axis in zip(at, (2, 1, 0), strict=True))
    at_corners = map_coordinates(region.distance_mm, (k, j, i), np.float64, order=1, mode="nearest")
    corners = at_corners.reshape(-1, 3, 3, 3)
    middle, change = corners, np.zeros((len(voxels), 2, 2, 2))
    for axis in (1, 2, 3):
        middle, along = _pairs(middle, axis)[0], corners
        for other in (1, 2, 3):
            along = _pairs(along, other)[int(other == axis)]
        change += np.abs(along)
    return np.asarray(np.clip(0.5 - middle / np.maximum(change, 1e-6), 0, 1).reshape(-1, 8))


def _pairs(values: NDArray[Any], axis: int) -> tuple[NDArray[Any], NDArray[Any]]:
    """Means and differences of neighbours along an axis."""
    line = np.moveaxis(values, axis, 0)
    return np.moveaxis((line[:-1] + line[1:]) / 2, 0, axis), np.moveaxis(line[1:] - line[:-1], 0, axis)
