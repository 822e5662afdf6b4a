"""Where the mass of a mesh and that of the voxels part: between nodes, or where mesh and region are not the same."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from gpubspline.ct.region import Region
from gpubspline.ct.sampler import sampler
from gpubspline.device import Device
from gpubspline.material.integration import AtPoints
from gpubspline.material.mapping import LawOnDevice
from gpubspline.mesh.mesh import Mesh
from gpubspline.mesh.quadrature import quadrature

MOST_POINTS = 4
"""Quadrature points per direction: tenths of the difference are enough to tell where it lies."""


@dataclass(frozen=True)
class MassParts:
    """What makes the mesh's mass another than the voxels'.

    Attributes
    ----------
    between_nodes_g: of the mesh's material, less the law of the CT integrated over the mesh.
    filled_mm3, filled_g: of the mesh outside the region, such as cracks and pores that it closes.
    left_mm3: of the region outside the mesh.
    """

    between_nodes_g: float
    filled_mm3: float
    filled_g: float
    left_mm3: float

    def to_dict(self) -> dict[str, float]:
        """Plain numbers, for JSON."""
        return asdict(self)


def mass_parts(
    mesh: Mesh, mass_mesh_g: float, shares: Sequence[tuple[Mesh, LawOnDevice]], region: Region, **reading: Any
) -> MassParts:
    """Look where the mass of a mesh of hexes parts from the CT's.

    Arguments
    ---------
    mass_mesh_g: of the mesh's own material.
    shares: the elements of each law, and the law.
    reading: how HU are read, at how many points, on which device: arguments of ``material.projection.project``.
    """
    found = np.sum([_ct_masses(part, law, region, **reading) for part, law in shares], axis=0)
    ct_g, filled_mm3, filled_g = found.tolist()
    left_mm3 = max(region.volume_mm3 - (mesh.volume_mm3 - filled_mm3), 0.0)
    return MassParts(mass_mesh_g - ct_g, filled_mm3, filled_g, left_mm3)


def _ct_masses(
    mesh: Mesh, law: LawOnDevice, region: Region, device: Device, points: int, **reading: Any
) -> tuple[float, float, float]:
    """Mass of the CT over a mesh of hexes, g, and volume and mass of the part of it outside the region, mm3 and g.

    ``reading``: how HU are read, keywords of ``AtPoints``.
    """
    rule = quadrature(mesh.element, min(points, MOST_POINTS), device)
    work = AtPoints(mesh, law, rule, **reading)
    distance = sampler(region.distance_mm, region.affine, mesh.points.astype(np.float64), device)
    total, filled = 0.0, np.zeros(2)
    for elements in rule.chunks(mesh.n_elements):
        m = work.read(elements)
        volume = np.array(work.see(work.volume, m), dtype=np.float64).ravel()
        mass = volume * np.asarray(work.see(work.density, m), dtype=np.float64).ravel()
        outside = distance.at(work.points(m)) > 0
        total += float(mass.sum())
        filled += volume[outside].sum(), mass[outside].sum()
    return total / 1000, float(filled[0]), float(filled[1]) / 1000
