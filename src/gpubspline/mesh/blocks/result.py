"""A mesh of blocks and what is known of it."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import permutations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.ct.region import Region
from gpubspline.mesh.blocks.core import Cells
from gpubspline.mesh.blocks.level_set import LevelSet
from gpubspline.mesh.blocks.pillow import Owners
from gpubspline.mesh.blocks.placement import Placement
from gpubspline.mesh.blocks.reach import LostFeature, core_distance, within_reach
from gpubspline.mesh.mesh import Mesh
from gpubspline.shown import brief


@dataclass(frozen=True)
class Attempt:
    """One place of the lattice, and what came of it.

    Attributes
    ----------
    placement: offset and turn.
    elements: hexes.
    min_scaled_jacobian: of the worst; None where the core's topology alone told that an earlier mesh is better.
    euler: Euler characteristic.
    """

    placement: Placement
    elements: int
    min_scaled_jacobian: float | None
    euler: int

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers, for JSON."""
        return {
            "offset": list(self.placement.offset),
            "turn_degrees": list(self.placement.turn_degrees),
            "elements": self.elements,
            "min_scaled_jacobian": self.min_scaled_jacobian,
            "euler": self.euler,
        }


@dataclass(frozen=True)
class BodyReport:
    """One of several bodies of a mesh.

    Attributes
    ----------
    name: of its element set.
    elements: hexes.
    volume_mm3: of these, and of what the region has of the body: ``{"mesh": 1.0, "region": 1.0}``.
    """

    name: str
    elements: int
    volume_mm3: dict[str, float]

    @property
    def off(self) -> float:
        """By what part its volume differs from the region's."""
        return self.volume_mm3["mesh"] / self.volume_mm3["region"] - 1

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers, for JSON."""
        return {"name": self.name, "elements": self.elements, "volume_mm3": dict(self.volume_mm3)}


def measured(bodies: tuple[BodyReport, ...], mesh: Mesh) -> tuple[BodyReport, ...]:
    """Elements and volumes that the bodies have in a mesh made of theirs, finer or curved: its element sets."""
    found = []
    for body in bodies:
        cells = mesh.cells[mesh.element_sets[body.name]]
        volume = Mesh(mesh.points, mesh.element_type, connectivity=cells).volume_mm3 if len(cells) else 0.0
        found.append(BodyReport(body.name, len(cells), {**body.volume_mm3, "mesh": volume}))
    return tuple(found)


def sets_carried_to(fine: Mesh, coarse: Mesh) -> dict[str, NDArray[np.int32]]:
    """Node sets of a mesh made of another, finer or curved: its surface, and between bodies as the other names them."""
    sets = {"surface": fine.boundary_nodes()}
    nodes = {name: np.unique(fine.cells[members]) for name, members in fine.element_sets.items()}
    for a, b in permutations(nodes, 2):
        if f"{a}_to_{b}" in coarse.node_sets:
            sets[f"{a}_to_{b}"] = np.intersect1d(nodes[a], nodes[b]).astype(np.int32)
    return sets


@dataclass(frozen=True)
class OtherTopology:
    """A place where the mesh has a tunnel, a cavity or a bridge more or less than the region.

    Attributes
    ----------
    place_mm: (x, y, z), LPS.
    what: the mesh does there, such as ``"closes a tunnel"``.
    """

    place_mm: tuple[float, float, float]
    what: str

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers, for JSON."""
        return {"place_mm": list(self.place_mm), "what": self.what}


@dataclass(frozen=True)
class BlocksReport:
    """What is known of a mesh of blocks beside its quality.

    Attributes
    ----------
    size_mm: of an element.
    min_scaled_jacobian: of the worst hex.
    euler: Euler characteristic of the mesh and of the region's level set, ``{"mesh": 1, "region": 1}``.
    topology: places where the mesh's is not that of the level set.
    repaired_cells: cells of the core that were flipped to make its boundary a manifold of that topology.
    off_surface_nodes: surface nodes that had to leave the surface: ``{"count": 0, "max_mm": 0.0}``.
    lost_features: parts of the region too thin for the lattice, farthest out first.
    attempts: places of the lattice that were tried; the mesh is the best of them.
    bodies: those that touch, where there are several.
    """

    size_mm: float
    min_scaled_jacobian: float
    euler: dict[str, int]
    topology: tuple[OtherTopology, ...]
    repaired_cells: int
    off_surface_nodes: dict[str, float]
    lost_features: tuple[LostFeature, ...]
    attempts: tuple[Attempt, ...]
    bodies: tuple[BodyReport, ...] = ()

    @property
    def is_whole(self) -> bool:
        """Whether the mesh's topology is the region's."""
        return not self.topology

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers and lists, for JSON."""
        return {
            "size_mm": self.size_mm,
            "min_scaled_jacobian": self.min_scaled_jacobian,
            "euler": dict(self.euler),
            "topology": [place.to_dict() for place in self.topology],
            "repaired_cells": self.repaired_cells,
            "off_surface_nodes": dict(self.off_surface_nodes),
            "lost_features": [feature.to_dict() for feature in self.lost_features],
            "attempts": [attempt.to_dict() for attempt in self.attempts],
            "bodies": [body.to_dict() for body in self.bodies],
        }


@dataclass(frozen=True, eq=False)
class Blocks:
    """A mesh of blocks and what is known of it.

    Attributes
    ----------
    mesh: hex8.
    level: set that it conforms to.
    core: its cells, by the number of their body from 1 where there are several.
    report: what is known of it.
    tips: (k,) surface nodes that were drawn out of the level set to tips of the region.
    parts: regions of several bodies, by name, in the order of their numbers.
    """

    mesh: Mesh
    level: LevelSet
    core: Cells | Owners
    report: BlocksReport
    tips: NDArray[np.int32]
    parts: Mapping[str, Region] = field(default_factory=dict)

    __repr__ = brief

    def surface(self) -> LevelSet:
        """The level set as far as the core reaches it: sheets that it does not reach are left out."""
        return replace(self.level, phi=within_reach(self.level.phi, core_distance(self.core > 0)))
