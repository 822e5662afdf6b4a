"""All-hexahedral meshes of any topology by threshold or mask: ``method="blocks"``."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from gpubspline.ct.region import Region
from gpubspline.device import Device
from gpubspline.errors import InputError, MeshError
from gpubspline.mesh.blocks.grow import Grown, find_core, grow
from gpubspline.mesh.blocks.labelled import check_parts
from gpubspline.mesh.blocks.lay import MOST_LOST, Failure, Laid, in_turn, lay
from gpubspline.mesh.blocks.level_set import LevelSet, Part
from gpubspline.mesh.blocks.result import Attempt, Blocks
from gpubspline.mesh.blocks.tips import TINY
from gpubspline.mesh.improve import POOR, Effort

ATTEMPTS = 6
"""Most places of the lattice that are tried."""

GOOD = 0.65
"""Worst scaled Jacobian with which no other place is tried: others gain 0.02 then, and take as long as the first."""

MOST_TRIED = 20_000
"""Hexes, of all attempts, from which no other place is tried where the worst is not poor: time is linear in them."""

MOST_MENDED = 100_000
"""Hexes, of all attempts, from which no other place is tried where the worst is poor, but none is inverted."""

FINER, MOST_LAID = (0.8, 0.65, 0.5), 250_000
"""Parts of an element's size that are tried for one which keeps a region's topology, and how many cells there may be.
"""

MOST_OFF = 0.02
"""By what part a body's volume may be off: of two places that lose as much, the one that is less off is taken, and of
several bodies others are tried."""

SWOLLEN = 0.05
"""By what part it may be off before each hundredth more is as bad as an element lost or a place of another topology."""


def blocks_mesh(
    region: Region,
    size_mm: float,
    *,
    device: Device,
    parts: Mapping[str, Region] | None = None,
    attempts: int = ATTEMPTS,
    rotation: NDArray[np.float64] | None = None,
    effort: Effort | None = None,
    allow_inverted: bool = False,
    tell: Callable[[str], None] | None = None,
) -> Blocks:
    """Mesh a region of any topology with hexes of about one size, none inverted.

    Cells of a lattice that lie inside are the core; a layer of hexes grows from its boundary to the region's surface;
    nodes then move until the worst hex is as good as it gets, those of the surface along the surface. Where the
    topology would differ or a feature be lost, the lattice is shifted and turned first, and the place taken that loses
    least. Where the worst hex stays poor, all is done again in other places, until the meshes are large; where it is
    merely not good, as long as they are small. Of several bodies one that is not poor is enough, and each must have its
    volume.

    Arguments
    ---------
    region: mask and signed distance, of a CT or of a closed surface; where it meets the border of its grid, the
        outermost voxel centres bound it.
    size_mm: of an element.
    parts: bodies that fill the region without overlap, by name. Their hexes share the nodes of the interface and are
        element sets; the nodes between A and B are the set ``A_to_B``.
    attempts: most places of the lattice that are tried.
    rotation: (3, 3), columns are the lattice's axes, from which attempts turn it; None takes the patient's.
    effort: what is done to improve the hexes.
    allow_inverted: take the best mesh even where it has inverted hexes.
    tell: is told which attempt is on and how many hexes it has, before they are made.

    Returns
    -------
    hex8 mesh with the node set ``surface`` and the element set ``body``; its level set; a report.

    Raises
    ------
    InputError where nothing is as thick as an element; MeshError where no mesh was found without inverted hexes, unless
    they are allowed.
    """
    parts = parts or {}
    check_parts(region, parts)
    best: tuple[Laid, Grown] | None = None
    tried: list[Attempt] = []
    failure: Failure = MeshError(f"expected at least one attempt, got {attempts}")
    made_hexes = 0
    for laid in in_turn(partial(lay, region, size_mm, parts, rotation, device), attempts):
        if not isinstance(laid, Laid):
            failure = laid
            continue
        if best is not None and laid.wrong > _wrong(*best) and not _is_poor(best[1]):
            tried.append(Attempt(laid.place, laid.elements, None, laid.core.euler["mesh"]))
            continue
        if tell is not None:
            tell(f"{laid.elements:,} hexes, place {len(tried) + 1} of at most {attempts}")
        try:
            made = grow(laid.level, laid.core, device, effort, laid.within, allow_inverted=allow_inverted)
        except MeshError as error:
            failure = error
            made_hexes += laid.elements
            continue
        elements, least = made.placed.hexes.n_elements, made.placed.nodes.least
        made_hexes += elements
        tried.append(Attempt(laid.place, elements, least, laid.core.euler["mesh"]))
        if best is None or _merit(laid, made) > _merit(*best):
            best = laid, made
        if _is_enough(best[1], made_hexes):
            break
    if best is None:
        raise failure
    finished = best[1].finished()
    return replace(finished, report=replace(finished.report, attempts=tuple(tried)))


def size_that_keeps_topology(
    region: Region, size_mm: float, *, device: Device, rotation: NDArray[np.float64] | None = None
) -> float | None:
    """Element size, mm, below one that does not keep it, at which the core has the region's topology; None if none has.

    Lattices are laid, hexes are not made.
    """
    for share in FINER:
        if region.volume_mm3 / (share * size_mm) ** 3 > MOST_LAID:
            break
        try:
            laid = lay(region, share * size_mm, {}, rotation, device, 0)
        except (InputError, MeshError):
            continue
        if not laid.core.differences:
            return share * size_mm
    return None


def _merit(laid: Laid, made: Grown) -> tuple[bool, float, float, float]:
    """No poor hex first, then that little is lost and bodies have their volumes, then the worst hex."""
    lost = _wrong(laid, made) + _lost(made)
    return not _is_poor(made), -lost, -(made.off // MOST_OFF), made.placed.nodes.least


def _wrong(laid: Laid, made: Grown) -> float:
    """What the core has otherwise than the region, and how much volume is off."""
    return laid.wrong + 100 * max(made.off - SWOLLEN, 0.0)


def _is_poor(made: Grown) -> bool:
    return made.placed.nodes.least < POOR or made.least_determinant < TINY


def _lost(made: Grown) -> float:
    """By how many elements the region stands out of the mesh, where that is more than allowed."""
    return made.farthest if made.farthest > MOST_LOST else 0.0


def _is_enough(best: Grown, made_hexes: int) -> bool:
    """Whether no other place is tried."""
    if _is_poor(best):
        return made_hexes >= MOST_MENDED and best.placed.nodes.least > 0
    good = best.placed.nodes.least >= (POOR if best.volumes else GOOD)
    right = not (best.volumes and best.off > MOST_OFF)
    return made_hexes >= MOST_TRIED or (good and right and not _lost(best))


def mesh_level_set(
    level: LevelSet,
    device: Device,
    effort: Effort | None = None,
    parts: Mapping[str, Part] | None = None,
    *,
    bulge: bool = True,
    clamp: bool = True,
) -> Blocks:
    """Mesh the inside of a level set on its own lattice.

    Arguments
    ---------
    parts: distance of each of the bodies that fill the inside, sampled as the level set is.
    bulge, clamp: whether surface nodes lie outside by the sag of their faces, and stay near the core: the bench
        switches them off.

    Raises
    ------
    InputError where no cell is inside; MeshError where a hex stays inverted.
    """
    return grow(level, find_core(level, parts), device, effort, parts, bulge=bulge, clamp=clamp).finished()
