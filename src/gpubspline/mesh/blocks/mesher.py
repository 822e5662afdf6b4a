"""All-hexahedral meshes of any topology by threshold or mask: ``method="blocks"``."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gpubspline.ct.region import Region
from gpubspline.device import Device
from gpubspline.errors import MeshError
from gpubspline.mesh.blocks.grow import Grown, find_core, grow
from gpubspline.mesh.blocks.labelled import check_parts
from gpubspline.mesh.blocks.level_set import LevelSet, Part, level_set, part_of
from gpubspline.mesh.blocks.pillow import count_hexes
from gpubspline.mesh.blocks.placement import placement
from gpubspline.mesh.blocks.result import Attempt, Blocks
from gpubspline.mesh.improve import POOR, Effort

ATTEMPTS = 6
"""Most places of the lattice that are tried."""

GOOD = 0.7
"""Worst scaled Jacobian with which no other place is tried."""

MOST_TRIED = 20_000
"""Hexes, of all attempts, from which no other place is tried where the worst is not poor: time is linear in them."""

MOST_LOST = 1.2
"""How far, in elements, a feature may stand out of the mesh without another place being tried."""

MOST_OFF = 0.05
"""By what part the volume of one of several bodies may be off without another place being tried."""


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
) -> Blocks:
    """Mesh a region of any topology with hexes of about one size, none inverted.

    Cells of a lattice that lie inside are the core; a layer of hexes grows from its boundary to the region's surface;
    nodes then move until the worst hex is as good as it gets, those of the surface along the surface. Where the worst
    stays poor, the topology differs or a feature is lost, the lattice is shifted or turned and all is done again; where
    the worst is merely not good, as long as the mesh is small. Of several bodies one that is not poor is enough, and
    each must have its volume.

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
    tried: list[Attempt] = []
    failure = MeshError(f"expected at least one attempt, got {attempts}")
    for number in range(attempts):
        place = placement(number)
        axes = place.axes(rotation)
        level = level_set(region, size_mm, rotation=axes, offset=place.offset, device=device)
        try:
            within = {name: part_of(level, part, device=device) for name, part in parts.items()}
            core = find_core(level, within)
            if best is not None and best.core.is_whole and not core.is_whole:
                tried.append(Attempt(place, count_hexes(core.cells > 0), None, core.euler["mesh"]))
                continue
            made = grow(level, core, device, effort, within, allow_inverted=allow_inverted)
        except MeshError as error:
            failure = error
            continue
        tried.append(Attempt(place, made.placed.hexes.n_elements, made.placed.nodes.least, core.euler["mesh"]))
        if best is None or _merit(made) > _merit(best):
            best = made
        if _merit(best) >= (True, True, True, POOR if parts else _enough(tried)):
            break
    if best is None:
        raise failure
    finished = best.finished()
    return replace(finished, report=replace(finished.report, attempts=tuple(tried)))


def _merit(made: Grown) -> tuple[bool, bool, bool, float]:
    """Right topology first, then that nothing is lost and bodies have their volumes, then the worst hex."""
    kept = all(feature.out_mm <= MOST_LOST * made.level.size_mm for feature in made.lost)
    full = all(abs(body.off) <= MOST_OFF for body in made.bodies)
    return made.core.is_whole, kept, full, made.placed.nodes.least


def _enough(tried: list[Attempt]) -> float:
    """Worst scaled Jacobian with which no other place is tried."""
    return GOOD if sum(attempt.elements for attempt in tried) < MOST_TRIED else POOR


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
