"""Material of nodes that keeps the integral of what is in the CT: each node has the mean of what lies round it.

Of a field f at quadrature points node i gets

    f_i = integral of N_i f / integral of N_i,

N_i the linear shape function of its corner: the projection of least squares onto the nodes with its mass matrix lumped.
Interpolated between the nodes f_i has the integral of f over the mesh, whatever the size of the elements, since the N_i
sum to 1, and is nowhere above or below f, since they are positive. The price is that of any mean: peaks narrower than
an element are spread over it. Nodes of order 2 that are no corners lie on the interpolation between these, of which the
element's own shape functions make the same.

Two orders are possible, as by element (``integration.py``): the law of the mean HU (``nodal-hu``) or the mean of the
law (``nodal-e``). The second keeps the mass exactly, the first as far as the density is a line of HU.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.ct.partial_volume import Folding
from gpubspline.ct.sampler import Sampler
from gpubspline.device import Device
from gpubspline.material.inset import Inset
from gpubspline.material.integration import AtPoints
from gpubspline.material.mapping import LawOnDevice
from gpubspline.mesh.elements import ELEMENTS
from gpubspline.mesh.mesh import Mesh
from gpubspline.mesh.quadrature import quadrature

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Projected:
    """Means round nodes.

    Attributes
    ----------
    hu, density_g_cm3, modulus_mpa, poisson: (n,) float64; 0 at nodes of no element.
    points, points_outside: quadrature points, and how many of them had HU that no range of the law covers.
    """

    hu: Floats
    density_g_cm3: Floats
    modulus_mpa: Floats
    poisson: Floats
    points: int
    points_outside: int


def project(
    mesh: Mesh,
    law: LawOnDevice,
    *,
    sampler: Sampler | None = None,
    inset: Inset | None = None,
    fold: Folding | None = None,
    points: int = 2,
    device: Device,
) -> Projected:
    """Project HU and a law onto the nodes of a mesh; arguments as of ``integrate``."""
    rule = quadrature(mesh.element, points, device)
    work, corners = AtPoints(mesh, law, rule, sampler, inset, fold), mesh.element.n_corners
    one = device.put(np.ones(work.most * rule.n_points, device.real))
    out, outside = device.empty(work.most * corners), 0
    sums = np.zeros((5, mesh.n_nodes))
    for elements in rule.chunks(mesh.n_elements):
        m = work.read(elements)
        nodes = mesh.cells_of(np.arange(elements.start, elements.stop))[:, :corners].T.ravel()
        for total, values in zip(sums, (one, work.hu, work.density, work.modulus, work.poisson), strict=True):
            rule.shares(values, work.volume, m, out)
            total += np.bincount(nodes, device.get(out)[: corners * m], mesh.n_nodes)
        outside += int(np.count_nonzero(work.see(work.piece, m) < 0))
    means = sums[1:] / np.where(sums[0] > 0, sums[0], 1.0)
    if mesh.element.order > 1:
        _fill(mesh, means)
    hu, density, modulus, poisson = means
    return Projected(hu, density, modulus, poisson, rule.n_points * mesh.n_elements, outside)


def _fill(mesh: Mesh, means: NDArray[Any]) -> None:
    """Interpolate means (f, n) from the corners of each element to its other nodes."""
    straight = ELEMENTS[{2: "quad4", 3: "hex8"}[mesh.element.dimension]]
    shape = straight.shape(np.array(mesh.element.vertices) / 2)[straight.n_nodes :]
    for first in range(0, mesh.n_elements, 1 << 16):
        cells = mesh.cells_of(np.arange(first, min(first + (1 << 16), mesh.n_elements)))
        corners, others = cells[:, : straight.n_nodes], cells[:, straight.n_nodes :]
        for values in means:
            values[others] = values[corners] @ shape.T
