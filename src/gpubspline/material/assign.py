"""The material of a mesh, by one of four mappings, and the alarms of it."""

from collections.abc import Mapping as Laws
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.ct.partial_volume import check_treatment, folding
from gpubspline.ct.region import Region
from gpubspline.ct.sampler import hu_sampler
from gpubspline.ct.volume import Volume
from gpubspline.device import Device, open_device
from gpubspline.errors import InputError
from gpubspline.material.alarms import MASS_TOLERANCE, Alarms, add_alarms, count_alarms
from gpubspline.material.by_label import Share, joined, numbered, shares, told, with_density
from gpubspline.material.inset import inset
from gpubspline.material.integration import ElementMaterial, gauss_fields, integrate, points_for
from gpubspline.material.laws import Law, common_kind
from gpubspline.material.mapping import LawOnDevice, Material, apply_material, check_hu, check_policy, law_on_device
from gpubspline.material.mass_parts import mass_parts
from gpubspline.material.orthotropy import with_orthotropy
from gpubspline.material.projection import Projected, project
from gpubspline.material.registry import law as find_law
from gpubspline.material.voxel_mass import voxel_mass_g
from gpubspline.mesh.mesh import Mesh
from gpubspline.mesh.quadrature import integral

MAPPINGS = ("nodal", "nodal-hu", "nodal-e", "gauss", "element-hu", "element-e")
"""Of a law onto a mesh: at its nodes, as the paper does; of the mean HU round each node, or the mean of the law there;
at the Gauss points; of the mean HU of each element, or the mean of the law over it."""


@dataclass(frozen=True)
class Mapping:
    """How the material of a mesh is found.

    Attributes
    ----------
    how: one of ``MAPPINGS``.
    surface_depth_mm: HU of what lies nearer than this to the body's surface is read this far inside; None reads it
        where it lies, or as ``partial_volume`` says.
    points: quadrature points per direction of what ends in ``-hu`` or ``-e``; chosen by the size of elements and voxels
        where None.
    transverse: law of the modulus across the elements' w, where the other is that along it; makes them orthotropic
        (``orthotropy.py``) with ``element-hu`` or ``element-e``.
    policy: keywords of ``map_material``: ``policy``, ``floor_modulus_mpa``, ``floor_poisson``.
    partial_volume: one of ``ct.partial_volume.TREATMENTS``: ``"fold"`` gives HU near the surface, where the CT is
        read, what the scan spread outside of it; nodes have it already where their HU was read so. ``"none"``, as a
        depth does, leaves HU as they lie.

    Raises
    ------
    InputError for what is unknown or does not fit together.
    """

    how: str = "nodal"
    surface_depth_mm: float | None = None
    points: int | None = None
    transverse: Law | None = None
    policy: dict[str, Any] = field(default_factory=dict)
    partial_volume: str = "fold"

    def __post_init__(self) -> None:
        """Check once, at the door."""
        if self.how not in MAPPINGS:
            raise InputError(f"expected a mapping of {', '.join(MAPPINGS)}, got {self.how!r}")
        check_policy(**self.policy)
        check_treatment(self.partial_volume)
        if self.surface_depth_mm is not None and not 0 < self.surface_depth_mm < np.inf:
            raise InputError(f"expected a positive depth below the surface in mm, got {self.surface_depth_mm:g}")
        if self.points is not None and not 1 <= self.points <= 64:
            raise InputError(f"expected 1 to 64 quadrature points per direction, got {self.points}")
        if self.points is not None and self.how in ("nodal", "gauss"):
            raise InputError(f"expected quadrature points for a mapping with -hu or -e alone, got {self.how}")
        if self.transverse is not None and not self.how.startswith("element"):
            raise InputError(f"expected a transverse law with element-hu or element-e, got the mapping {self.how}")

    def check_by_label(self) -> None:
        """Raise InputError where laws by label do not go with this mapping."""
        if self.at_nodes:
            raise InputError(
                f"expected a mapping of {', '.join(MAPPINGS[3:])} with laws by label, got {self.how}: a node between "
                "two labels has both materials"
            )
        if self.transverse is not None:
            raise InputError("expected laws by label or a transverse law, got both")

    @property
    def at_nodes(self) -> bool:
        """Whether nodes have the material, not elements."""
        return self.how.startswith("nodal")

    @property
    def treatment(self) -> str:
        """Of the partial volume: a depth leaves nothing to fold."""
        return "none" if self.surface_depth_mm is not None else self.partial_volume


def assign(
    mesh: Mesh,
    law: Law | None = None,
    mapping: Mapping | None = None,
    *,
    by_label: Laws[int, Law] | None = None,
    volume: Volume | None = None,
    region: Region | None = None,
    labels: NDArray[np.integer] | None = None,
    device: Device | None = None,
) -> tuple[Mesh, Alarms]:
    """Give a mesh the material of its HU.

    Arguments
    ---------
    mesh: with the nodal field ``"HU"``; hexes or quads.
    law: the paper's, ``DEFAULT_LAW``, unless told.
    mapping: the paper's, at nodes, unless told.
    by_label: laws of the elements of some labels, by number; ``law`` is that of the rest. See ``by_label.py``.
    volume, region: the CT and the body in it; on one grid the mesh's mass is compared with the voxels'.
        All mappings but ``nodal`` read the CT itself; without it the HU that is interpolated from the nodes.
    labels: (n_k, n_j, n_i) label of each voxel on the region's grid; by ``by_label`` the voxels have no mass without.
    device: where to compute; ``open_device()`` unless told.

    Returns
    -------
    The mesh with more fields, and the alarms. ``nodal``, ``nodal-hu`` and ``nodal-e`` add the nodal fields
    ``density_g_cm3``, ``E_MPa`` and ``nu``, and the last two replace ``HU`` by the mean round each node;
    the others add element fields of the same names and ``HU``, of means over the elements. ``gauss`` adds element
    fields at the Gauss points, too: ``E_MPa_1`` to ``E_MPa_8`` (27 of order 2), ``nu_1`` and ``density_g_cm3_1`` and
    on, numbered as ``Element.gauss`` has the points, w fastest. With a transverse law ``E_MPa`` is the mean of the
    three moduli, beside the fields of ``orthotropy.py``. Each adds the element field ``material``: 1 + the index
    of the law's piece of the mean HU, the nearest where no piece holds it, or 0 there under the policy ``floor``.

    Raises
    ------
    InputError where the mesh has no HU, a depth is asked for without CT and region, laws by label come with a mapping
    to nodes, with a transverse law or without labels, and as ``map_material``.
    """
    law, mapping, device = law or find_law(), mapping or Mapping(), device or open_device()
    if mapping.surface_depth_mm is not None and (volume is None or region is None):
        raise InputError("expected the CT to read the surface's HU at a depth from, got a mesh or a model alone")
    split = None
    if by_label:
        mapping.check_by_label()
        split = shares(mesh, law, by_label)
    if mapping.at_nodes:
        mapped, alarms = _nodal(mesh, law, mapping, volume, region, device)
    else:
        mapped, alarms = _elements(mesh, law, split, mapping, volume, region, device)
    alarms = replace(alarms, surface_depth_mm=mapping.surface_depth_mm)
    if volume is None or region is None:
        return mapped, alarms
    alarms = replace(alarms, partial_volume=mapping.treatment)
    if mesh.element.dimension != 3 or not region.is_on(volume) or (by_label and labels is None):
        return mapped, alarms

    def weighing(own: Law) -> LawOnDevice:
        return law_on_device(own.weighed(alarms.density_kind), device, **mapping.policy)

    rest, there = weighing(law), {label: weighing(each) for label, each in (by_label or {}).items()}
    how: dict[str, Any] = {"partial_volume": mapping.treatment, "by_label": there, "labels": labels}
    mass = voxel_mass_g(volume, region, rest, device, mapping.surface_depth_mm, **how)
    alarms = replace(alarms, mass_voxels_g=mass)
    if abs(alarms.mass_difference or 0) > MASS_TOLERANCE:
        reading = _reading(mesh, mapping, volume, region, device)
        parts = [(mesh, rest)] if split is None else [(each.part(mesh), there.get(each.label, rest)) for each in split]
        alarms = replace(alarms, mass_parts=mass_parts(mesh, alarms.mass_mesh_g or 0.0, parts, region, **reading))
    return mapped, alarms


def _nodal(
    mesh: Mesh, law: Law, mapping: Mapping, volume: Volume | None, region: Region | None, device: Device
) -> tuple[Mesh, Alarms]:
    if mapping.how == "nodal":
        if mapping.surface_depth_mm is not None and volume is not None and region is not None:
            mesh = mesh.with_fields({"HU": _hu_from_inside(mesh, volume, region, mapping.surface_depth_mm, device)})
        mapped, nodal = apply_material(mesh, law, device=device, **mapping.policy)
        return mapped, nodal_alarms(mapped, nodal, device)
    there, real = law_on_device(law, device, **mapping.policy), mesh.points.dtype
    made = project(mesh, there, **_reading(mesh, mapping, volume, region, device))
    policy = mapping.policy
    if mapping.how == "nodal-e" and policy.get("policy") == "error":
        _refuse_outside(made, law)
        policy = {}  # a mean may lie between two ranges where no point does
    mapped, nodal = apply_material(mesh.with_fields({"HU": made.hu.astype(real)}), law, device=device, **policy)
    if mapping.how == "nodal-e":
        names = ("density_g_cm3", "modulus_mpa", "poisson")
        nodal = replace(nodal, **{name: getattr(made, name).astype(real) for name in names})
        fields = {"density_g_cm3": nodal.density_g_cm3, "E_MPa": nodal.modulus_mpa, "nu": nodal.poisson}
        mapped = mapped.with_fields(fields)
    return mapped, replace(nodal_alarms(mapped, nodal, device), mapping=mapping.how)


def _reading(
    mesh: Mesh, mapping: Mapping, volume: Volume | None, region: Region | None, device: Device
) -> dict[str, Any]:
    """Keywords of ``integrate`` and ``project``: how HU are read at quadrature points, and at how many."""
    if volume is None:
        check_hu(mesh)
    deep, fold = None, None
    if mapping.surface_depth_mm is not None and region is not None:
        deep = inset(region, mapping.surface_depth_mm, mesh.points, device)
    elif mapping.treatment == "fold" and region is not None and volume is not None:
        fold = folding(volume, region, mesh.points, device)
    spacing = None if volume is None else volume.spacing_mm
    return {
        "sampler": None if volume is None else hu_sampler(volume, mesh.points, device),
        "inset": deep,
        "fold": fold,
        "points": mesh.element.order + 1 if mapping.how == "gauss" else mapping.points or points_for(mesh, spacing),
        "device": device,
    }


def nodal_alarms(
    mesh: Mesh, nodal: Material, device: Device, own_nodes: slice = slice(None), points: int | None = None
) -> Alarms:
    """Alarms of a mesh with the material of its nodes, or of a part of one whose ``own_nodes`` are counted with it.

    ``points`` per direction integrate the density; as many as make it exact where None.
    """
    mass = integral(mesh, "density_g_cm3", device, points) / 1000 if mesh.element.dimension == 3 else None
    values = (nodal.density_g_cm3[own_nodes], nodal.modulus_mpa[own_nodes], nodal.piece[own_nodes])
    return count_alarms("nodal", "nodes", nodal.law, *values, mass_mesh_g=mass)


def _hu_from_inside(mesh: Mesh, volume: Volume, region: Region, depth_mm: float, device: Device) -> NDArray[Any]:
    """Nodal HU, that of nodes near the surface read from the CT at the depth."""
    points = mesh.points.astype(np.float64)
    moved = inset(region, depth_mm, points, device).move(points)
    near = np.flatnonzero(np.any(moved != points, axis=1))
    hu = np.array(mesh.fields["HU"])
    if near.size:
        hu[near] = hu_sampler(volume, moved[near], device).at(moved[near])
    return hu


def _elements(
    mesh: Mesh,
    law: Law,
    split: Sequence[Share] | None,
    mapping: Mapping,
    volume: Volume | None,
    region: Region | None,
    device: Device,
) -> tuple[Mesh, Alarms]:
    gauss = mapping.how == "gauss"
    how = _reading(mesh, mapping, volume, region, device)
    how["order"] = "element-hu" if mapping.how == "element-hu" else "element-e"
    of_labels, split = split is not None, split or [Share(0, law, np.arange(mesh.n_elements))]
    kind = common_kind(share.law for share in split)
    parts, alarms, materials, told_of = [], [], [], []
    for share in split:
        part, there = share.part(mesh) if of_labels else mesh, law_on_device(share.law, device, **mapping.policy)
        made = _exact(integrate(part, there, keep_gauss=gauss, **how), share.law)
        counted = _alarms_of(made, share.law, mapping.how, mesh.element.dimension)
        materials.append(_pieces(made, share.law, mapping))
        weighed = share.law.weighed(kind)
        if weighed is share.law:
            parts.append(made)
        else:  # one field has densities of one kind, or neither mass nor gravity would mean anything
            other = integrate(part, law_on_device(weighed, device, **mapping.policy), keep_gauss=gauss, **how)
            parts.append(with_density(made, other))
            mass = None if counted.mass_mesh_g is None else other.mass_g
            counted = replace(counted, mass_mesh_g=mass, density_kind=kind)
        alarms.append(counted)
        told_of.append(told(share, counted, made))
    made = joined(parts, split)
    fields = {"HU": made.hu, "density_g_cm3": made.density_g_cm3, "E_MPa": made.modulus_mpa, "nu": made.poisson}
    fields |= gauss_fields(made) if gauss else {}
    fields |= numbered(mesh, materials, split) if of_labels else {"material": materials[0]}
    mapped = replace(mesh, density_kind=kind).with_cell_fields(fields)
    if mapping.transverse is not None:
        across = integrate(mesh, law_on_device(mapping.transverse, device, **mapping.policy), **how)
        mapped = with_orthotropy(mapped, made.modulus_mpa, across.modulus_mpa, made.poisson)
    told_parts = tuple(told_of) if of_labels else ()
    return mapped, add_alarms(alarms, order_difference=made.order_difference, by_label=told_parts)


def _exact(made: ElementMaterial, law: Law) -> ElementMaterial:
    """Means of what is constant, without the rounding of the integration."""
    if not law.is_constant:
        return made
    (piece,) = law.pieces
    e, nu = np.full_like(made.modulus_mpa, piece.offset_mpa), np.full_like(made.poisson, piece.poisson)
    rho = np.full_like(e, law.density.intercept_g_cm3) if law.density.is_constant else made.density_g_cm3
    return replace(made, modulus_mpa=e, other_modulus_mpa=e, poisson=nu, density_g_cm3=rho)


def _alarms_of(made: ElementMaterial, law: Law, how: str, dimension: int) -> Alarms:
    mass = made.mass_g if dimension == 3 else None
    counted = (made.density_g_cm3, made.modulus_mpa, made.piece)
    return count_alarms(how, "elements", law, *counted, mass_mesh_g=mass)


def _pieces(made: ElementMaterial, law: Law, mapping: Mapping) -> NDArray[np.int32]:
    """Field ``material`` of elements of one law; raises InputError where the policy refuses their HU."""
    policy = mapping.policy.get("policy", "clamp")
    if policy == "error":
        _refuse_outside(made, law, means=mapping.how == "element-hu")
    outside = np.zeros_like(made.piece) if policy == "floor" else -made.piece
    return np.where(made.piece < 0, outside, made.piece + 1)


def _refuse_outside(made: ElementMaterial | Projected, law: Law, means: bool = False) -> None:
    """Raise InputError where HU is outside the law: the elements' means, or at any of the points."""
    count, of = made.points_outside, made.points
    if means and isinstance(made, ElementMaterial):
        count, of = int(np.count_nonzero(made.piece < 0)), made.piece.size
    if count:
        what = "elements' means" if means else "quadrature points"
        low, high = law.range_hu
        raise InputError(
            f"expected HU of {low:g} to {high:g}, which the law {law.name!r} covers, got others in {count} of {of} "
            f"{what}: choose the policy clamp or floor, or another law"
        )
