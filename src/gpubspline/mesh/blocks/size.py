"""The element size that gives about as many hexes as are asked for."""

from gpubspline.ct.region import Region
from gpubspline.device import Device
from gpubspline.errors import InputError
from gpubspline.mesh.blocks.core import cell_means, core_cells
from gpubspline.mesh.blocks.level_set import level_set
from gpubspline.mesh.blocks.pillow import count_hexes
from gpubspline.mesh.blocks.repair import repair

ROUNDS = 6
CLOSE_ENOUGH = 0.03


def size_for(region: Region, elements: int, device: Device) -> float:
    """Element size, mm, at which a region is meshed with about ``elements`` hexes: within 3 %, or as near as sizes go.

    Hexes are counted, not made. Their number falls between the inverse square and the inverse cube of the size.

    Raises
    ------
    InputError where so few elements are asked for that none would be inside.
    """
    if elements < 8:
        raise InputError(f"expected at least 8 elements, got {elements}")
    size = float((region.volume_mm3 / elements) ** (1 / 3))
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
    try:
        level = level_set(region, size, device=device)
    except InputError:
        return 0
    means = cell_means(level.phi)
    return count_hexes(repair(core_cells(means), means)[0])
