"""The level set that a mesh of blocks conforms to: the region's distance, smoothed at the scale of an element.

Everything in this package happens in **lattice units**: the element size is 1, the axes are those of the lattice, and
distances count in elements. ``LevelSet.to_mm`` is the way back.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import SimpleITK as sitk
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from gpubspline.ct.region import Region
from gpubspline.device import Device
from gpubspline.errors import InputError

Floats = NDArray[np.float64]
Field = NDArray[np.float32]

SAMPLES = 3
"""Samples of the level set per element size."""

SMOOTHING = 0.6
"""Standard deviation, in elements, of the Gaussian that takes away what no element can follow."""

MARGIN = 3
"""Lattice cells around the region."""

CLIP = 3.0
"""Distances, in elements, beyond which the level set is flat."""

SMALLEST_CAVITY = 4.0
"""Volume, in elements, below which an enclosed cavity is filled: a sphere of two elements across."""

MOST_BULGE = 0.1
"""Farthest, in elements, that nodes are set outside the surface for the chords between them."""

CLOSING = 0.5
"""Radius, in elements, of the ball that must fit in what stays outside."""

GROOVE = 0.25
"""Depth, in elements, of the groove left at the mouth of a closed crack: more than distances between samples err."""

BAND = 0.4
"""Half the width, in elements, of the band of samples that the surface's area is taken from."""


@dataclass(frozen=True, eq=False)
class LevelSet:
    """A signed distance on a grid of a third of an element.

    Attributes
    ----------
    phi: (n_k, n_j, n_i) float32, in elements, negative inside; sample (0, 0, 0) lies at the origin of the lattice and
        every third sample is a corner of lattice cells.
    size_mm: of an element.
    to_mm: (4, 4) float64, lattice coordinates to LPS mm: a rotation times ``size_mm``, and a shift.
    """

    phi: NDArray[np.float32]
    size_mm: float
    to_mm: Floats

    @property
    def cells(self) -> tuple[int, int, int]:
        """Lattice cells along k, j, i."""
        n_k, n_j, n_i = ((n - 1) // SAMPLES for n in self.phi.shape)
        return n_k, n_j, n_i

    @cached_property
    def inside(self) -> NDArray[np.bool_]:
        """Samples inside."""
        return self.phi < 0

    @property
    def axes(self) -> Floats:
        """Rotation (3, 3), columns are the lattice's axes."""
        return np.asarray(self.to_mm[:3, :3] / self.size_mm)

    def in_mm(self, points: NDArray[Any]) -> Floats:
        """LPS mm (n, 3) of lattice coordinates (n, 3)."""
        return np.asarray(points.astype(np.float64) @ self.to_mm[:3, :3].T + self.to_mm[:3, 3])


def lattice_frame(region: Region, size_mm: float, rotation: Floats, offset: tuple[float, float, float]) -> Floats:
    """(4, 4) lattice coordinates to mm: the axes are columns of ``rotation``, the origin lies below the region.

    ``offset``, in elements from 0 to 1, shifts the lattice against the region.
    """
    low, _ = _extent(region, rotation)
    origin = rotation @ (low - (MARGIN + np.array(offset)) * size_mm)
    frame = np.eye(4)
    frame[:3, :3], frame[:3, 3] = rotation * size_mm, origin
    return frame


def lattice_cells(region: Region, size_mm: float, rotation: Floats) -> tuple[int, int, int]:
    """Cells along k, j, i that hold the region with its margin, for any offset."""
    low, high = _extent(region, rotation)
    count = np.ceil((high - low) / size_mm).astype(int) + 2 * MARGIN + 1
    return int(count[2]), int(count[1]), int(count[0])


def _extent(region: Region, rotation: Floats) -> tuple[Floats, Floats]:
    """Least and greatest coordinate of the voxels inside along each lattice axis, mm."""
    k, j, i = np.nonzero(region.mask)
    ends = np.stack([i, j, k], axis=1)[_outermost(i, j, k)]
    along = (ends @ region.affine[:3, :3].T + region.affine[:3, 3]) @ rotation
    reach = np.abs(rotation.T @ region.affine[:3, :3]).sum(axis=1)  # the boundary lies within a voxel
    return along.min(axis=0) - reach, along.max(axis=0) + reach


def _outermost(i: NDArray[Any], j: NDArray[Any], k: NDArray[Any]) -> NDArray[Any]:
    """Indices of the first and the last voxel of each row: no other can lie farthest out."""
    order = np.lexsort((i, j, k))
    new = (np.diff(j[order]) != 0) | (np.diff(k[order]) != 0)
    first = np.concatenate([[True], new])
    last = np.concatenate([new, [True]])
    return np.asarray(order[first | last])


def level_set(
    region: Region,
    size_mm: float,
    *,
    rotation: Floats | None = None,
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0),
    smoothing: float = SMOOTHING,
    closing: float = CLOSING,
    device: Device,
) -> LevelSet:
    """Sample the region's distance on a lattice, smooth it, keep the largest body and fill small cavities.

    Where the region meets the border of its grid, the outermost voxel centres bound it.

    Arguments
    ---------
    size_mm: of an element.
    rotation: (3, 3), columns are the lattice's axes; None takes the patient's.
    offset: of the lattice against the region, in elements.
    smoothing: standard deviation of the Gaussian, in elements.
    closing: radius of the ball that must fit in what stays outside, in elements.

    Raises
    ------
    InputError where the size is not positive, or nothing as thick as an element is inside.
    """
    if not (np.isfinite(size_mm) and size_mm > 0):
        raise InputError(f"expected an element size above 0 mm, got {size_mm}")
    rotation = np.eye(3) if rotation is None else rotation
    frame = lattice_frame(region, size_mm, rotation, offset)
    shape = tuple(SAMPLES * n + 1 for n in lattice_cells(region, size_mm, rotation))
    phi = close_cracks(_sampled(region, frame, shape, device) / np.float32(size_mm), closing)
    phi = _smooth(phi, smoothing * SAMPLES)
    return LevelSet(_one_body(phi, region, size_mm), size_mm, frame)


def bulged(phi: NDArray[np.float32]) -> NDArray[np.float32]:
    """Move the zero level by the mean sag of bilinear faces of one element between nodes on it.

    Across a curvature c a chord of length 1 sags by c / 12 on average. Nodes that lie so much farther out leave as
    much of the mesh outside the surface as inside, and its volume right to second order.
    """
    bent = np.zeros_like(phi)
    for axis in range(3):
        line, out = np.moveaxis(phi, axis, 0), np.moveaxis(bent, axis, 0)
        out[SAMPLES:-SAMPLES] += line[2 * SAMPLES :] - 2 * line[SAMPLES:-SAMPLES] + line[: -2 * SAMPLES]
    return np.asarray(phi - np.clip(bent / np.float32(12), -MOST_BULGE, MOST_BULGE), dtype=np.float32)


def volume_inside(phi: NDArray[np.float32]) -> float:
    """Volume, in elements, that the zero level holds."""
    return float(_share_inside(phi).sum(dtype=np.float64)) / SAMPLES**3


@dataclass(frozen=True, eq=False)
class Part:
    """Distance, in elements, of one of the bodies of a level set's region, on its grid.

    Attributes
    ----------
    phi: smoothed as the level set is.
    raw: as it was sampled.
    """

    phi: Field
    raw: Field


def part_of(level: LevelSet, region: Region, *, smoothing: float = SMOOTHING, device: Device) -> Part:
    """Sample the distance of one of the bodies of a level set's region."""
    sampled = _sampled(region, level.to_mm, level.phi.shape, device)
    raw = np.clip(sampled / np.float32(level.size_mm), -CLIP, CLIP)
    return Part(_smooth(raw, smoothing * SAMPLES), raw)


def _sampled(region: Region, frame: Floats, shape: tuple[int, ...], device: Device) -> NDArray[np.float32]:
    """Distance, mm, of the region bounded by its grid, at the samples of the level set."""
    inverse = np.linalg.inv(region.affine)
    to_index = inverse[:3] @ frame @ np.diag([1 / SAMPLES, 1 / SAMPLES, 1 / SAMPLES, 1.0])
    gap_mm = 1 / np.linalg.norm(inverse[:3, :3], axis=1)
    n_k, n_j, n_i = shape
    volume, out = device.put(region.distance_mm), device.empty(shape)
    grid = (volume, *region.shape, device.put(np.ascontiguousarray(to_index)), device.put(gap_mm))
    device.launch("resample.lattice", (n_k * n_j, n_i), *grid, n_i, n_j, out)
    return np.array(device.get(out), dtype=np.float32).reshape(shape)


def _smooth(phi: NDArray[np.float32], sigma: float) -> NDArray[np.float32]:
    """Twice the smoothed distance minus the twice smoothed one: to first order curved surfaces stay where they are."""
    phi = np.clip(phi, -CLIP, CLIP)
    if sigma == 0:
        return phi
    once = gaussian_filter(phi, sigma, truncate=3.0, mode="nearest")
    twice = gaussian_filter(once, sigma, truncate=3.0, mode="nearest")
    return brought_back(np.asarray(2 * once - twice, dtype=np.float32), phi)


def brought_back(smooth: NDArray[np.float32], phi: NDArray[np.float32]) -> NDArray[np.float32]:
    """Move the zero level until it holds the volume of the unsmoothed one, within an element or so around.

    Smoothing flattens the ridge of a distance half way between two sheets, which draws near ones: it thickened plates
    of 2.5 elements by 3 %. With the volume kept edges stay round, and as much is outside as inside.
    """
    near = np.maximum(0, 1 - np.abs(smooth) * np.float32(1 / BAND)).astype(np.float32)
    change = _share_inside(smooth)
    change -= _share_inside(phi)
    return np.asarray(smooth + spread(_of_cells(near) / BAND, _of_cells(change), smooth.shape), dtype=np.float32)


def _share_inside(phi: NDArray[np.float32]) -> NDArray[np.float32]:
    """Share of the box of each sample that lies inside, as if it faced the surface."""
    return np.asarray(np.clip(0.5 - SAMPLES * phi, 0, 1), dtype=np.float32)


def _of_cells(samples: NDArray[np.float32]) -> NDArray[np.float32]:
    """Sums over the samples of each lattice cell, but for those of its far sides."""
    n_k, n_j, n_i = ((n - 1) // SAMPLES for n in samples.shape)
    each = samples[:-1, :-1, :-1].reshape(n_k, SAMPLES, n_j, SAMPLES, n_i, SAMPLES)
    return np.asarray(each.sum(axis=(1, 3, 5)))


def spread(weight: NDArray[Any], total: NDArray[Any], shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Mean of what was weighed and summed up in each lattice cell, over an element or so around, at samples."""
    around = gaussian_filter(weight.astype(np.float32), 1.0, truncate=3.0)
    summed = gaussian_filter(total.astype(np.float32), 1.0, truncate=3.0)
    mean = np.where(around > 0, summed / np.where(around > 0, around, 1), 0)
    return _of_samples(mean.astype(np.float32), shape)


def _of_samples(cells: NDArray[np.float32], shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Values of cells (n_k, n_j, n_i), linear between the middles of what they were summed over, at samples."""
    for axis, n in enumerate(shape):
        at = np.clip((np.arange(n) - (SAMPLES - 1) / 2) / SAMPLES, 0, cells.shape[axis] - 1)
        low = np.minimum(at.astype(int), cells.shape[axis] - 2)
        share = (at - low).astype(np.float32).reshape([-1 if a == axis else 1 for a in range(3)])
        cells = cells.take(low, axis) * (1 - share) + cells.take(low + 1, axis) * share
    return cells


def close_cracks(phi: NDArray[np.float32], radius: float) -> NDArray[np.float32]:
    """Fill what is outside but nowhere as wide as a ball of ``radius`` elements: cracks, pores, thin tunnels.

    Morphological closing: grown by the radius, then shrunk by it. Only what ends up deeper inside than ``GROOVE`` is
    taken, so that the surface stays exact elsewhere.
    """
    if radius == 0:
        return phi
    grown = sitk.GetImageFromArray((phi < radius).astype(np.uint8))
    depth = sitk.GetArrayFromImage(sitk.SignedMaurerDistanceMap(grown, True, False, False))
    shrunk = np.float32(radius) - depth / np.float32(SAMPLES)
    return np.asarray(np.minimum(phi, shrunk + np.float32(GROOVE)), dtype=np.float32)


def _one_body(phi: NDArray[np.float32], region: Region, size_mm: float) -> NDArray[np.float32]:
    """Push everything but the largest body outside, and cavities that hold no element inside."""
    inside = phi < 0
    if not inside.any():
        raise InputError(
            f"expected a region thicker than an element of {size_mm:g} mm, got none: the region's voxels are "
            f"{region.spacing_mm.min():g} mm and it holds {np.count_nonzero(region.mask):,}: ask for a smaller size"
        )
    bodies, sizes = _components(inside)
    phi = np.where(inside & (bodies != np.argmax(sizes) + 1), np.abs(phi) + np.float32(1e-3), phi)
    holes, sizes = _components(~(phi < 0))
    small = np.flatnonzero(sizes < SMALLEST_CAVITY * SAMPLES**3) + 1
    if small.size:
        phi = np.where(np.isin(holes, small), -np.abs(phi) - np.float32(1e-3), phi)
    return np.asarray(phi, dtype=np.float32)


def _components(mask: NDArray[np.bool_]) -> tuple[NDArray[Any], NDArray[np.int64]]:
    """Number of the face-connected body of each sample, from 1, and the samples of each body."""
    labels = sitk.GetArrayFromImage(sitk.ConnectedComponent(sitk.GetImageFromArray(mask.astype(np.uint8))))
    return labels, np.bincount(labels.reshape(-1))[1:]
