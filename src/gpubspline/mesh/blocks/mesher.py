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
from gpubspline.mesh.blocks.lay import Failure, Prospect, in_turn, lay
from gpubspline.mesh.blocks.level_set import LevelSet, Part
from gpubspline.mesh.blocks.merit import Merit, hope, is_worth_trying, merit
from gpubspline.mesh.blocks.result import Attempt, Blocks
from gpubspline.mesh.floors import Effort

ATTEMPTS = 6
"""Most places of the lattice that are tried."""

FINER, MOST_LAID = (0.8, 0.65, 0.5), 250_000
"""Parts of an element's size that are tried for one which keeps a region's topology, and how many cells there may be.
"""


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
    best: Grown | None = None
    reached: Merit | None = None
    tried: list[Attempt] = []
    failure: Failure = MeshError(f"expected at least one attempt, got {attempts}")
    made_hexes = 0
    for found in in_turn(partial(lay, region, size_mm, parts, rotation, device), attempts):
        if not isinstance(found, Prospect):
            failure = found
            continue
        if not is_worth_trying(hope(found.wrong, several=bool(parts)), reached, made_hexes):
            tried.append(found.attempt)
            continue
        laid = found.lay()
        if tell is not None:
            tell(f"{laid.elements:,} hexes, place {len(tried) + 1} of at most {attempts}")
        try:
            made = grow(laid.level, laid.core, device, effort, laid.within, allow_inverted=allow_inverted)
        except MeshError as error:
            failure = error
            continue
        made_hexes += made.n_hexes
        tried.append(replace(found.attempt, elements=made.n_hexes, min_scaled_jacobian=made.placed.nodes.least))
        latest = merit(laid, made)
        if reached is None or latest > reached:
            best, reached = made, latest
        if not is_worth_trying(hope(several=bool(parts)), reached, made_hexes):
            break
    if best is None:
        raise failure
    finished = best.finished()
    return replace(finished, report=replace(finished.report, attempts=tuple(tried)), parts=parts)


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
