"""Which voxels of a volume are kept: a box in patient millimetres, a range of slices, or one slice."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpubspline.ct.volume import Volume
from gpubspline.errors import InputError


@dataclass(frozen=True)
class Window:
    """Voxels from ``first`` up to and without ``last``, as indices (i, j, k)."""

    first: tuple[int, int, int]
    last: tuple[int, int, int]

    @property
    def slices(self) -> tuple[slice, slice, slice]:
        """The window in an array of shape (k, j, i)."""
        ranges = zip(self.first[::-1], self.last[::-1], strict=True)
        k, j, i = (slice(low, high) for low, high in ranges)
        return k, j, i


def crop(volume: Volume, window: Window) -> Volume:
    """The part of a volume in a window; every voxel keeps its place."""
    return volume.crop(window.first, window.last)


def find_window(
    volume: Volume,
    box_mm: tuple[float, ...] | None = None,
    slices: tuple[int | None, int | None] | None = None,
    slice_index: int | None = None,
    axis: int = 2,
) -> Window:
    """The voxels that all that is given leaves.

    Arguments
    ---------
    box_mm: x0, x1, y0, y1, z0, z1 in LPS millimetres; voxels whose centres may lie in it are kept.
    slices: first slice and the one after the last along k, counted as Python does (negative from the end).
    slice_index: one slice along ``axis`` (0, 1, 2 for i, j, k).

    Raises
    ------
    InputError where nothing is left, or slices are asked for that there are not.
    """
    first, last = np.zeros(3, dtype=int), np.array(volume.shape)
    if box_mm is not None:
        low, high = _box(volume, box_mm)
        first, last = np.maximum(first, low), np.minimum(last, high)
    if slices is not None:
        start, stop = _range(slices, volume.shape[2])
        first[2], last[2] = max(first[2], start), min(last[2], stop)
    if slice_index is not None:
        count = volume.shape[axis]
        if not -count <= slice_index < count:
            raise InputError(f"expected a slice of 0 to {count - 1} along {'ijk'[axis]}, got {slice_index}")
        one = slice_index % count
        first[axis], last[axis] = max(first[axis], one), min(last[axis], one + 1)
    if np.any(last <= first):
        raise InputError(f"expected a crop that leaves some of the {volume.shape} voxels, got none: {_extent(volume)}")
    return Window(_three(first), _three(last))


def _range(slices: tuple[int | None, int | None], count: int) -> tuple[int, int]:
    """First slice and the one after the last, both within the volume."""
    given = [number for number in slices if number is not None]
    if any(not -count <= number <= count for number in given):
        ends = ":".join("" if number is None else str(number) for number in slices)
        raise InputError(f"expected --slices within 0:{count}, which is all there are, got {ends}")
    start, stop, _ = slice(*slices).indices(count)
    return start, stop


def _box(volume: Volume, box_mm: tuple[float, ...]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Index range of the smallest block of voxels that covers the box."""
    if len(box_mm) != 6 or any(a >= b for a, b in zip(box_mm[::2], box_mm[1::2], strict=True)):
        raise InputError(f"expected a box x0,x1,y0,y1,z0,z1 in mm with x0 < x1, y0 < y1, z0 < z1, got {box_mm}")
    corners = np.stack(np.meshgrid(box_mm[:2], box_mm[2:4], box_mm[4:], indexing="ij"), axis=-1).reshape(-1, 3)
    indices = volume.to_indices(corners)
    return np.ceil(indices.min(axis=0) - 1e-9).astype(int), np.floor(indices.max(axis=0) + 1e-9).astype(int) + 1


def _extent(volume: Volume) -> str:
    """Where the volume lies, for a person whose box missed it."""
    n = np.array(volume.shape) - 1
    corners = volume.to_points(np.array(np.meshgrid(*[(0, 1)] * 3)).reshape(3, -1).T * n)
    low, high = corners.min(axis=0), corners.max(axis=0)
    return (
        "the volume spans "
        + ", ".join(f"{c} {a:.1f} to {b:.1f}" for c, a, b in zip("xyz", low, high, strict=True))
        + " mm"
    )


def _three(values: NDArray[np.int64]) -> tuple[int, int, int]:
    i, j, k = (int(value) for value in values)
    return i, j, k
