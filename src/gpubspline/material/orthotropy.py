"""Orthotropic material of elements, with the mesh's own directions as its axes.

Wirtz et al. give Young's moduli along and across the femur's axis, and no more. Here axis 3, the axial one, runs along
the element's w, from slice to slice; axis 1 lies in the plane of u and w, across it; axis 2 is 3 x 1. Poisson's ratios
and shear moduli are made of the moduli and the law's one ratio nu by Huber's means,

    nu_ij / E_i = nu / sqrt(E_i E_j),        G_ij = sqrt(E_i E_j) / (2 (1 + nu)),

which is positive definite for every pair of moduli (Wirtz's cross: across the axis is the stiffer below 1.08 g/cm3) and
isotropic where they are equal. Source of the means: Huber 1923, for plates; that bone keeps to them is an assumption.

The mesh carries, as element fields (m,): ``E1_MPa``, ``E2_MPa``, ``E3_MPa``; ``nu12``, ``nu13``, ``nu23`` (nu_ij is the
strain along j, shortened, over that along i, under a stress along i); ``G12_MPa``, ``G13_MPa``, ``G23_MPa``; and the
unit vectors ``axis1_x``, ``axis1_y``, ``axis1_z`` and ``axis2_x`` to ``axis2_z``, LPS. ``E_MPa`` beside them is the
geometric mean of the three moduli, for what can show one alone, and ``nu`` the law's ratio.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.errors import InputError
from gpubspline.mesh.mesh import Mesh

Floats = NDArray[np.float64]

MODULI = ("E1_MPa", "E2_MPa", "E3_MPa")
PAIRS = ((0, 1), (0, 2), (1, 2))

UNCONFIRMED = "orthotropy: Poisson's ratios and shear moduli, by Huber's means of the moduli"


@dataclass(frozen=True, eq=False)
class Orthotropic:
    """Orthotropic material of m elements.

    Attributes
    ----------
    moduli_mpa: (3, m) along the axes.
    nu: (m,) of Huber's means.
    axes: (3, 3, m), axis by component: unit vectors.
    """

    moduli_mpa: Floats
    nu: Floats
    axes: Floats

    @property
    def roots(self) -> Floats:
        """(3, 3, m) Q = sum of E_i^(1/4) a_i a_i^T: the stress of a strain e is Q C(Q e Q) Q, C of a modulus of 1."""
        return np.asarray(np.einsum("im,icm,idm->cdm", self.moduli_mpa**0.25, self.axes, self.axes))

    @property
    def unit_lame(self) -> tuple[Floats, Floats]:
        """Lame's lambda and mu (m,) of a modulus of 1."""
        nu = self.nu
        return nu / ((1 + nu) * (1 - 2 * nu)), 1 / (2 * (1 + nu))

    def stress(self, strain: Floats) -> Floats:
        """Stress (3, 3, ..., m), MPa, of strains (3, 3, ..., m)."""
        q, (lame, shear) = self.roots, self.unit_lame
        inner = np.einsum("cam,ab...m,bdm->cd...m", q, strain, q)
        isotropic = 2 * shear * inner
        for axis in range(3):
            isotropic[axis, axis] += lame * np.einsum("aa...m->...m", inner)
        return np.asarray(np.einsum("cam,ab...m,bdm->cd...m", q, isotropic, q))


def with_orthotropy(mesh: Mesh, axial_mpa: NDArray[Any], transverse_mpa: NDArray[Any], nu: NDArray[Any]) -> Mesh:
    """Give a structured mesh of hexes the element fields of this module's docstring.

    Arguments
    ---------
    axial_mpa, transverse_mpa: (m,) moduli along w, and along both axes across it.
    nu: (m,).

    Raises
    ------
    InputError where the mesh is not structured, so that u, v and w mean nothing beyond an element, or not of hexes.
    """
    if mesh.structure is None or mesh.element.dimension != 3:
        kind = "an explicit" if mesh.structure is None else "a flat"
        raise InputError(f"expected a structured mesh of hexes to take the axes of orthotropy from, got {kind} one")
    moduli = np.stack([transverse_mpa, transverse_mpa, axial_mpa]).astype(np.float64)
    ratio, axes = nu.astype(np.float64), element_axes(mesh)
    fields: dict[str, NDArray[Any]] = dict(zip(MODULI, moduli, strict=True))
    for i, j in PAIRS:
        mean = np.sqrt(moduli[i] * moduli[j])
        fields[f"nu{i + 1}{j + 1}"] = ratio * moduli[i] / mean
        fields[f"G{i + 1}{j + 1}_MPa"] = mean / (2 * (1 + ratio))
    for axis in (0, 1):
        for component, name in enumerate("xyz"):
            fields[f"axis{axis + 1}_{name}"] = axes[axis, component]
    fields |= {"E_MPa": np.cbrt(np.prod(moduli, axis=0)), "nu": ratio}
    real = mesh.points.dtype
    return mesh.with_cell_fields({name: values.astype(real) for name, values in fields.items()})


def element_axes(mesh: Mesh) -> Floats:
    """Axes (3, 3, m) of hexes at their centres, axis by component: 3 along w, 1 along u but across 3, 2 is 3 x 1."""
    cells, centre = mesh.cells, np.full((1, 3), 0.5)
    u, _, w = (
        np.einsum("k,mkc->cm", gradient[0], mesh.points[cells].astype(np.float64))
        for gradient in mesh.element.gradient(centre)
    )
    third = w / np.linalg.norm(w, axis=0)
    first = u - (u * third).sum(axis=0) * third
    first = first / np.linalg.norm(first, axis=0)
    return np.stack([first, np.cross(third, first, axis=0), third])


def is_orthotropic(mesh: Mesh) -> bool:
    """Whether a mesh carries the element fields of this module."""
    return all(name in mesh.cell_fields for name in MODULI)


def without_orthotropy(mesh: Mesh) -> Mesh:
    """Leave the mean modulus and Poisson's ratio alone."""
    kept = {name: values for name, values in mesh.cell_fields.items() if name not in MODULI}
    return replace(mesh, cell_fields=kept) if is_orthotropic(mesh) else mesh


def orthotropic(mesh: Mesh, elements: NDArray[np.integer] | None = None) -> Orthotropic:
    """Take the material from the element fields of some elements, or of all.

    Raises
    ------
    InputError where a field is missing or impossible.
    """
    names = [*MODULI, "nu", *(f"axis{axis}_{c}" for axis in (1, 2) for c in "xyz")]
    missing = [name for name in names if name not in mesh.cell_fields]
    if missing:
        raise InputError(f"expected the element fields {', '.join(names)} of orthotropy, got none of {missing[0]}")
    chosen = slice(None) if elements is None else elements
    values = {name: np.asarray(mesh.cell_fields[name][chosen], dtype=np.float64) for name in names}
    moduli = np.stack([values[name] for name in MODULI])
    if not (np.all(np.isfinite(moduli)) and moduli.min() > 0):
        raise InputError(f"expected positive moduli, got a least of {moduli.min():g} MPa")
    first, second = (np.stack([values[f"axis{axis}_{c}"] for c in "xyz"]) for axis in (1, 2))
    off = np.abs(np.stack([(first**2).sum(0) - 1, (second**2).sum(0) - 1, (first * second).sum(0)])).max()
    if not off < 1e-3:
        raise InputError(f"expected axes of orthotropy of length 1 at right angles, got ones off by {off:.2g}")
    third = np.cross(first, second, axis=0)
    return Orthotropic(moduli, values["nu"], np.stack([first, second, third]))
