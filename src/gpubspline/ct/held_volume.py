"""The distance of a smoothed label, moved until it holds the volume of the voxels around each place.

Where a part is as thin as the Gaussian that smoothed it, hardly anything of it stays above one half: of a plate of one
voxel a third of its thickness was left, of a rod a twentieth. The voxels say how much there is: with s(c) the part of a
cell between voxel centres that lies within the zero level of the distance d - c, and m the mean of its corners in the
mask, the shift c, as smooth as a Gaussian G, solves

    G * s(c) = G * m

No shift takes a voxel centre to the other side, so that the boundary has the topology of the mask.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from gpubspline.ct.enclosed import cell_shares
from gpubspline.ct.signed_distance import MARGIN, box_around

Field = NDArray[np.float32]

ROUNDS = 5
"""Of Newton: each step is the volume that is missing over the area of the boundary."""

MOST_SHIFT = 0.5
"""In edges of a voxel: more would draw the boundary to the centres around a part of one voxel, whose corners it cannot
fill."""

LEAST_AREA = 0.02
"""Of boundary around a place, in faces a voxel, below which the shift fades."""


def hold_volume(
    distance_mm: Field,
    inside: NDArray[np.bool_],
    share: NDArray[Any],
    affine: NDArray[np.float64],
    width: NDArray[np.float64],
    least_mm: float,
) -> Field:
    """Move the zero level of a distance by what it lacks of the voxels' volume, around each place.

    Arguments
    ---------
    distance_mm: (n_k, n_j, n_i), negative exactly where ``inside``.
    share: same shape, part of each voxel that is inside, 0 to 1 or bool.
    affine: (4, 4), index (i, j, k) to mm.
    width: (3,) standard deviation of the Gaussian that says what is around, voxels along i, j, k.
    least_mm: nearest that the boundary comes to a voxel centre.

    Returns: (n_k, n_j, n_i) float32, mm; negative exactly where ``inside``.
    """
    thick = tuple(2 if size == 1 else 1 for size in inside.shape)  # one slice is one voxel thick
    window = box_around(inside, MARGIN)
    near, kept, parts = (_repeated(array[window], thick) for array in (distance_mm, inside, share))
    steps, sigma = affine[:3, :3].astype(np.float64), width[::-1]
    wanted = _means(parts.astype(np.float32))
    area = np.maximum(_area(kept, steps, sigma), np.float32(LEAST_AREA * _faces(steps).max()))
    per_area = np.float32(abs(np.linalg.det(steps))) / area
    most = np.float32(MOST_SHIFT * np.linalg.norm(steps, axis=0).min())
    shift = np.zeros_like(near)
    for _ in range(ROUNDS):
        lack = gaussian_filter(wanted - cell_shares(_kept(near - shift, kept, least_mm)), sigma, mode="nearest")
        shift = np.clip(shift + _at_voxels(lack * per_area), -most, most)
    moved = _kept(near - shift, kept, least_mm)
    held: Field = distance_mm.copy()
    held[window] = moved[tuple(slice(None, None, step) for step in thick)]
    return held


def _repeated(array: NDArray[Any], thick: tuple[int, ...]) -> NDArray[Any]:
    for axis, times in enumerate(thick):
        array = np.repeat(array, times, axis=axis)
    return array


def _kept(distance_mm: Field, inside: NDArray[np.bool_], least_mm: float) -> Field:
    """Keep voxel centres on their side."""
    least = np.float32(least_mm)
    return np.asarray(np.where(inside, np.minimum(distance_mm, -least), np.maximum(distance_mm, least)))


def _means(samples: Field) -> Field:
    """Of the corners of each cell."""
    for axis in range(samples.ndim):
        line = np.moveaxis(samples, axis, 0)
        samples = np.moveaxis(np.float32(0.5) * (line[:-1] + line[1:]), 0, axis)
    return samples


def _at_voxels(cells: Field) -> Field:
    """Mean of the cells around each voxel centre."""
    return _means(np.pad(cells, 1, mode="edge"))


def _faces(steps: NDArray[np.float64]) -> NDArray[np.float64]:
    """Area (3,) of the voxel faces across i, j, k, mm2."""
    return np.array([np.linalg.norm(np.cross(*np.delete(steps, axis, axis=1).T)) for axis in range(3)])


def _area(inside: NDArray[np.bool_], steps: NDArray[np.float64], sigma: NDArray[np.float64]) -> Field:
    """Area of the boundary in each cell, mm2, as it is around: of a plane that of its projections along the axes."""
    squares = np.zeros([size - 1 for size in inside.shape], dtype=np.float32)
    for axis, face in enumerate(_faces(steps)[::-1]):
        line = np.moveaxis(inside, axis, 0)
        crossed = np.moveaxis((line[:-1] != line[1:]).astype(np.float32), 0, axis)
        for other in range(3):
            if other != axis:
                line = np.moveaxis(crossed, other, 0)
                crossed = np.moveaxis(np.float32(0.5) * (line[:-1] + line[1:]), 0, other)
        squares += (np.float32(face) * gaussian_filter(crossed, sigma, mode="nearest")) ** 2
    return np.asarray(np.sqrt(squares))
