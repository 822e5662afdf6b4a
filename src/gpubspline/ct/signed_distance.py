"""A signed distance in millimetres from a mask and the sub-voxel crossings of a level function.

Grids may be anisotropic, left-handed and sheared. With E the voxel steps in mm as columns, an index gradient g is the
physical gradient E^-T g, and everything below is measured in physical space.

1. Every grid edge between an inside and an outside voxel is crossed at a fraction s of its length.
2. A voxel with crossings (the band) lies at the distance |n . s E e| from the plane through a crossing on its edge E e,
   n being the mean of the unit normals of the edge's two ends: both ends see one plane, so that linear interpolation of
   the distance along the edge returns the crossing. Several crossings are averaged by the squared cosine between edge
   and normal.
3. Normals are first those of the plane through a voxel's own crossings, then twice the gradient of the distance itself.
4. Other voxels take the distance to the nearest foot point of the band, seen as a disc that spans its neighbours.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, maximum_filter
from scipy.spatial import KDTree

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

MARGIN = 6
"""Voxels around the mask in which the distance is measured to the nearest foot point."""

SEARCH_SLACK = 0.1
"""A foot point this share farther than the nearest one may be taken for it: half the time, and discs hardly differ."""

_LEAST_FRACTION = 1e-3  # keeps distances off zero, so that their sign is the mask's


@dataclass(frozen=True)
class Crossings:
    """Where grid edges along one index axis cross the boundary.

    Attributes
    ----------
    axis: 0, 1, 2 for edges along i, j, k.
    near, far: (n,) flat indices of the edge's two voxels, ``far`` one step up the axis.
    fraction: (n,) where the boundary lies between them, 0 at ``near``.
    """

    axis: int
    near: NDArray[np.int64]
    far: NDArray[np.int64]
    fraction: Floats


@dataclass(frozen=True)
class Band:
    """Voxels with a crossing.

    Attributes
    ----------
    voxels: (n,) flat indices, increasing.
    points: (n, 3) their centres, mm from the centre of the first voxel.
    sign: (n,) -1 inside, 1 outside.
    """

    voxels: NDArray[np.int64]
    points: Floats
    sign: Floats


def signed_distance(inside: Mask, level: NDArray[Any], affine: Floats) -> NDArray[np.float32]:
    """Measure the distance to the boundary of a mask, negative inside.

    No boundary is invented where the mask meets the border of the grid. Beyond ``MARGIN`` voxels around the mask the
    distance is an upper bound.

    Arguments
    ---------
    inside: (n_k, n_j, n_i) bool, with at least one voxel.
    level: same shape, negative inside; on an edge between an inside and an outside voxel the boundary is its linear
        zero, or halfway where its signs contradict the mask.
    affine: (4, 4), index (i, j, k) to mm.

    Returns: (n_k, n_j, n_i) float32, mm; negative exactly where ``inside``.
    """
    window = box_around(inside, MARGIN)
    steps = np.asarray(affine[:3, :3], dtype=np.float64)
    close = _distance_in_box(inside[window], level[window], steps)
    return _extend(close, window, inside.shape, steps)


def box_around(inside: Mask, margin: int) -> tuple[slice, ...]:
    """Slices of the smallest box that holds the mask, grown by ``margin`` voxels within the array."""
    window = []
    for axis, size in enumerate(inside.shape):
        other = tuple(a for a in range(inside.ndim) if a != axis)
        hit = np.flatnonzero(inside.any(axis=other))
        window.append(slice(max(0, int(hit[0]) - margin), min(size, int(hit[-1]) + 1 + margin)))
    return tuple(window)


def find_crossings(inside: Mask, level: NDArray[Any]) -> list[Crossings]:
    """Crossings of the boundary along each of the three index axes."""
    found = []
    for axis in range(3):
        low = np.moveaxis(inside, 2 - axis, 0)
        changed = np.moveaxis(low[:-1] != low[1:], 0, 2 - axis)
        near = np.ravel_multi_index(np.nonzero(changed), inside.shape)
        far = near + (1, inside.shape[2], inside.shape[1] * inside.shape[2])[axis]
        found.append(Crossings(axis, near, far, _fractions(inside, level, near, far)))
    return found


def _fractions(inside: Mask, level: NDArray[Any], near: NDArray[Any], far: NDArray[Any]) -> Floats:
    a, b = level.reshape(-1)[near].astype(np.float64), level.reshape(-1)[far].astype(np.float64)
    first = inside.reshape(-1)[near]
    agrees = np.where(first, (a <= 0) & (b >= 0), (a >= 0) & (b <= 0)) & (a != b)
    fraction = np.where(agrees, a / np.where(agrees, a - b, 1.0), 0.5)
    return np.clip(fraction, _LEAST_FRACTION, 1 - _LEAST_FRACTION)


def _distance_in_box(inside: Mask, level: NDArray[Any], steps: Floats) -> NDArray[np.float32]:
    edges = find_crossings(inside, np.ascontiguousarray(level))
    inside = np.ascontiguousarray(inside)
    voxels = np.unique(np.concatenate([ends for edge in edges for ends in (edge.near, edge.far)]))
    if not len(voxels):  # the mask fills the grid
        return np.full(inside.shape, -np.linalg.norm(steps @ np.array(inside.shape[::-1])), dtype=np.float32)
    sign = np.where(inside.reshape(-1)[voxels], -1.0, 1.0)
    band = Band(voxels, _centres(voxels, inside.shape, steps), sign)
    distance, normals = _crossing_planes(band, edges, steps)
    result = np.where(inside, np.float32(-1), np.float32(1))  # any finite value: only filled ones are read
    around = _layers_around(band, inside.shape, 1)
    for _ in range(2):
        _fill(result, band, distance, normals, around, inside, steps)
        normals = _gradient_normals(result, band, normals, steps)
        distance = _edge_planes(band, edges, normals, distance, steps)
    feet = band.points - (band.sign * distance)[:, None] * normals
    result = _far_field(inside, band, feet, normals, steps)
    _fill(result, band, distance, normals, _layers_around(band, inside.shape, 3), inside, steps)
    return result


def _centres(voxels: NDArray[np.int64], shape: tuple[int, ...], steps: Floats) -> Floats:
    rest, i = np.divmod(voxels, shape[2])
    k, j = np.divmod(rest, shape[1])
    return np.asarray(np.stack([i, j, k], axis=1).astype(np.float64) @ steps.T)


def _crossing_planes(band: Band, edges: list[Crossings], steps: Floats) -> tuple[Floats, Floats]:
    """Distance (n,) and outward unit normal (n, 3) of the plane through the nearest crossing along each axis."""
    gradient = np.zeros((len(band.voxels), 3))
    for edge in edges:
        up = np.zeros(len(band.voxels))
        down = np.zeros(len(band.voxels))
        up[np.searchsorted(band.voxels, edge.near)] = 1 / edge.fraction
        down[np.searchsorted(band.voxels, edge.far)] = 1 / (1 - edge.fraction)
        gradient[:, edge.axis] = np.where(up >= down, up, -down) * -band.sign
    physical = gradient @ np.linalg.inv(steps)
    length = np.linalg.norm(physical, axis=1)
    return 1 / length, physical / length[:, None]


def _edge_planes(band: Band, edges: list[Crossings], normals: Floats, fallback: Floats, steps: Floats) -> Floats:
    """Distance (n,) to the planes through a voxel's crossings, averaged by the squared cosine of edge and normal."""
    total, weight = np.zeros(len(fallback)), np.zeros(len(fallback))
    for edge in edges:
        near, far = np.searchsorted(band.voxels, edge.near), np.searchsorted(band.voxels, edge.far)
        mean = normals[near] + normals[far]
        length = np.linalg.norm(mean, axis=1)
        height = np.abs(mean @ steps[:, edge.axis]) / np.maximum(length, 1e-12)
        cosine = height / np.linalg.norm(steps[:, edge.axis])
        share = np.where(length > 0.5, cosine**2, 0.0)  # normals that cancel belong to a sheet of one voxel
        for ends, fraction in ((near, edge.fraction), (far, 1 - edge.fraction)):
            total += np.bincount(ends, share * fraction * height, len(total))
            weight += np.bincount(ends, share, len(total))
    return np.where(weight > 1e-3, total / np.maximum(weight, 1e-3), fallback)


def _gradient_normals(distance: NDArray[np.float32], band: Band, fallback: Floats, steps: Floats) -> Floats:
    """Outward unit normals (n, 3) at the band from the distance at its 26 neighbours (Sobel's weights)."""
    padded = np.pad(distance, 1, mode="reflect", reflect_type="odd")
    strides = np.array([padded.shape[1] * padded.shape[2], padded.shape[2], 1])
    middle = (np.stack(np.unravel_index(band.voxels, distance.shape), axis=1) + 1) @ strides
    values = padded.reshape(-1)
    gradient = np.zeros((len(middle), 3))
    for offset in np.ndindex(3, 3, 3):
        k, j, i = (o - 1 for o in offset)
        sample = values[middle + np.array([k, j, i]) @ strides].astype(np.float64)
        for axis, along, across in ((0, i, abs(j) + abs(k)), (1, j, abs(i) + abs(k)), (2, k, abs(i) + abs(j))):
            if along:
                gradient[:, axis] += along * (4, 2, 1)[across] / 32 * sample
    physical = gradient @ np.linalg.inv(steps)
    length = np.linalg.norm(physical, axis=1)
    steady = length > 0.3  # a distance has slope 1; much less is a sheet of one voxel
    return np.where(steady[:, None], physical / np.where(steady, length, 1.0)[:, None], fallback)


def _layers_around(band: Band, shape: tuple[int, ...], layers: int) -> NDArray[np.int64]:
    """Flat indices of the voxels within some layers of the band, without it."""
    mask = np.zeros(shape, dtype=np.uint8)
    mask.reshape(-1)[band.voxels] = 1
    grown = maximum_filter(mask, size=2 * layers + 1)
    return np.flatnonzero(grown.reshape(-1) > mask.reshape(-1))


def _fill(
    result: NDArray[np.float32],
    band: Band,
    distance: Floats,
    normals: Floats,
    around: NDArray[np.int64],
    inside: Mask,
    steps: Floats,
) -> None:
    """Write the band's distance, and that of voxels around it to the nearest foot point, exactly searched."""
    feet = band.points - (band.sign * distance)[:, None] * normals
    points = _centres(around, inside.shape, steps)
    _, nearest = KDTree(feet, balanced_tree=False, compact_nodes=False).query(points, eps=SEARCH_SLACK, workers=-1)
    measured = _disc_distance(points, feet[nearest], normals[nearest], steps)
    flat = result.reshape(-1)
    flat[around] = np.where(inside.reshape(-1)[around], -measured, measured)
    flat[band.voxels] = band.sign * distance


def _disc_distance(points: Floats, feet: Floats, normals: Floats, steps: Floats) -> Floats:
    """Distance (n,) of points to discs about their foot points, wide enough to meet the neighbouring ones."""
    radius = 0.5 * float(np.linalg.norm(steps, axis=0).max())
    offset = points - feet
    height = np.einsum("...i,...i", offset, normals)
    beside = np.sqrt(np.maximum(np.einsum("...i,...i", offset, offset) - height**2, 0))
    return np.asarray(np.maximum(np.hypot(height, np.maximum(beside - radius, 0)), _LEAST_FRACTION))


def _far_field(inside: Mask, band: Band, feet: Floats, normals: Floats, steps: Floats) -> NDArray[np.float32]:
    """Distance to the foot point of the nearest band voxel, slice by slice.

    Nearest as if the grid were orthogonal: on a sheared one another foot point may be nearer, and this is a bound.
    """
    number = np.full(inside.shape, -1, dtype=np.int32)
    number.reshape(-1)[band.voxels] = np.arange(len(band.voxels))
    spacing = np.linalg.norm(steps, axis=0)[::-1]
    nearest = distance_transform_edt(number < 0, sampling=spacing, return_distances=False, return_indices=True)
    result = np.empty(inside.shape, dtype=np.float32)
    j, i = np.indices(inside.shape[1:])
    for k in range(len(result)):
        points = np.stack([i, j, np.full_like(i, k)], axis=-1) @ steps.T
        found = number[tuple(nearest[:, k])]
        measured = _disc_distance(points, feet[found], normals[found], steps)
        result[k] = np.where(inside[k], -measured, measured)
    return result


def _extend(
    close: NDArray[np.float32], window: tuple[slice, ...], shape: tuple[int, ...], steps: Floats
) -> NDArray[np.float32]:
    """Distance outside the box: that of its nearest voxel plus the way there."""
    if close.shape == shape:
        return close
    index = [np.arange(n) for n in shape]
    inner = [np.clip(n, w.start, w.stop - 1) for n, w in zip(index, window, strict=True)]
    k, j, i = ((n - c).astype(np.float32) for n, c in zip(index, inner, strict=True))
    way = steps.astype(np.float32)
    result = np.empty(shape, dtype=np.float32)
    plane = [way[a, 0] * i[None, :] + way[a, 1] * j[:, None] for a in range(3)]
    rows, columns = inner[1] - window[1].start, inner[2] - window[2].start
    for n in range(shape[0]):
        outside = np.sqrt(sum((plane[a] + way[a, 2] * k[n]) ** 2 for a in range(3)))
        result[n] = close[inner[0][n] - window[0].start][np.ix_(rows, columns)] + outside
    return result
