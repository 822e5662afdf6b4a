"""What each step of the blocks method buys: ``python -m gpubspline.bench.bench_blocks [FILE]``.

Prints two tables, and writes them to the file that is given. Bodies are analytic: a phantom's femur, a branching one
whose arms are about three elements thick, a sponge; and for the steps that keep thin features one that has such.
"""

import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, gaussian_filter

from gpubspline.ct.phantom import phantom
from gpubspline.ct.region import Region
from gpubspline.device import Buffer, Device, open_device
from gpubspline.errors import MeshError
from gpubspline.mesh.blocks import grow, merit, place
from gpubspline.mesh.blocks import lay as laying
from gpubspline.mesh.blocks import level_set as levels
from gpubspline.mesh.blocks.core import cell_means, core_cells
from gpubspline.mesh.blocks.level_set import SAMPLES, bulged, level_set
from gpubspline.mesh.blocks.mesher import blocks_mesh, mesh_level_set
from gpubspline.mesh.blocks.pillow import Pillowed, pillow
from gpubspline.mesh.blocks.repair import repair
from gpubspline.mesh.blocks.result import Blocks
from gpubspline.mesh.distance import surface_distance
from gpubspline.mesh.floors import Effort
from gpubspline.mesh.improve import improve
from gpubspline.mesh.mesh import Mesh
from gpubspline.mesh.movable import FREE, Movable, movable, put_level

Floats = NDArray[np.float64]

OFF: dict[str, dict[str, Any]] = {
    "all steps": {},
    "no smoothing of the level set": {"smoothing": 0.0},
    "no closing of cracks": {"closing": 0.0},
    "nodes on the surface, not outside by the sag": {"bulge": False},
    "no clamp to the core": {"clamp": False},
    "no descent of all hexes": {"effort": Effort(steps=0)},
    "no floors": {"effort": Effort(goal=0.0)},
    "no descent at the floors": {"effort": Effort(floor_steps=0)},
    "no moves of single nodes": {"effort": Effort(sweeps=0, polishes=0)},
    "no more moves of them at last": {"effort": Effort(polishes=0)},
    "surface nodes never let go": {"effort": Effort(loosen=False)},
}
"""Steps that are switched off, one at a time."""

NO_PILLOW = "no pillow"

REPLACED: dict[str, tuple[Any, str, Callable[..., Any]]] = {
    "cavities are not filled, other bodies stay": (levels, "_one_body", lambda phi, region, size_mm: phi),
    "spikes and dents of the core stay": (grow, "core_cells", lambda means: means < 0),
    "no repair of the core": (grow, "repair", lambda cells, means: (cells, 0, np.empty((0, 3), dtype=np.int64))),
    "start where the lattice is": (place, "start", lambda hexes, movable: _unmoved(hexes, movable)),
    "faces not measured once nodes are placed": (place, "_straightened", lambda holding, settled, phi, effort: settled),
}
"""Steps that are left out by another function in their place."""

ALL_PLACES = "other places of the lattice tried"

WAYS = (*OFF, *REPLACED, ALL_PLACES, NO_PILLOW)
"""Rows of the table."""

OF_THIN: dict[str, tuple[Any, str, Callable[..., Any]]] = {
    "all steps": (laying, "thickened", laying.thickened),
    "no cells taken in for thin features": (laying, "thickened", lambda laid: laid),
    "topology not mended": (laying, "mended", lambda laid: laid),
    "no nodes drawn out to tips": (grow, "draw_out", lambda hexes, best, level: best),
}
"""Steps that keep thin features, which ``mesh_level_set`` does without, left out in the same way."""


@dataclass(frozen=True)
class Outcome:
    """One way to mesh a body: worst scaled Jacobian, volume against the region's, mean distance from it in elements.

    NaN is what is not known; all are where no mesh is made.
    """

    least: float = np.nan
    volume_error: float = np.nan
    distance: float = np.nan

    def __str__(self) -> str:
        """As a cell of a table."""
        if np.isnan(self.least):
            return "no mesh"
        more = "" if np.isnan(self.volume_error) else f", {100 * self.volume_error:+.1f} %, {self.distance:.3f}"
        return ("inverted" if self.least <= 0 else f"{self.least:.3f}") + more


def bodies() -> dict[str, tuple[Region, float]]:
    """Regions by name, each with an element size, mm."""
    return {"adult femur": (femur(), 4.0), "three arms": (three_arms(), 3.0), "sponge": (sponge(), 2.0)}


def femur() -> Region:
    """The adult femur phantom by its exact distance."""
    made = phantom("adult-femur")
    n_i, n_j, n_k = made.shape
    k, j, i = np.indices((n_k, n_j, n_i))
    points = np.stack([i, j, k], axis=-1) @ made.affine[:3, :3].T + made.affine[:3, 3]
    distance = np.ascontiguousarray(made.distance_mm(points), dtype=np.float32)
    return Region(distance < 0, distance, made.affine)


def three_arms(spacing: float = 1.0) -> Region:
    """Three capsules that meet, by their exact distance."""
    lines = [np.arange(-32.0, 33.0, spacing), np.arange(-14.0, 21.0, spacing), np.arange(-40.0, 35.0, spacing)]
    points = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).transpose(2, 1, 0, 3)
    ends = ((0, 0, -30), (20, 0, 25), (-18, 8, 25))
    arms = [
        _capsule(points, np.array(end, dtype=float), radius) for end, radius in zip(ends, (6, 4.5, 4.5), strict=True)
    ]
    distance = np.ascontiguousarray(np.minimum.reduce(arms), dtype=np.float32)
    affine = np.diag([spacing, spacing, spacing, 1.0])
    affine[:3, 3] = [line[0] for line in lines]
    return Region(distance < 0, distance, affine)


def sponge(spacing: float = 1.0) -> Region:
    """A ball with struts and pores about two elements wide, by distances from voxel to voxel: cells meet in edges."""
    points = np.indices((33, 33, 33)).transpose(1, 2, 3, 0) * spacing - 16 * spacing
    noise = gaussian_filter(np.random.default_rng(3).standard_normal(points.shape[:3]), 2.5)
    inside = (noise > -0.3 * noise.std()) & (np.linalg.norm(points, axis=-1) < 13)
    distance = distance_transform_edt(~inside, sampling=spacing) - distance_transform_edt(inside, sampling=spacing)
    affine = np.diag([spacing, spacing, spacing, 1.0])
    affine[:3, 3] = -16 * spacing
    return Region(inside, (distance - 0.5 * spacing * np.sign(distance)).astype(np.float32), affine)


def thin_features() -> Region:
    """A ball with a plate and a ring little thicker than an element of 2 mm, and a spike, by their distance."""
    lines = [np.arange(-26.0, 27.0), np.arange(-16.0, 17.0), np.arange(-16.0, 27.0)]
    points = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).transpose(2, 1, 0, 3)
    x, y, z = np.moveaxis(points, -1, 0)
    ball = np.linalg.norm(points, axis=-1) - 9
    plate = np.maximum.reduce([np.abs(x - 12) - 10, np.abs(y - 0.3) - 1.3, np.abs(z) - 8])
    ring = np.hypot(np.hypot(x + 16, z) - 6.5, y) - 1.6
    spike = _capsule(points, np.array([0.0, 2.0, 12.0]), 1.2)
    distance = np.ascontiguousarray(np.minimum.reduce([ball, plate, ring, spike]), dtype=np.float32)
    affine = np.eye(4)
    affine[:3, 3] = [line[0] for line in lines]
    return Region(distance < 0, distance, affine)


def _capsule(points: Floats, end: Floats, radius: float) -> Floats:
    along = np.clip(points @ end / (end @ end), 0, 1)[..., None]
    return np.asarray(np.linalg.norm(points - along * end, axis=-1) - radius)


def ablations(region: Region, size_mm: float, device: Device) -> Iterator[tuple[str, Outcome]]:
    """Outcomes by their way: every step, and without each in turn, on one lattice; then with other places of it."""
    for way, options in OFF.items():
        of_level = {name: value for name, value in options.items() if name in ("smoothing", "closing")}
        of_mesh = {name: value for name, value in options.items() if name not in of_level}
        make = partial(_on_one_lattice, region, size_mm, device, of_level, of_mesh)
        yield way, _outcome(region, size_mm, device, make)
    whole = partial(_on_one_lattice, region, size_mm, device, {}, {})
    for way, (home, name, instead) in REPLACED.items():
        with patch.object(home, name, instead):
            yield way, _outcome(region, size_mm, device, whole)
    with patch.object(merit, "GOOD", 1.0):
        yield ALL_PLACES, _outcome(region, size_mm, device, partial(blocks_mesh, region, size_mm, device=device))
    yield NO_PILLOW, Outcome(without_pillow(region, size_mm, device)[1])


def thin_ablations(region: Region, size_mm: float, device: Device) -> Iterator[str]:
    """Lines of a table in Markdown: a region in the lattice's first place with every step that keeps thin features.

    Then without each in turn.
    """
    yield "| | hexes | worst scaled Jacobian | volume | places of another topology | stands out, elements |"
    yield "|---|---|---|---|---|---|"
    for way, (home, name, instead) in OF_THIN.items():
        with patch.object(home, name, instead):
            laid = laying.lay(region, size_mm, {}, None, device, 0)
            made = grow.grow(laid.level, laid.core, device)
        volume = made.finished().mesh.volume_mm3 / region.volume_mm3 - 1
        found = (f"{made.placed.nodes.least:.3f}", f"{100 * volume:+.1f} %", str(len(made.core.differences)))
        yield f"| {way} | {laid.elements:,} | {' | '.join(found)} | {made.farthest:.1f} |"


def _unmoved(hexes: Pillowed, movable: Movable) -> Buffer:
    """Nodes (3, n) where the lattice has them."""
    return movable.device.put(np.ascontiguousarray(hexes.points.T))


def _on_one_lattice(
    region: Region, size_mm: float, device: Device, of_level: dict[str, Any], of_mesh: dict[str, Any]
) -> Blocks:
    return mesh_level_set(level_set(region, size_mm, device=device, **of_level), device, **of_mesh)


def _outcome(region: Region, size_mm: float, device: Device, make: Callable[[], Blocks]) -> Outcome:
    try:
        made = make()
    except (MeshError, ValueError, IndexError):  # what is not manifold has no layer
        return Outcome()
    off = surface_distance(made.mesh, region, device).mean / size_mm
    return Outcome(made.report.min_scaled_jacobian, made.mesh.volume_mm3 / region.volume_mm3 - 1, off)


def without_pillow(region: Region, size_mm: float, device: Device) -> tuple[int, float]:
    """Hexes of the core alone, its boundary on the surface: their number and the worst scaled Jacobian."""
    level = level_set(region, size_mm, device=device)
    means = cell_means(level.phi)
    core = repair(core_cells(means), means)[0]
    whole, count = pillow(core), int(np.count_nonzero(core))
    cells, points = whole.cells[:count], whole.points[: whole.n_core]
    slack = np.full(whole.n_core, FREE)
    slack[Mesh(points, "hex8", connectivity=cells).boundary()] = 0.0
    held = put_level(bulged(level.phi), np.hstack([np.eye(3) * SAMPLES, np.zeros((3, 1))]), device)
    hexes = movable(cells, whole.n_core, slack, held, device)
    x = device.put(np.ascontiguousarray(points.T))
    return count, improve(hexes, whole.colours[: whole.n_core], x, slack, replace(Effort(), loosen=False)).least


def table(device: Device) -> Iterator[str]:
    """Lines of a table in Markdown: what each way makes of each body."""
    yield f"| | {' | '.join(f'{body}, {size:g} mm' for body, (_, size) in bodies().items())} |"
    found = [dict(ablations(region, size, device)) for region, size in bodies().values()]
    yield f"|---|{'---|' * len(found)}"
    for way in WAYS:
        yield f"| {way} | {' | '.join(str(outcomes[way]) for outcomes in found)} |"


def main() -> None:
    """Print the table."""
    device = open_device("auto")
    blocks_mesh(three_arms(), 6.0, device=device)  # compiles the kernels
    lines = ["## What each step buys", ""]
    lines += table(device)
    lines += ["", "## What keeps thin features: plate, ring and spike, 2 mm", ""]
    lines += thin_ablations(thin_features(), 2.0, device)
    print("\n".join(lines))
    if len(sys.argv) > 1:
        Path(sys.argv[1]).write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
