"""What a user should know about a mapping before trusting it: counted always, not only when it is bad."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.ct.region import Region
from gpubspline.ct.sampler import hu_sampler
from gpubspline.ct.volume import Volume
from gpubspline.device import Device
from gpubspline.material.inset import inset
from gpubspline.material.laws import Law
from gpubspline.material.mapping import LawOnDevice

NEAR_ZERO_MPA = 10.0
"""A modulus below this is softer than the bone that any of the laws was fitted to: marrow, air, or a wrong unit."""

MASS_TOLERANCE = 0.01
"""Relative difference of the mesh's mass from the voxels' that is worth an alarm."""


@dataclass(frozen=True)
class Alarms:
    """Counts of a mapping.

    Attributes
    ----------
    mapping: one of ``assign.MAPPINGS``.
    of: what was counted, ``"nodes"`` or ``"elements"``.
    count: how many there are.
    outside: of them, those whose HU no range of the law covers.
    beyond_specimens: those whose density none of the law's specimens had; None where these are unknown.
    near_zero: those whose modulus is below ``NEAR_ZERO_MPA``.
    mass_mesh_g: density integrated over the mesh; None for quads.
    mass_voxels_g: the same law over the region's voxels; None without the CT.
    order_difference: of ``element-hu`` and ``element-e`` from each other, relative: mean by volume, and greatest.
    surface_depth_mm: how far inside the HU of the surface was read.
    """

    mapping: str
    of: str
    count: int
    outside: int
    beyond_specimens: int | None
    near_zero: int
    mass_mesh_g: float | None = None
    mass_voxels_g: float | None = None
    order_difference: tuple[float, float] | None = None
    surface_depth_mm: float | None = None

    @property
    def mass_difference(self) -> float | None:
        """Mass of the mesh over that of the voxels, less 1."""
        if self.mass_mesh_g is None or not self.mass_voxels_g:
            return None
        return self.mass_mesh_g / self.mass_voxels_g - 1

    def to_dict(self) -> dict[str, Any]:
        """Plain values, for JSON."""
        order = self.order_difference
        return {
            "mapping": self.mapping,
            "surface_depth_mm": self.surface_depth_mm,
            "of": self.of,
            "count": self.count,
            "outside_law": self.outside / self.count,
            "beyond_specimens": None if self.beyond_specimens is None else self.beyond_specimens / self.count,
            "near_zero_modulus": self.near_zero / self.count,
            "near_zero_mpa": NEAR_ZERO_MPA,
            "mass_g": {"mesh": self.mass_mesh_g, "voxels": self.mass_voxels_g, "difference": self.mass_difference},
            "order_difference": None if order is None else {"mean": order[0], "max": order[1]},
        }


def count_alarms(
    mapping: str, of: str, law: Law, density: NDArray[Any], modulus: NDArray[Any], piece: NDArray[Any], **others: Any
) -> Alarms:
    """Count the alarms of n nodes or elements: density (n), g/cm3, modulus (n), MPa, and piece (n) of the law."""
    beyond = None
    if law.specimens_g_cm3 is not None:
        low, high = law.specimens_g_cm3
        beyond = int(np.count_nonzero((density < low) | (density > high)))
    outside, soft = int(np.count_nonzero(piece < 0)), int(np.count_nonzero(modulus < NEAR_ZERO_MPA))
    return Alarms(mapping, of, piece.size, outside, beyond, soft, **others)


def add_alarms(parts: Sequence[Alarms], mass_voxels_g: float | None = None) -> Alarms:
    """Alarms of a mesh from those of its parts, which were mapped alike."""
    first = parts[0]
    beyond = [part.beyond_specimens for part in parts if part.beyond_specimens is not None]
    masses = [part.mass_mesh_g for part in parts if part.mass_mesh_g is not None]
    return Alarms(
        first.mapping,
        first.of,
        sum(part.count for part in parts),
        sum(part.outside for part in parts),
        sum(beyond) if beyond else None,
        sum(part.near_zero for part in parts),
        sum(masses) if masses else None,
        mass_voxels_g,
    )


def voxel_mass_g(
    volume: Volume, region: Region, law: LawOnDevice, device: Device, surface_depth_mm: float | None = None
) -> float:
    """Mass of a region by its voxels: the density that the law gives each, times its part inside.

    A voxel that the boundary crosses counts by the part of its width along the boundary's normal that lies inside;
    those at the border of the scan count half, since neither region nor mesh goes beyond their centres.

    Arguments
    ---------
    volume, region: on one grid.
    surface_depth_mm: voxels nearer to the surface take their HU from this far inside, as the mesh does; else a voxel
        that is half air counts its half of a density that is half air's, too.
    """
    part = _parts_inside(region)
    inside = np.flatnonzero(part)
    hu, total = volume.hu.reshape(-1), 0.0
    if surface_depth_mm is not None:
        hu = _read_from_inside(volume, region, inside, surface_depth_mm, device)
    size = min(_CHUNK, inside.size)
    rho, modulus, poisson = device.empty(size), device.empty(size), device.empty(size)
    piece = device.empty(size, np.int32)
    for first in range(0, inside.size, _CHUNK):
        voxels = inside[first : first + _CHUNK]
        law.launch(device.put(hu[voxels].astype(device.real)), voxels.size, rho, modulus, poisson, piece)
        density = device.get(rho)[: voxels.size]
        total += float(np.dot(part.reshape(-1)[voxels], density.astype(np.float64)))
    return total * volume.voxel_mm3 / 1000


_CHUNK = 1 << 22


def _read_from_inside(
    volume: Volume, region: Region, inside: NDArray[Any], depth_mm: float, device: Device
) -> NDArray[np.float32]:
    """HU of all voxels, flat, those of ``inside`` near the surface read at the depth."""
    hu = volume.hu.reshape(-1).astype(np.float32)
    near = inside[region.distance_mm.reshape(-1)[inside] > -depth_mm]
    if near.size:
        k, j, i = np.unravel_index(near, volume.hu.shape)
        points = volume.to_points(np.stack([i, j, k], axis=1))
        moved = inset(region, depth_mm, points, device).move(points)
        hu[near] = hu_sampler(volume, moved, device).at(moved)
    return hu


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
