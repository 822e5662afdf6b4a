"""Mapping a material law onto the nodes and elements of a mesh."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.device import Buffer, Device, check_device, open_device
from gpubspline.errors import InputError, expect
from gpubspline.material.laws import Law
from gpubspline.material.registry import law as find_law
from gpubspline.mesh import structure
from gpubspline.mesh.mesh import Mesh
from gpubspline.shown import brief

POLICIES = ("clamp", "floor", "error")
"""What becomes of HU outside every range of a law."""

FLOOR_MODULUS_MPA = 1.0
"""Modulus of the ``floor`` policy: soft against any bone, stiff enough for a solver to stay well conditioned."""

FLOOR_POISSON = 0.3


@dataclass(frozen=True, eq=False)
class Material:
    """What a law makes of HU.

    Attributes
    ----------
    law: the law.
    policy: what was done with HU outside every range of the law, one of ``POLICIES``.
    density_g_cm3, modulus_mpa, poisson: (n,) real, density of the law's kind, Young's modulus and Poisson's ratio.
    piece: (n,) int32, index of the law's piece used, or -1 - index of the nearest where HU was outside every range.
    """

    law: Law
    policy: str
    density_g_cm3: NDArray[Any]
    modulus_mpa: NDArray[Any]
    poisson: NDArray[Any]
    piece: NDArray[np.int32]

    __repr__ = brief

    @property
    def out_of_range(self) -> int:
        """How many values of HU were outside every range of the law."""
        return int(np.count_nonzero(self.piece < 0))


def map_material(
    hu: Any,
    law: Law,
    *,
    policy: str = "clamp",
    floor_modulus_mpa: float = FLOOR_MODULUS_MPA,
    floor_poisson: float = FLOOR_POISSON,
    device: Device | None = None,
) -> Material:
    """Density, Young's modulus and Poisson's ratio of HU values, on a device.

    Arguments
    ---------
    hu: (n,) HU, an array or a buffer of the device.
    law: the law; each of its ranges holds its lower end, and the last one its upper end too.
    policy: for HU outside every range, ``"clamp"`` moves HU to the nearest end of a range, for the density as well as
        for modulus and Poisson's ratio; ``"floor"`` keeps the density and gives a small modulus; ``"error"`` refuses.
    floor_modulus_mpa, floor_poisson: what ``"floor"`` gives.
    device: where to compute; ``open_device()`` unless told.

    Raises
    ------
    InputError for an unknown policy, a floor of no solid, or HU outside every range under ``"error"``.
    """
    device = device or open_device()
    law_there = law_on_device(law, device, policy, floor_modulus_mpa, floor_poisson)
    on_host = isinstance(hu, np.ndarray | list | tuple | float | int)  # a CT's are whole numbers, the kernel's are not
    values = device.put(np.asarray(hu, device.real) if on_host else hu)
    n = int(np.prod(values.shape))
    results = (device.empty(n), device.empty(n), device.empty(n), device.empty(n, np.int32))
    law_there.launch(values, n, *results)
    material = Material(law, policy, *(device.get(buffer) for buffer in results))
    if policy == "error" and material.out_of_range:
        _refuse(np.asarray(device.get(values)), material)
    return material


@dataclass(frozen=True, eq=False)
class LawOnDevice:
    """A law and what to do outside it, on a device.

    Attributes
    ----------
    device: where it lives.
    arguments: of the kernel, between HU and the number of values.
    """

    device: Device
    arguments: tuple[Any, ...]

    def launch(self, hu: Buffer, n: int, density: Buffer, modulus: Buffer, poisson: Buffer, piece: Buffer) -> None:
        """Write density, modulus, Poisson's ratio and piece of HU (n)."""
        self.device.launch("material.power_law", n, hu, *self.arguments, n, density, modulus, poisson, piece)


def law_on_device(
    law: Law,
    device: Device,
    policy: str = "clamp",
    floor_modulus_mpa: float = FLOOR_MODULUS_MPA,
    floor_poisson: float = FLOOR_POISSON,
) -> LawOnDevice:
    """Bring a law to a device; arguments and errors as of ``map_material``."""
    check_policy(policy, floor_modulus_mpa, floor_poisson)
    names = ("lower_hu", "upper_hu", "factor_mpa", "exponent", "offset_mpa", "poisson")
    columns = [device.put(np.array([getattr(piece, name) for piece in law.pieces])) for name in names]
    lines = [device.put(np.array(column)) for column in zip(*law.density.lines, strict=True)]
    floor_values = (int(policy == "floor"), float(floor_modulus_mpa), float(floor_poisson))
    return LawOnDevice(device, (*columns, len(law.pieces), *lines, len(law.density.lines), *floor_values))


def check_policy(
    policy: str = "clamp", floor_modulus_mpa: float = FLOOR_MODULUS_MPA, floor_poisson: float = FLOOR_POISSON
) -> None:
    """Raise InputError for an unknown policy or a floor of no solid."""
    if policy not in POLICIES:
        raise InputError(f"expected a policy of {', '.join(POLICIES)} for HU outside the law, got {policy!r}")
    if not (0 < floor_modulus_mpa < np.inf and 0 <= floor_poisson < 0.5):
        floor = f"{floor_modulus_mpa:g} MPa and {floor_poisson:g}"
        raise InputError(f"expected a positive floor modulus and a Poisson's ratio below 0.5, got {floor}")


def check_hu(mesh: Mesh) -> None:
    """Raise InputError where a mesh has no HU, or some that are no numbers: these would get the lowest modulus."""
    if "HU" not in mesh.fields:
        raise InputError(f"expected a mesh with the nodal field HU, got the fields {', '.join(mesh.fields) or 'none'}")
    wild = mesh.n_nodes - int(np.count_nonzero(np.isfinite(mesh.fields["HU"])))
    if wild:
        raise InputError(f"expected finite HU, got NaN or infinity at {wild} of {mesh.n_nodes} nodes")


def _refuse(hu: NDArray[Any], material: Material) -> None:
    outside = hu[material.piece < 0]
    ranges = ", ".join(f"{piece.lower_hu:g} to {piece.upper_hu:g}" for piece in material.law.pieces)
    raise InputError(
        f"expected HU of {ranges}, which the law {material.law.name!r} covers, got {outside.min():g} to "
        f"{outside.max():g} HU at {outside.size} of {hu.size} nodes: choose the policy clamp or floor, or another law"
    )


def apply_material(
    mesh: Mesh,
    law: Law | str | None = None,
    *,
    policy: str = "clamp",
    floor_modulus_mpa: float = FLOOR_MODULUS_MPA,
    floor_poisson: float = FLOOR_POISSON,
    device: Device | None = None,
) -> tuple[Mesh, Material]:
    """Give a mesh the material of its nodal HU.

    Arguments
    ---------
    mesh: with the nodal field ``"HU"``.
    law: the paper's, ``DEFAULT_LAW``, unless told.
    policy, floor_modulus_mpa, floor_poisson, device: see ``map_material``.

    Returns
    -------
    The mesh with the nodal fields ``"density_g_cm3"``, ``"E_MPa"`` and ``"nu"``, and the element field ``"material"``,
    (m,) int32: 1 + the index of the law's piece that holds the mean HU of its corners, the nearest piece where
    none does, or 0 for such an element under the policy ``"floor"``. Beside it, the material of its nodes.

    Raises
    ------
    InputError where the mesh has no HU, or some that are not finite, and as ``map_material``.
    """
    expect(mesh, Mesh, "sample makes one, read_mesh reads one")
    check_device(device)
    check_hu(mesh)
    law = law if isinstance(law, Law) else find_law(*([] if law is None else [law]))
    device = device or open_device()
    floor = {"floor_modulus_mpa": floor_modulus_mpa, "floor_poisson": floor_poisson}
    nodal = map_material(mesh.fields["HU"], law, policy=policy, device=device, **floor)
    # nodes on both sides of a gap are in range while their mean is not: elements are never refused
    element = map_material(_element_means(mesh, "HU"), law, device=device).piece
    fields = {"density_g_cm3": nodal.density_g_cm3, "E_MPa": nodal.modulus_mpa, "nu": nodal.poisson}
    material = np.maximum(element + 1, 0 if policy == "floor" else -element)  # -1 - index becomes 0 or 1 + index
    mapped = replace(mesh, density_kind=law.density.kind)
    return mapped.with_fields(fields).with_cell_fields({"material": material}), nodal


def _element_means(mesh: Mesh, field: str) -> NDArray[Any]:
    """Mean of a nodal field over the corners of each element, (m,); a structured mesh stays without its table."""
    values = mesh.fields[field]
    values = values.astype(np.result_type(values, np.float32), copy=False)
    if mesh.connectivity is not None:
        return np.asarray(values[mesh.connectivity[:, : mesh.element.n_corners]].mean(axis=1))
    assert mesh.structure is not None
    corners = structure.corner_nodes(mesh.element, mesh.structure)
    means = np.reshape(values if corners is None else values[corners], mesh.structure, order="F")
    for axis in range(means.ndim):
        along = np.moveaxis(means, axis, 0)
        means = np.moveaxis(along[:-1] + along[1:], 0, axis)
    means = means.ravel(order="F")
    means *= means.dtype.type(0.5**mesh.element.dimension)
    return means
