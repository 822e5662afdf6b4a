"""A region's distance at the samples of a lattice, where they are near its surface.

Which bricks are near is known from the voxels that lie in and around each, so that no other is sampled.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from gpubspline.ct.region import Region
from gpubspline.device import Device
from gpubspline.mesh.blocks.bricks import EDGE, INSIDE, OUTSIDE, Bricks, bricks_where, with_neighbours

Floats = NDArray[np.float64]


def sample_near(
    region: Region, to_index: Floats, shape: tuple[int, ...], size_mm: float, far: float, edge: float, device: Device
) -> tuple[Bricks, NDArray[np.float32]]:
    """Sample the distance of a region bounded by its grid, in elements, no more than ``far`` and no less than ``-far``.

    Arguments
    ---------
    to_index: (3, 4), indices (i, j, k) of samples to those of voxels.
    shape: (n_k, n_j, n_i) samples.
    size_mm: of an element.
    edge: distance whose level set has all bricks round it kept too, though they may lie farther.
    """
    near, inside = _near(region, to_index, shape, far * size_mm)
    found = bricks_where(near, inside, shape)
    values = np.empty((found.count + 2, EDGE, EDGE, EDGE), dtype=np.float32)
    values[:-2] = _sampled(region, to_index, near, device)
    values[:-2] /= np.float32(size_mm)
    values[INSIDE], values[OUTSIDE] = -far, far
    np.clip(values, -far, far, out=values)
    within = values[:-2].reshape(found.count, -1)
    least, most = within.min(axis=1, initial=far), within.max(axis=1, initial=-far)
    crossed, close = (np.zeros(near.shape, dtype=bool) for _ in range(2))
    crossed[near], close[near] = (least < edge) & (most >= edge), (least < far) & (most > -far)
    inside[near] = most < 0
    kept = bricks_where(close | with_neighbours(crossed), inside, shape)
    return kept, values[np.concatenate([found.numbers[kept.numbers >= 0], [INSIDE, OUTSIDE]])]


def _sampled(region: Region, to_index: Floats, near: NDArray[np.bool_], device: Device) -> NDArray[Any]:
    """Distance (n, EDGE, EDGE, EDGE), mm, in bricks."""
    corners = EDGE * np.stack(np.nonzero(near)[::-1], axis=1)
    gap_mm = 1 / np.linalg.norm(np.linalg.inv(region.affine)[:3, :3], axis=1)
    out = device.empty((len(corners), EDGE, EDGE, EDGE))
    grid = (device.put(region.distance_mm), *region.shape, device.put(np.ascontiguousarray(to_index)))
    at = (device.put(gap_mm), device.put(corners.astype(np.int32)), EDGE)
    device.launch("resample.bricks", (len(corners) * EDGE * EDGE, EDGE), *grid, *at, out)
    return np.asarray(device.get(out))


def _near(
    region: Region, to_index: Floats, shape: tuple[int, ...], far_mm: float
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Bricks (b_k, b_j, b_i) that may hold distances below ``far_mm``, and those that lie inside beyond it.

    Each samples the voxels of a box, and the planes of the outermost centres.
    """
    bricks = [-(-n // EDGE) for n in shape]
    k, j, i = np.indices(bricks) * EDGE + 0.5 * (EDGE - 1)
    half = np.abs(to_index[:, :3]).sum(axis=1) * 0.5 * (EDGE - 1)  # of the box, voxels
    low, high = _extremes(region.distance_mm, 2 * half)
    least, most = np.full(k.shape, -np.inf), np.full(k.shape, -np.inf)
    starts = []
    for axis, count in enumerate(region.distance_mm.shape[::-1]):
        x, y, z, shift = to_index[axis]
        middle = x * i + y * j + z * k + shift
        first, last = middle - half[axis], middle + half[axis]
        gap_mm = 1 / np.linalg.norm(np.linalg.inv(region.affine)[axis, :3])
        least = np.maximum(least, gap_mm * np.maximum(-last, first - (count - 1)))
        most = np.maximum(most, gap_mm * np.maximum(-first, last - (count - 1)))
        starts.append(np.clip(np.floor(first), 0, count - 1).astype(np.int64))
    at = tuple(start // block for start, block in zip(starts[::-1], _blocks(2 * half)[::-1], strict=True))
    least, most = np.maximum(least, low[at]), np.maximum(most, high[at])
    return (least < far_mm) & (most > -far_mm), most <= -far_mm


def _blocks(extent: Floats) -> tuple[int, ...]:
    """Voxels along i, j, k of blocks, of which a box of this extent holds a few."""
    return tuple(max(1, int(length / 2)) for length in extent)


def _extremes(values: NDArray[np.float32], extent: Floats) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Least and greatest value of the voxels that places in a box of this extent are between, by its first block."""
    low = high = values
    for axis, (block, length) in enumerate(zip(_blocks(extent)[::-1], extent[::-1], strict=True)):
        starts = np.arange(0, values.shape[axis], block)
        count = (int(np.ceil(length)) + 1) // block + 2
        low, high = (
            window(reduce.reduceat(of, starts, axis=axis), count, axis=axis, mode="nearest", origin=-(count // 2))
            for of, reduce, window in ((low, np.minimum, minimum_filter1d), (high, np.maximum, maximum_filter1d))
        )
    return low, high
