"""The control lattice of a body in a scan: from region to lattice.

Floors: the distance within the body's box is read once, 4 bytes a voxel; two comparisons a voxel for where rows enter
and leave. The fraction is of the time in which NumPy reads the same voxels once.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.bench.measure import Host, Row, WrongResult, best_of
from gpubspline.ct.region import Region
from gpubspline.ct.volume import Volume
from gpubspline.spline.lattice import control_lattice

SIZES = {"full": (500, 512, 512), "quick": (500, 512, 512), "tiny": (12, 14, 16)}  # voxels (k, j, i)
CONTROL = {"full": (20, 24, 46), "quick": (20, 24, 46), "tiny": (4, 5, 6)}
SPACING_MM = np.array([1.0, 0.7, 0.7])
TOLERANCE_MM = 0.1


def rows(host: Host) -> Iterator[Row]:
    """Time the lattice of an ellipsoid that takes nine tenths of the scan each way."""
    shape, control = SIZES[host.scale], CONTROL[host.scale]
    semi_axes_mm = 0.45 * np.array(shape) * SPACING_MM
    volume, region = _ellipsoid(shape, semi_axes_mm)
    middle_mm = (np.array(shape) - 1) / 2 * SPACING_MM
    ends = control_lattice(volume, region, control, smoothing=0).points[[0, -1], ..., 2::-1]  # z, y, x as (k, j, i)
    off = np.abs(np.linalg.norm((ends - middle_mm) / semi_axes_mm, axis=-1) - 1).max() * semi_axes_mm.min()
    if not off < TOLERANCE_MM:
        raise WrongResult(f"expected rows to end within {TOLERANCE_MM:g} mm of the ellipsoid, got {off:.2g} mm")
    seconds = best_of(lambda: control_lattice(volume, region, control))
    inside = region.distance_mm[
        tuple(slice(low, high) for low, high in zip(*(b[::-1] for b in region.box), strict=True))
    ]
    read = best_of(inside.max)
    size = f"{'x'.join(map(str, control))} points from {shape[0]} slices of {shape[1]}x{shape[2]}"
    yield Row("lattice", size, "host", seconds, int(np.prod(shape)), read / seconds)


def _ellipsoid(shape: tuple[int, ...], semi_axes_mm: NDArray[Any]) -> tuple[Volume, Region]:
    """Noise as HU, and a distance that is exact to first order at the boundary's nearest points."""
    along = [
        (((np.arange(n) - (n - 1) / 2) * step / half) ** 2).astype(np.float32)
        for n, step, half in zip(shape, SPACING_MM, semi_axes_mm, strict=True)
    ]
    distance = along[0][:, None, None] + along[1][:, None] + along[2]
    np.sqrt(distance, out=distance)
    distance -= 1
    distance *= np.float32(semi_axes_mm.min())
    hu = np.random.default_rng(10).integers(0, 2000, shape, dtype=np.int16)
    affine = np.diag([*SPACING_MM[::-1], 1.0])
    return Volume(hu, affine), Region(distance < 0, distance, affine)
