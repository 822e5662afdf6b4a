"""All-hexahedral meshes of any topology by threshold or mask: ``method="blocks"``."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from gpubspline.ct.region import Region
from gpubspline.device import Device
from gpubspline.errors import InputError, MeshError
from gpubspline.mesh.blocks.core import Cells, cell_means, core_cells, euler_characteristic, largest_body
from gpubspline.mesh.blocks.labelled import assign, check_parts, costs, element_sets, hold, node_sets
from gpubspline.mesh.blocks.level_set import SAMPLES, Field, LevelSet, level_set, part_of
from gpubspline.mesh.blocks.pillow import Owners, pillow
from gpubspline.mesh.blocks.place import Holding, place_nodes
from gpubspline.mesh.blocks.reach import LostFeature, lost_features, within_reach
from gpubspline.mesh.blocks.repair import repair, repair_owners
from gpubspline.mesh.improve import POOR, Effort
from gpubspline.mesh.mesh import Mesh

ATTEMPTS = 4
"""Most places of the lattice that are tried."""

GOLDEN = 0.8191725133961645
"""Its powers, times the number of the attempt, spread the lattice's offsets evenly. Source: Roberts 2018, R3."""

ON_SURFACE = 0.01
"""A node farther from the surface, in elements, counts as off it."""


@dataclass(frozen=True)
class Attempt:
    """One place of the lattice: its offset, in elements, and what came of it."""

    offset: tuple[float, float, float]
    elements: int
    min_scaled_jacobian: float
    euler: int

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers, for JSON."""
        return {
            "offset": list(self.offset),
            "elements": self.elements,
            "min_scaled_jacobian": self.min_scaled_jacobian,
            "euler": self.euler,
        }


@dataclass(frozen=True)
class BlocksReport:
    """What is known of a mesh of blocks beside its quality.

    Attributes
    ----------
    size_mm: of an element.
    min_scaled_jacobian: of the worst hex.
    euler: Euler characteristic of the mesh and of the region's level set, ``{"mesh": 1, "region": 1}``.
    repaired_cells: cells of the core that were flipped to make its boundary a manifold.
    off_surface_nodes: surface nodes that had to leave the surface: ``{"count": 0, "max_mm": 0.0}``.
    lost_features: parts of the region too thin for the lattice, farthest out first.
    attempts: places of the lattice that were tried; the mesh is the best of them.
    """

    size_mm: float
    min_scaled_jacobian: float
    euler: dict[str, int]
    repaired_cells: int
    off_surface_nodes: dict[str, float]
    lost_features: tuple[LostFeature, ...]
    attempts: tuple[Attempt, ...]

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers and lists, for JSON."""
        return {
            "size_mm": self.size_mm,
            "min_scaled_jacobian": self.min_scaled_jacobian,
            "euler": dict(self.euler),
            "repaired_cells": self.repaired_cells,
            "off_surface_nodes": dict(self.off_surface_nodes),
            "lost_features": [feature.to_dict() for feature in self.lost_features],
            "attempts": [attempt.to_dict() for attempt in self.attempts],
        }


@dataclass(frozen=True, eq=False)
class Blocks:
    """A mesh of blocks, the level set that it conforms to, the cells of its core, and what is known of it."""

    mesh: Mesh
    level: LevelSet
    core: Cells
    report: BlocksReport

    def surface(self) -> LevelSet:
        """The level set as far as the core reaches it: sheets that it does not reach are left out."""
        return replace(self.level, phi=within_reach(self.level.phi, self.core))


def blocks_mesh(
    region: Region,
    size_mm: float,
    *,
    device: Device,
    parts: Mapping[str, Region] | None = None,
    attempts: int = ATTEMPTS,
    rotation: NDArray[np.float64] | None = None,
    effort: Effort | None = None,
) -> Blocks:
    """Mesh a region of any topology with hexes of about one size, none inverted.

    Cells of a lattice that lie inside are the core; a layer of hexes grows from its boundary to the region's surface;
    nodes then move until the worst hex is as good as it gets, those of the surface along the surface. Where the worst
    stays poor or the topology differs, the lattice is shifted and all is done again.

    Arguments
    ---------
    region: mask and signed distance, of a CT or of a closed surface; where it meets the border of its grid, the
        outermost voxel centres bound it.
    size_mm: of an element.
    parts: bodies that fill the region without overlap, by name. Their hexes share the nodes of the interface and are
        element sets; the nodes between A and B are the set ``A_to_B``.
    attempts: most places of the lattice that are tried.
    rotation: (3, 3), columns are the lattice's axes; None takes the patient's.
    effort: what is done to improve the hexes.

    Returns
    -------
    hex8 mesh with the node set ``surface`` and the element set ``body``; its level set; a report.

    Raises
    ------
    InputError where nothing is as thick as an element; MeshError where no mesh without inverted hexes was found.
    """
    parts = parts or {}
    check_parts(region, parts)
    best: Blocks | None = None
    tried: list[Attempt] = []
    failure = MeshError(f"expected at least one attempt, got {attempts}")
    for number in range(attempts):
        offset = _offset(number)
        level = level_set(region, size_mm, rotation=rotation, offset=offset, device=device)
        try:
            within = {name: part_of(level, part, device=device) for name, part in parts.items()}
            made = mesh_level_set(level, device, effort, within)
        except MeshError as error:
            failure = error
            continue
        report = made.report
        tried.append(Attempt(offset, made.mesh.n_elements, report.min_scaled_jacobian, report.euler["mesh"]))
        if best is None or _merit(made) > _merit(best):
            best = made
        if _merit(best) >= (True, POOR):
            break
    if best is None:
        raise failure
    return replace(best, report=replace(best.report, attempts=tuple(tried)))


def _offset(number: int) -> tuple[float, float, float]:
    first, second, third = (round((number * GOLDEN**power) % 1, 4) for power in (1, 2, 3))
    return first, second, third


def _merit(made: Blocks) -> tuple[bool, float]:
    """Right topology first, then the worst hex."""
    euler = made.report.euler
    return euler["mesh"] == euler["region"], made.report.min_scaled_jacobian


def mesh_level_set(
    level: LevelSet,
    device: Device,
    effort: Effort | None = None,
    parts: Mapping[str, Field] | None = None,
    *,
    bulge: bool = True,
    clamp: bool = True,
) -> Blocks:
    """Mesh the inside of a level set on its own lattice.

    Arguments
    ---------
    parts: distance, in elements, of each of the bodies that fill the inside, sampled as the level set is.
    bulge, clamp: whether surface nodes lie outside by the sag of their faces, and stay near the core: the bench
        switches them off.

    Raises
    ------
    InputError where no cell is inside; MeshError where a hex stays inverted.
    """
    names, distances = tuple(parts or ()), list((parts or {}).values())
    cells, flips = _core(level, distances)
    hexes = pillow(cells)
    held = hold(hexes)
    holding = Holding(hexes, held, cells > 0, distances, device, clamp)
    placed = place_nodes(holding, level, effort, bulge=bulge)
    points, best = placed.points, placed.nodes
    if not best.least > 0:
        raise MeshError(_inverted(placed.hexes.scaled_jacobian(best.x), points[hexes.cells], level))
    outer = node_sets(hexes, names, held.pairs)
    report = BlocksReport(
        size_mm=level.size_mm,
        min_scaled_jacobian=best.least,
        euler={"mesh": euler_characteristic(cells > 0), "region": euler_characteristic(level.inside)},
        repaired_cells=flips,
        off_surface_nodes=off_surface(points[outer["surface"]], placed.reached, level.size_mm),
        lost_features=lost_features(level, placed.reached),
        attempts=(),
    )
    mesh = Mesh(
        level.in_mm(points).astype(points.dtype),
        "hex8",
        connectivity=hexes.cells,
        node_sets=outer,
        element_sets={"body": np.arange(len(hexes.cells), dtype=np.int32), **element_sets(hexes, names)},
    )
    return Blocks(mesh, level, cells > 0, report)


def _core(level: LevelSet, parts: list[Field]) -> tuple[Cells | Owners, int]:
    """Repaired core, the body of each cell where there are several, and how many cells the repair changed."""
    means = cell_means(level.phi)
    cells: Cells | Owners
    if parts:
        within = np.stack([cell_means(part) for part in parts])
        cells, flips, unsound = repair_owners(assign(core_cells(means), within), costs(means, within))
    else:
        cells, flips, unsound = repair(core_cells(means), means)
    if len(unsound):
        raise MeshError(
            f"no manifold core of {level.size_mm:g} mm cells was found: {len(unsound)} places are left, the first at "
            f"{_place(level, unsound[0][::-1])}; close the region's pores first or ask for a smaller size"
        )
    if not cells.any():
        raise InputError(f"expected a region thicker than an element of {level.size_mm:g} mm: ask for a smaller size")
    cells[~largest_body(cells > 0)] = 0
    return cells, flips


def off_surface(points: NDArray[Any], reached: NDArray[Any], size_mm: float) -> dict[str, float]:
    """How many of the points (n, 3), lattice coordinates, are off the zero level, and how far."""
    off = np.abs(map_coordinates(reached, points[:, ::-1].T * SAMPLES, order=1, mode="nearest"))
    far = off > ON_SURFACE
    return {"count": int(np.count_nonzero(far)), "max_mm": float(off[far].max(initial=0.0)) * size_mm}


def _inverted(values: NDArray[Any], corners: NDArray[Any], level: LevelSet) -> str:
    return (
        f"{np.count_nonzero(values <= 0)} of {values.size:,} hexes stayed inverted, the worst at "
        f"{_place(level, corners[np.argmin(values)].mean(axis=0))}: features there are thinner than an element of "
        f"{level.size_mm:g} mm; ask for a smaller size or close the region's pores first"
    )


def _place(level: LevelSet, at: NDArray[Any]) -> str:
    x, y, z = level.in_mm(np.asarray(at, dtype=np.float64)[None, :])[0]
    return f"({x:.4g}, {y:.4g}, {z:.4g}) mm"
