"""From a level set to hexes: the core, the layer that grows from it to the zero level, the nodes moved."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from gpubspline.device import Device
from gpubspline.errors import InputError, MeshError
from gpubspline.mesh.blocks.contacts import find_contacts, part_strangers
from gpubspline.mesh.blocks.core import Cells, cell_means, core_cells, euler_characteristic, largest_body
from gpubspline.mesh.blocks.labelled import assign, body_volumes, costs, element_sets, find_interfaces, hold, node_sets
from gpubspline.mesh.blocks.level_set import ON_SURFACE, SAMPLES, Field, LevelSet, Part
from gpubspline.mesh.blocks.pillow import Owners, Pillowed, pillow
from gpubspline.mesh.blocks.place import Holding, PlacedOn, place_nodes
from gpubspline.mesh.blocks.reach import CoreDistance, LostFeature, core_distance, lost_features
from gpubspline.mesh.blocks.repair import repair, repair_owners
from gpubspline.mesh.blocks.result import Blocks, BlocksReport, BodyReport, OtherTopology
from gpubspline.mesh.blocks.tips import draw_out, stand_out
from gpubspline.mesh.blocks.topology import Difference, differences
from gpubspline.mesh.floors import Effort
from gpubspline.mesh.mesh import Mesh
from gpubspline.mesh.movable import FIXED
from gpubspline.mesh.validity import certify

PARTINGS = 12
"""Most rounds in which bodies that do not touch are parted and cells are repaired."""


@dataclass(frozen=True, eq=False)
class Core:
    """Repaired core.

    Attributes
    ----------
    cells: the body of each cell where there are several, else whether it is inside.
    flips: cells that the repair changed.
    differences: places where its topology is not that of the region's level set.
    """

    cells: Cells | Owners
    flips: int
    differences: tuple[Difference, ...]

    @cached_property
    def euler(self) -> dict[str, int]:
        """Euler characteristic of the core and of the region's level set."""
        own = euler_characteristic(self.cells > 0)
        return {"mesh": own, "region": own + sum(place.euler for place in self.differences)}

    @cached_property
    def distance(self) -> CoreDistance:
        """Distance from the boundary of the cells."""
        return core_distance(self.cells > 0)


@dataclass(frozen=True, eq=False)
class Grown:
    """Hexes on a device, their nodes where the worst is as good as it gets.

    Attributes
    ----------
    level, core: what they grew on.
    volumes: of each body in the region, in elements, by its name, where there are several.
    pairs: bodies that touch.
    hexes, placed: the hexes, and their nodes.
    """

    level: LevelSet
    core: Core
    volumes: Mapping[str, float]
    pairs: tuple[tuple[int, int], ...]
    hexes: Pillowed
    placed: PlacedOn

    @property
    def n_hexes(self) -> int:
        """Number of hexes."""
        return len(self.hexes.cells)

    @cached_property
    def lost(self) -> tuple[LostFeature, ...]:
        """Parts of the level set's inside that the core does not reach."""
        return lost_features(self.level, self.placed.reached)

    @cached_property
    def farthest(self) -> float:
        """How far the region's surface stands out of the mesh, in elements; 0 where it is no farther than allowed."""
        hexes = self.placed.hexes
        return float(stand_out(self.placed.points, hexes.cells, self.level.places, hexes.device)[1].max(initial=0.0))

    @cached_property
    def bodies(self) -> tuple[BodyReport, ...]:
        """What is known of each of several bodies."""
        found, mm3 = [], self.level.size_mm**3
        for number, (name, volume) in enumerate(self.volumes.items(), start=1):
            cells = self.hexes.cells[self.hexes.owners == number]
            made = Mesh(self.placed.points, "hex8", connectivity=cells).volume_mm3 if len(cells) else 0.0
            found.append(BodyReport(name, len(cells), {"mesh": made * mm3, "region": volume * mm3}))
        return tuple(found)

    @cached_property
    def off(self) -> float:
        """By what part the volume of a body is off at most: of several, or of the whole where it is one."""
        if self.volumes:
            return max(abs(body.off) for body in self.bodies)
        region, mm3 = self.level.region, self.level.size_mm**3
        inside = np.count_nonzero(self.level.phi < 0) / SAMPLES**3 if region is None else region.volume_mm3 / mm3
        return abs(Mesh(self.placed.points, "hex8", connectivity=self.hexes.cells).volume_mm3 / inside - 1)

    @cached_property
    def least_determinant(self) -> float:
        """Part of its mean one below which no hex's Jacobian determinant is known to fall."""
        mesh = Mesh(self.placed.points, "hex8", connectivity=self.hexes.cells)
        return certify(mesh, self.placed.hexes.device).certificate.least_ratio

    def finished(self) -> Blocks:
        """Make the mesh with its report."""
        hexes, level, points, names = self.hexes, self.level, self.placed.points, tuple(self.volumes)
        sets = node_sets(hexes, names, self.pairs)
        report = BlocksReport(
            size_mm=level.size_mm,
            min_scaled_jacobian=self.placed.nodes.least,
            euler=self.core.euler,
            topology=tuple(
                OtherTopology(_xyz(level.in_mm(place.at[None])[0]), place.what) for place in self.core.differences
            ),
            repaired_cells=self.core.flips,
            off_surface_nodes=off_surface(points[sets["surface"]], self.placed.reached, level),
            lost_features=self.lost,
            attempts=(),
            bodies=self.bodies,
        )
        mesh = Mesh(
            level.in_mm(points).astype(points.dtype),
            "hex8",
            connectivity=hexes.cells,
            node_sets=sets,
            element_sets={
                "body": np.arange(len(hexes.cells), dtype=np.int32),
                **element_sets(hexes, names),
            },
        )
        tips = np.flatnonzero(self.placed.nodes.slack == FIXED).astype(np.int32)
        return Blocks(mesh, level, self.core.cells, report, tips)


def grow(
    level: LevelSet,
    core: Core,
    device: Device,
    effort: Effort | None = None,
    parts: Mapping[str, Part] | None = None,
    *,
    bulge: bool = True,
    clamp: bool = True,
    allow_inverted: bool = False,
) -> Grown:
    """Grow a layer of hexes on a core to the zero of its level set; see ``mesh_level_set``.

    Raises
    ------
    MeshError where a hex stays inverted, unless that is allowed.
    """
    hexes = pillow(core.cells)
    held = hold(hexes)
    interfaces = dict(find_interfaces(list((parts or {}).values()), held.pairs, core.cells, clamp=clamp))
    holding = Holding(hexes, held, core.distance if clamp else None, interfaces, device)
    placed = place_nodes(holding, level, effort, bulge=bulge)
    if placed.nodes.least > 0:
        placed = replace(placed, nodes=draw_out(placed.hexes, placed.nodes, level))
    if not (allow_inverted or placed.nodes.least > 0):
        raise MeshError(_inverted(placed.hexes.scaled_jacobian(placed.nodes.x), placed.points[hexes.cells], level))
    return Grown(level, core, body_volumes(level.phi, parts or {}), held.pairs, hexes, placed)


def find_core(
    level: LevelSet, parts: Mapping[str, Part] | None = None, whole: tuple[Cells, Field] | None = None
) -> Core:
    """Find the cells inside a level set, and the body of each where there are several, and repair them.

    ``whole``: the cells of all bodies together and their distances, where these are known better than by their middles.

    Raises
    ------
    InputError where no cell is inside; MeshError where the repair fails.
    """
    cells: Cells | Owners
    means = cell_means(level.phi)
    inside, means = (core_cells(means), means) if whole is None else whole
    if parts:
        cells, flips, unsound = _find_owners(level, inside, means, [part.phi for part in parts.values()])
    else:
        cells, flips, unsound = repair(inside, means)
    if len(unsound):
        raise MeshError(
            f"no manifold core of {level.size_mm:g} mm cells was found: {len(unsound)} places are left, the first at "
            f"{_place(level, unsound[0][::-1])}; close the region's pores first or ask for a smaller size"
        )
    _check_present(level, cells, parts or {})
    if not cells.any():
        deepest = np.array(np.unravel_index(np.argmin(level.phi), level.phi.shape)[::-1]) / SAMPLES
        raise InputError(
            f"expected a region thicker than an element of {level.size_mm:g} mm, got one that is thinner even at "
            f"{_place(level, deepest)}: ask for a smaller size"
        )
    cells[~largest_body(cells > 0)] = 0
    return Core(cells, flips, differences(cells > 0, level.inside))


def _find_owners(
    level: LevelSet, inside: Cells, means: Field, parts: Sequence[Field]
) -> tuple[Owners, int, NDArray[np.int64]]:
    """Body of each cell, sound, and none beside one that it does not touch; else as ``repair_owners``."""
    within = np.stack([cell_means(part) for part in parts])
    contacts = find_contacts(level.phi, parts)
    price = costs(means, within)
    given = owners = assign(inside, within)
    for _ in range(PARTINGS):
        owners, price = part_strangers(owners, price, contacts)
        owners, _, unsound = repair_owners(owners, price)
        if len(unsound) or not len(contacts.strangers(owners)):
            break
    return owners, int(np.count_nonzero(owners != given)), unsound


def _check_present(level: LevelSet, cells: Cells | Owners, parts: Mapping[str, Part]) -> None:
    """Raise MeshError where one of several bodies has no cell."""
    for number, (name, part) in enumerate(parts.items(), start=1):
        if not np.any(cells == number):
            deepest = np.array(np.unravel_index(np.argmin(part.raw), part.raw.shape))[::-1] / SAMPLES
            raise MeshError(
                f"no cell of {level.size_mm:g} mm lies in {name} at {_place(level, deepest)}, which is too small or "
                "too thin: ask for a smaller size, join it to another label, or take --no-conforming"
            )


def distance_from(phi: NDArray[Any], points: NDArray[Any]) -> NDArray[Any]:
    """Distance (n,), in elements, of points (n, 3), lattice coordinates, from the zero of a level set near them."""
    return np.asarray(np.abs(map_coordinates(phi, points[:, ::-1].T * SAMPLES, order=1, mode="nearest")))


def off_surface(points: NDArray[Any], reached: NDArray[Any], level: LevelSet) -> dict[str, float]:
    """How many of the points (n, 3), lattice coordinates, are off the zero level and off the region, and how far.

    Nodes that are drawn out to a tip are on the region, whose level set leaves it out.
    """
    off = distance_from(reached, points)
    far = np.flatnonzero(off > ON_SURFACE)
    off = np.minimum(off[far], np.abs(level.region_distance(points[far])))
    return {"count": int(np.count_nonzero(off > ON_SURFACE)), "max_mm": float(off.max(initial=0.0)) * level.size_mm}


def _inverted(values: NDArray[Any], corners: NDArray[Any], level: LevelSet) -> str:
    return (
        f"{np.count_nonzero(values <= 0)} of {values.size:,} hexes stayed inverted, the worst at "
        f"{_place(level, corners[np.argmin(values)].mean(axis=0))}: features there are thinner than an element of "
        f"{level.size_mm:g} mm; ask for a smaller size or close the region's pores first"
    )


def _xyz(place: NDArray[np.float64]) -> tuple[float, float, float]:
    x, y, z = (float(coordinate) for coordinate in place)
    return x, y, z


def _place(level: LevelSet, at: NDArray[Any]) -> str:
    x, y, z = level.in_mm(np.asarray(at, dtype=np.float64)[None, :])[0]
    return f"({x:.4g}, {y:.4g}, {z:.4g}) mm"
