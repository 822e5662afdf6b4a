"""Mass of a mesh whose nodes have a density."""

from itertools import product

import numpy as np
from numpy.typing import NDArray

from gpubspline.mesh.elements import Element
from gpubspline.mesh.mesh import Mesh

_CHUNK = 1 << 13
"""Elements integrated at a time, which bounds the memory."""

G_PER_MM3 = 1e-3
"""Of 1 g/cm3."""


def mass_g(mesh: Mesh) -> float | None:
    """Mass, g, of hexes with the nodal field ``density_g_cm3``; None of quads or without the field.

    The integral of the density that the shape functions interpolate, by Gauss points that are exact for the hexes'
    polynomials: 2 per parameter for straight sides (degree 3), 4 for curved ones (degree 7).
    """
    if mesh.element.dimension != 3 or "density_g_cm3" not in mesh.fields:
        return None
    points, weights = _gauss(mesh.element)
    shape, slopes = mesh.element.shape(points), np.concatenate(mesh.element.gradient(points))
    density, total = mesh.fields["density_g_cm3"], 0.0
    for first in range(0, mesh.n_elements, _CHUNK):
        nodes = mesh.cells_of(np.arange(first, min(first + _CHUNK, mesh.n_elements)))
        volume = _volumes(mesh.planes[:, nodes].astype(np.float64), slopes)
        total += float(np.vdot(density[nodes] @ shape.T, volume * weights))
    return G_PER_MM3 * total


def _volumes(planes: NDArray[np.float64], slopes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Determinants (m, g) of the Jacobian of elements with nodes at (3, m, k), by slopes (3 g, k) of their shapes."""
    x, y, z = (planes.reshape(-1, planes.shape[2]) @ slopes.T).reshape(3, planes.shape[1], 3, -1)
    (xu, xv, xw), (yu, yv, yw), (zu, zv, zw) = (np.moveaxis(c, 1, 0) for c in (x, y, z))
    det = xu * (yv * zw - yw * zv) + xv * (yw * zu - yu * zw) + xw * (yu * zv - yv * zu)
    return np.asarray(det)


def _gauss(element: Element) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    at, weight = np.polynomial.legendre.leggauss(2 if element.order == 1 else 4)
    grid = np.array(list(product((at + 1) / 2, repeat=3)))
    return grid, np.array([np.prod(w) for w in product(weight / 2, repeat=3)])
