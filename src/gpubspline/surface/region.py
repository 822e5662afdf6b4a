"""The region within a surface: mask and signed distance on a grid of its own or of a CT."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from gpubspline.ct.region import Region
from gpubspline.device import Device
from gpubspline.errors import InputError
from gpubspline.surface.bins import Bins, bin_triangles
from gpubspline.surface.inside import winding_numbers
from gpubspline.surface.nearest import finder
from gpubspline.surface.surface import Floats, Surface, spelled

MARGIN = 6
"""Voxels around the surface on a grid of its own."""

BAND = 4
"""Voxels from the surface within which its distance is exact: the edge of a bin, of which 27 are searched."""

VOXELS = 2e6
"""Of a grid whose spacing is not given, about."""

MOST_VOXELS = 1 << 30

_LEAST_SHARE = 1e-3  # of a voxel: keeps distances off zero, so that their sign is the mask's
_CHUNK = 1 << 20


def region_from_surface(
    surface: Surface,
    device: Device,
    *,
    spacing_mm: float | None = None,
    grid: tuple[Floats, tuple[int, int, int]] | None = None,
) -> Region:
    """Take what a closed surface encloses; the boundary is the surface itself.

    The sign is exact: crossings are counted along rows in float64. The distance is that of the nearest triangle within
    ``BAND`` voxels and an upper bound beyond.

    Arguments
    ---------
    surface: closed and outward, as ``read_surface`` gives it.
    spacing_mm: edge of the cubic voxels of a grid along the patient's axes, ``MARGIN`` voxels wider than the surface;
        chosen for two million voxels where it is not given. A sheet thinner than it may hold no voxel centre.
    grid: affine (4, 4) and shape (n_k, n_j, n_i) of another grid, such as a CT's, instead.

    Raises
    ------
    InputError where no point of the grid is inside, or the spacing asks for too many.
    """
    affine, shape = _own_grid(surface, spacing_mm) if grid is None else (np.asarray(grid[0], float), grid[1])
    mask = np.asarray(winding_numbers(surface, affine, shape) > 0)
    if not mask.any():
        low, high = surface.box
        size = "x".join(f"{x:.3g}" for x in high - low)
        raise InputError(
            f"expected a surface with voxel centres inside, got one of {size} mm that holds none round "
            f"{spelled((low + high) / 2)}: it is thinner than a voxel, try a smaller size"
        )
    return Region(mask, _signed(surface, mask, affine, device), affine)


def _own_grid(surface: Surface, spacing_mm: float | None) -> tuple[Floats, tuple[int, int, int]]:
    low, high = surface.box
    spacing = float(np.cbrt(np.prod(high - low) / VOXELS)) if spacing_mm is None else spacing_mm
    if not (np.isfinite(spacing) and spacing > 0):
        raise InputError(f"expected a grid spacing of more than 0 mm, got {spacing}")
    counts = np.ceil((high - low) / spacing) + 2 * MARGIN + 1
    if counts.prod() > MOST_VOXELS:
        raise InputError(
            f"expected a grid of at most {MOST_VOXELS:,} voxels round the surface, got {int(counts.prod()):,} of "
            f"{spacing:.3g} mm: ask for larger elements"
        )
    affine = np.diag([spacing, spacing, spacing, 1.0])
    affine[:3, 3] = (low + high - (counts - 1) * spacing) / 2
    n_i, n_j, n_k = (int(n) for n in counts)
    return affine, (n_k, n_j, n_i)


def _signed(surface: Surface, mask: NDArray[np.bool_], affine: Floats, device: Device) -> NDArray[np.float32]:
    spacing = float(np.linalg.norm(affine[:3, :3], axis=0).max())
    bins = bin_triangles(surface, BAND * spacing)
    found = finder(surface, device, bins, _near_centres(bins, surface))
    result = np.empty(mask.shape, dtype=np.float32)
    slices = max(1, _CHUNK // (mask.shape[1] * mask.shape[2]))
    for first in range(0, len(mask), slices):
        part = slice(first, min(first + slices, len(mask)))
        distance, _ = found.nearest(_centres(affine, mask.shape, part), BAND * spacing)
        distance = np.maximum(distance, _LEAST_SHARE * spacing).reshape(mask[part].shape)
        result[part] = np.where(mask[part], -distance, distance)
    return result


def _centres(affine: Floats, shape: tuple[int, ...], part: slice) -> Floats:
    """(n, 3) voxel centres, mm, of some slices, i fastest."""
    k, j, i = np.arange(part.start, part.stop), np.arange(shape[1]), np.arange(shape[2])
    steps = affine[:3, :3].T
    row = i[:, None] * steps[0] + affine[:3, 3]
    columns = j[:, None, None] * steps[1] + k[:, None, None, None] * steps[2]
    return np.asarray((columns + row).reshape(-1, 3))


def _near_centres(bins: Bins, surface: Surface) -> NDArray[np.int32]:
    """(n_i n_j n_k) where a triangle near the centre of each bin is listed, for points that are near none."""
    where = np.repeat(np.arange(len(bins.start) - 1), np.diff(bins.start))
    centres = _bin_centres(bins.shape, bins.size, bins.origin)
    within = bins.size / 2
    close = np.clip(surface.corners[bins.listed].mean(axis=1), centres[where] - within, centres[where] + within)
    _, nearest = KDTree(close).query(centres)
    return np.asarray(nearest, dtype=np.int32)


def _bin_centres(shape: tuple[int, int, int], size: float, origin: Floats) -> Any:
    k, j, i = np.indices(shape[::-1])
    return (np.stack([i, j, k], axis=-1).reshape(-1, 3) + 0.5) * size + origin
