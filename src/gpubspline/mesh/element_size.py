"""The element size of hexes: what the thinnest feature of a region asks for, or what gives a number of elements."""

import numpy as np

from gpubspline.ct.region import Region
from gpubspline.device import Device
from gpubspline.errors import InputError, MeshError
from gpubspline.mesh.blocks.lay import lay
from gpubspline.mesh.thickness import measure_thickness

ACROSS = 2.0
"""Elements across the thinnest feature: fewer and it may be lost."""

FEWEST, MOST = 8_000, 100_000
"""Elements that the thinnest feature may ask for, about; fewer or more have to be asked for by size or number."""

ROUNDS = 6
CLOSE_ENOUGH = 0.03


def default_size(region: Region) -> float:
    """Element size, mm: half the thickness of the thinnest feature, within ``FEWEST`` and ``MOST`` elements.

    Not smaller than half a voxel, below which the scan tells nothing.
    """
    finest = max(size_of(region, MOST), 0.5 * float(region.spacing_mm.min()))
    return float(np.clip(measure_thickness(region).least() / ACROSS, finest, max(finest, size_of(region, FEWEST))))


def about_elements(region: Region, size_mm: float) -> float:
    """How many blocks of a size, mm, fill the region, about."""
    return region.volume_mm3 / size_mm**3 + _stairs_mm2(region) / size_mm**2


def size_of(region: Region, elements: int) -> float:
    """Size, mm, at which about so many blocks fill the region: cells, and one more on every open face of theirs."""
    stairs = _stairs_mm2(region)
    roots = np.roots([elements, 0.0, -stairs, -region.volume_mm3])  # elements = volume / h^3 + stairs / h^2
    return float(roots[np.isreal(roots)].real.max())


def _stairs_mm2(region: Region) -> float:
    """Area of the open faces of the region's voxels."""
    spacing = region.spacing_mm
    stairs = 0.0
    for axis in range(3):
        low = np.moveaxis(region.mask, 2 - axis, 0)
        face = float(np.prod(spacing) / spacing[axis])
        stairs += face * np.count_nonzero(low[:-1] != low[1:])
    return stairs


def size_for(region: Region, elements: int, device: Device) -> float:
    """Element size, mm, at which a region is meshed with about ``elements`` hexes: within 3 %, or as near as sizes go.

    Hexes are counted, not made. Their number falls between the inverse square and the inverse cube of the size.

    Raises
    ------
    InputError where so few elements are asked for that none would be inside.
    """
    if elements < 8:
        raise InputError(f"expected at least 8 elements, got {elements}")
    size = size_of(region, elements)
    best, off = size, float("inf")
    for _ in range(ROUNDS):
        count = _count(region, size, device)
        if count and abs(count / elements - 1) < off:
            best, off = size, abs(count / elements - 1)
        if off < CLOSE_ENOUGH:
            break
        size *= float(max(count / elements, 0.2) ** (1 / 2.7))
    return best


def _count(region: Region, size: float, device: Device) -> int:
    """Hexes on the first place of the lattice, those of thin features that are taken in among them."""
    try:
        return lay(region, size, {}, None, device, 0).elements
    except (InputError, MeshError):
        return 0
