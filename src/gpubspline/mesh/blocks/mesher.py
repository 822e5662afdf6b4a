"""All-hexahedral meshes of any topology by threshold or mask: ``method="blocks"``."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.ct.region import Region
from gpubspline.device import Device
from gpubspline.errors import InputError, MeshError
from gpubspline.mesh.blocks.core import cell_means, core_cells, euler_characteristic
from gpubspline.mesh.blocks.level_set import SAMPLES, LevelSet, level_set
from gpubspline.mesh.blocks.pillow import Pillowed, pillow
from gpubspline.mesh.blocks.repair import repair
from gpubspline.mesh.blocks.start import start
from gpubspline.mesh.improve import improve
from gpubspline.mesh.mesh import Mesh
from gpubspline.mesh.movable import FREE, Movable, movable, put_level


@dataclass(frozen=True)
class BlocksReport:
    """What is known of a mesh of blocks beside its quality.

    Attributes
    ----------
    size_mm: of an element.
    min_scaled_jacobian: of the worst hex.
    euler: Euler characteristic of the mesh and of the region, ``{"mesh": 1, "region": 1}``.
    repaired_cells: cells of the core that were flipped to make its boundary a manifold.
    off_surface_nodes: surface nodes that had to leave the level set: ``{"count": 0, "max_mm": 0.0}``.
    """

    size_mm: float
    min_scaled_jacobian: float
    euler: dict[str, int]
    repaired_cells: int
    off_surface_nodes: dict[str, float]

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers, for JSON."""
        return {
            "size_mm": self.size_mm,
            "min_scaled_jacobian": self.min_scaled_jacobian,
            "euler": dict(self.euler),
            "repaired_cells": self.repaired_cells,
            "off_surface_nodes": dict(self.off_surface_nodes),
        }


@dataclass(frozen=True, eq=False)
class Blocks:
    """A mesh of blocks, the level set that it conforms to, and what is known of it."""

    mesh: Mesh
    level: LevelSet
    report: BlocksReport


def blocks_mesh(region: Region, size_mm: float, *, device: Device) -> Blocks:
    """Mesh a region of any topology with hexes of about one size, none inverted.

    Cells of a lattice that lie inside are the core; a layer of hexes grows from its boundary to the region's surface;
    nodes then move until the worst hex is as good as it gets, those of the surface along the surface.

    Arguments
    ---------
    region: mask and signed distance, of a CT or of a closed surface; where it meets the border of its grid, the
        outermost voxel centres bound it.
    size_mm: of an element.

    Returns
    -------
    hex8 mesh with the node set ``surface`` and the element set ``body``; its level set; a report.

    Raises
    ------
    InputError where nothing is as thick as an element; MeshError where no mesh without inverted hexes was found.
    """
    level = level_set(region, size_mm, device=device)
    means = cell_means(level)
    cells, flips, unsound = repair(core_cells(means), means)
    if not cells.any():
        raise InputError(
            f"expected a region thicker than an element of {size_mm:g} mm, got none: ask for a smaller size"
        )
    if len(unsound):
        raise MeshError(_porous(unsound, level))
    hexes = pillow(cells)
    nodes = movable(hexes.cells, hexes.n_nodes, surface_slack(hexes), on_device(level, device), device)
    best = improve(nodes, hexes.colours, start(hexes, nodes))
    if not best.least > 0:
        raise MeshError(_inverted(nodes, best.x, level))
    report = BlocksReport(
        size_mm=size_mm,
        min_scaled_jacobian=best.least,
        euler={"mesh": euler_characteristic(cells), "region": euler_characteristic(level.inside)},
        repaired_cells=flips,
        off_surface_nodes={"count": 0, "max_mm": 0.0},
    )
    return Blocks(_mesh(hexes, device.get(best.x), level), level, report)


def on_device(level: LevelSet, device: Device) -> Any:
    """Bring a level set in lattice units to a device."""
    return put_level(level.phi, np.hstack([np.eye(3) * SAMPLES, np.zeros((3, 1))]), device)


def surface_slack(hexes: Pillowed) -> NDArray[np.float64]:
    """Slack (n,): none for the nodes of the surface."""
    return np.where(np.arange(hexes.n_nodes) < hexes.n_core, FREE, 0.0)


def _mesh(hexes: Pillowed, x: NDArray[Any], level: LevelSet) -> Mesh:
    surface = np.arange(hexes.n_core, hexes.n_nodes, dtype=np.int32)
    return Mesh(
        level.in_mm(x.reshape(3, -1).T).astype(x.dtype),
        "hex8",
        connectivity=hexes.cells,
        node_sets={"surface": surface},
        element_sets={"body": np.arange(len(hexes.cells), dtype=np.int32)},
    )


def _porous(unsound: NDArray[np.int64], level: LevelSet) -> str:
    return (
        f"no manifold core of {level.size_mm:g} mm cells was found: {len(unsound)} places left, the first at "
        f"{_place(level, unsound[0][::-1])}; close the region's pores first or ask for a smaller size"
    )


def _inverted(nodes: Movable, x: Any, level: LevelSet) -> str:
    values = nodes.scaled_jacobian(x)
    worst = nodes.cells[np.argmin(values)]
    centre = nodes.device.get(x).reshape(3, -1).T[worst].mean(axis=0)
    return (
        f"{np.count_nonzero(values <= 0)} of {values.size:,} hexes stayed inverted, the worst at "
        f"{_place(level, centre)}: features there are thinner than an element of {level.size_mm:g} mm; ask for a "
        "smaller size or close the region's pores first"
    )


def _place(level: LevelSet, at: NDArray[Any]) -> str:
    x, y, z = level.in_mm(np.asarray(at, dtype=np.float64)[None, :])[0]
    return f"({x:.1f}, {y:.1f}, {z:.1f}) mm"
