"""Strain and stress at the Gauss points of elements, from the displacements of their nodes.

Arrays are planes with the elements along the last axis: (..., points, elements). Symmetric tensors have six components
in VTK's order xx, yy, zz, xy, yz, xz; shear strains are the tensor's own, half the engineers'.

The formulations of hex8 are those that the displacements were solved with: ``"full"``; ``"incompatible"``, whose three
quadratic modes a component are found again from the displacements, as an element condenses them (Taylor, Beresford and
Wilson 1976); ``"bbar"``, whose dilatation is the element's mean (Hughes 1980).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpubspline.analysis.moduli import MODULI, check_material, lame_moduli
from gpubspline.analysis.stiffness import FORMULATIONS
from gpubspline.errors import InputError
from gpubspline.material.orthotropy import is_orthotropic, orthotropic
from gpubspline.mesh.elements import ELEMENTS
from gpubspline.mesh.mesh import Mesh

Floats = NDArray[np.float64]

COMPONENTS = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))
"""Rows and columns of a symmetric tensor's six components: xx, yy, zz, xy, yz, xz."""


@dataclass(frozen=True, eq=False)
class GaussStress:
    """What is known at the Gauss points of m elements.

    Attributes
    ----------
    strain: (6, g, m) tensor components.
    stress: (6, g, m) MPa.
    energy: (g, m) strain energy density, N mm/mm3.
    volume: (g, m) mm3 that each point stands for.
    """

    strain: Floats
    stress: Floats
    energy: Floats
    volume: Floats


def gauss_stress(
    mesh: Mesh,
    displacement_mm: Floats,
    elements: NDArray[np.integer] | None = None,
    *,
    modulus: str = "graded",
    formulation: str = "full",
) -> GaussStress:
    """Strain and stress at the Gauss points, 2 per parameter for hex8 and 3 for hex20 and hex27, along w fastest.

    Arguments
    ---------
    mesh: hexes with the fields ``E_MPa`` and ``nu`` (see ``moduli.py``).
    displacement_mm: (n, 3) of the nodes.
    elements: (m,) numbers of the elements, all of them where None.
    modulus: ``"graded"``, E and nu interpolated by the shape functions, or ``"element"``, the means of their nodes.
    formulation: of hex8, one of ``FORMULATIONS``.

    Raises
    ------
    InputError for a mesh that is not of hexes or has no modulus, an unknown option or inverted elements.
    """
    check_options(mesh, modulus, formulation)
    element = mesh.element
    cells = mesh.cells_of(np.arange(mesh.n_elements) if elements is None else elements)
    nodes = cells.T
    at, weights = element.gauss()
    tangents = _derivatives(mesh.planes, nodes, element.gradient(at))
    cofactors, det = _cofactors(tangents)
    if not (det > 0).all():
        bad = int(np.count_nonzero((det <= 0).any(axis=0)))
        raise InputError(f"expected elements of positive volume at their Gauss points, got {bad} that are inverted")
    along = _derivatives(np.asarray(displacement_mm, dtype=np.float64).T, nodes, element.gradient(at))
    slope = np.einsum("cdgm,dlgm->clgm", along, cofactors) / det
    volume = det * weights[:, None]
    lame, shear = lame_moduli(mesh, cells, element.shape(at), modulus, elements)
    if formulation == "incompatible":
        slope = slope + _mode_slopes(tangents, det, slope, volume, lame, shear)
    strain = np.stack([(slope[c, d] + slope[d, c]) / 2 for c, d in COMPONENTS])
    if formulation == "bbar":
        dilatation = strain[:3].sum(axis=0)
        strain[:3] += ((dilatation * volume).sum(axis=0) / volume.sum(axis=0) - dilatation) / 3
    if is_orthotropic(mesh):
        stress = _components(orthotropic(mesh, elements).stress(_tensors(strain)))
    else:
        stress = 2 * shear * strain
        stress[:3] += lame * strain[:3].sum(axis=0)
    energy = (stress[:3] * strain[:3]).sum(axis=0) / 2 + (stress[3:] * strain[3:]).sum(axis=0)
    return GaussStress(strain, stress, energy, volume)


def _tensors(components: Floats) -> Floats:
    """Tensors (3, 3, ...) of six components (6, ...)."""
    tensor = np.empty((3, 3, *components.shape[1:]))
    for values, (row, column) in zip(components, COMPONENTS, strict=True):
        tensor[row, column] = tensor[column, row] = values
    return tensor


def _components(tensor: Floats) -> Floats:
    return np.stack([tensor[row, column] for row, column in COMPONENTS])


def check_options(mesh: Mesh, modulus: str, formulation: str) -> None:
    """Raise InputError where stress cannot be found on the mesh with these options."""
    if mesh.element.dimension != 3:
        raise InputError(f"expected hexes to have stress, got {mesh.element_type}")
    check_material(mesh)
    if modulus not in MODULI:
        raise InputError(f"expected a modulus of {' or '.join(MODULI)}, got {modulus!r}")
    if formulation not in FORMULATIONS:
        raise InputError(f"expected a formulation of {', '.join(FORMULATIONS)}, got {formulation!r}")
    if formulation != "full" and mesh.element_type != "hex8":
        raise InputError(f"expected hex8 for the formulation {formulation!r}, got {mesh.element_type}")


def von_mises(stress: Floats) -> Floats:
    """Von Mises stress (...) of stresses (6, ...), MPa."""
    xx, yy, zz, xy, yz, xz = stress
    squares = (xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2 + 6 * (xy**2 + yz**2 + xz**2)
    return np.asarray(np.sqrt(squares / 2))


def principal(stress: Floats) -> Floats:
    """Principal values (3, n) of stresses, or of strains with the tensor's shear, (6, n), the greatest first."""
    tensors = np.ascontiguousarray(_tensors(stress).transpose(2, 0, 1))
    return np.ascontiguousarray(np.linalg.eigvalsh(tensors).T[::-1])


def _derivatives(planes: Floats, nodes: NDArray[np.int32], gradient: Floats) -> Floats:
    """Derivatives (3, 3, g, m), component by parameter, of planes (3, n) in elements of nodes (k, m)."""
    n_points, n_nodes = gradient.shape[1:]
    flat = gradient.reshape(3 * n_points, n_nodes)
    derivatives = np.empty((len(planes), 3, n_points, nodes.shape[1]))
    for plane, out in zip(planes, derivatives, strict=True):
        values = plane[nodes].astype(np.float64)
        values -= values.mean(axis=0)  # a motion of the whole element then rounds nothing
        out[...] = (flat @ values).reshape(out.shape)
    return derivatives


def _cofactors(tangents: Floats) -> tuple[Floats, Floats]:
    """Cofactors (3, 3, ...), parameter by component, and determinant (...) of tangents (3, 3, ...)."""
    t = tangents
    rows = []
    for d in range(3):
        e, f = (d + 1) % 3, (d + 2) % 3
        rows.append([t[b, e] * t[c, f] - t[c, e] * t[b, f] for b, c in ((1, 2), (2, 0), (0, 1))])
    cofactors = np.array(rows)
    return cofactors, np.einsum("c...,c...->...", t[:, 0], cofactors[0])


def _mode_slopes(tangents: Floats, det: Floats, slope: Floats, volume: Floats, lame: Floats, shear: Floats) -> Floats:
    """What the incompatible modes of hex8 add to the displacement gradient (3, 3, g, m).

    Mode d is quadratic in parameter d alone; its gradient is the cofactors' row d at the element's centre, over the
    determinant, with the sign of the parameter. The modes carry no force: K_aa a + K_au u = 0, 9 equations an element.
    """
    centre, _ = _cofactors(tangents.mean(axis=2))
    sign = np.sign(ELEMENTS["hex8"].gauss()[0] - 0.5).T
    mode = sign[:, None, :, None] * centre[:, :, None] / det
    stress = shear * (slope + slope.swapaxes(0, 1))
    pressure = lame * np.einsum("ccgm->gm", slope)
    force = np.einsum("clgm,dlgm,gm->mcd", stress, mode, volume, optimize=True)
    force += np.einsum("gm,dcgm,gm->mcd", pressure, mode, volume, optimize=True)
    stiffness = np.einsum("gm,dcgm,fegm->mcdef", lame * volume, mode, mode, optimize=True)
    crossed = np.einsum("gm,degm,fcgm->mcdef", shear * volume, mode, mode, optimize=True)
    even = np.einsum("gm,dlgm,flgm->mdf", shear * volume, mode, mode, optimize=True)
    stiffness += crossed + even[:, None, :, None] * np.eye(3)[:, None, :, None]
    solved = np.linalg.solve(stiffness.reshape(-1, 9, 9), -force.reshape(-1, 9, 1)).reshape(-1, 3, 3)
    return np.asarray(np.einsum("mcd,dlgm->clgm", solved, mode, optimize=True))
