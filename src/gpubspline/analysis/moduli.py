"""The material of elements at their quadrature points, from wherever the mesh carries it.

From what is finest: element fields at the Gauss points (``E_MPa_1`` and on, of the mapping ``gauss``), nodal fields,
element fields (``E_MPa`` of the mappings ``element-hu`` and ``element-e``).
"""

import numpy as np
from numpy.typing import NDArray

from gpubspline.errors import InputError
from gpubspline.mesh.mesh import Mesh

MODULI = ("graded", "element")
"""Material that varies within an element, as far as the mesh tells, or one throughout."""

Floats = NDArray[np.float64]


def check_material(mesh: Mesh) -> None:
    """Raise InputError where a mesh has no modulus or Poisson's ratio, or impossible ones."""
    for name in ("E_MPa", "nu"):
        if name not in mesh.fields and name not in mesh.cell_fields:
            raise InputError(f"expected the fields E_MPa and nu, got a mesh without {name}")
    modulus, nu = (_all_values(mesh, name) for name in ("E_MPa", "nu"))
    if not (modulus.min() > 0 and np.all(np.isfinite(modulus))):
        raise InputError(f"expected positive moduli, got a least of {modulus.min():g} MPa")
    if not (nu.min() > -1 and nu.max() < 0.5):
        raise InputError(f"expected Poisson's ratios above -1 and below 0.5, got {nu.min():g} to {nu.max():g}")


def lame_moduli(
    mesh: Mesh, cells: NDArray[np.int32], shape: Floats, modulus: str, elements: NDArray[np.integer] | None = None
) -> tuple[Floats, Floats]:
    """Lame's lambda and mu, MPa, (points, m) each, of elements of nodes ``cells`` (m, k).

    Arguments
    ---------
    shape: (points, k) shape functions at the points; those of the element's own quadrature where the mesh has element
        fields at Gauss points.
    modulus: of ``MODULI``.
    elements: (m,) numbers of the elements, all of them in order where None.
    """
    e, nu = (values_at(mesh, name, cells, shape, modulus, elements) for name in ("E_MPa", "nu"))
    return e * nu / ((1 + nu) * (1 - 2 * nu)), e / (2 * (1 + nu))


def values_at(
    mesh: Mesh,
    name: str,
    cells: NDArray[np.int32],
    shape: Floats,
    modulus: str = "graded",
    elements: NDArray[np.integer] | None = None,
) -> Floats:
    """A field (points, m) of the material; arguments as of ``lame_moduli``.

    Shape functions of curved elements overshoot between a stiff and a soft node, to below 0 in CT: values interpolated
    from nodes stay within those of the element's own.
    """
    chosen = slice(None) if elements is None else elements
    gauss = [f"{name}_{number}" for number in range(1, len(shape) + 1)]
    if gauss[-1] in mesh.cell_fields and modulus == "graded":
        return np.stack([np.asarray(mesh.cell_fields[field][chosen], dtype=np.float64) for field in gauss])
    if name not in mesh.fields:
        own = np.asarray(mesh.cell_fields[name][chosen], dtype=np.float64)
        return np.tile(own, (len(shape), 1))
    nodal = np.asarray(mesh.fields[name], dtype=np.float64)[cells]
    if modulus == "element":
        nodal[:] = nodal.mean(axis=1, keepdims=True)
    return np.asarray(np.clip(shape @ nodal.T, nodal.min(axis=1), nodal.max(axis=1)))


def _all_values(mesh: Mesh, name: str) -> Floats:
    """Every value of a field of the material that may be used."""
    found = [values for field, values in mesh.cell_fields.items() if field == name or _is_gauss(field, name)]
    found += [mesh.fields[name]] if name in mesh.fields else []
    return np.concatenate([np.asarray(values, dtype=np.float64) for values in found])


def _is_gauss(field: str, name: str) -> bool:
    start, _, number = field.rpartition("_")
    return start == name and number.isdigit()
