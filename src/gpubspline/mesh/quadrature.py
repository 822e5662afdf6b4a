"""Quadrature over the elements of a mesh on a device: places of the points, fields at them, means and integrals."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpubspline.device import Buffer, Device
from gpubspline.errors import InputError
from gpubspline.mesh.elements import ELEMENTS, Element
from gpubspline.mesh.mesh import Mesh

CHUNK = 1 << 19
"""Quadrature points handled at a time: their values stay near the caches of a CPU."""

CHUNK_FAST = 1 << 23
"""The same where memory is a GPU's."""

Floats = NDArray[np.float64]


def rule(element: Element, n: int) -> tuple[Floats, Floats]:
    """Points (g, d) in 0..1 and weights (g,) of Gauss and Legendre's product rule of ``n`` points per direction.

    The points run as those of ``Element.gauss`` do, along w fastest. Raises InputError for less than one point.
    """
    if n < 1:
        raise InputError(f"expected at least one quadrature point per direction, got {n}")
    at, weights = np.polynomial.legendre.leggauss(n)
    grid = np.stack(np.meshgrid(*[(at + 1) / 2] * element.dimension, indexing="ij"), axis=-1)
    product = np.prod(np.meshgrid(*[weights / 2] * element.dimension, indexing="ij"), axis=0)
    return grid.reshape(-1, element.dimension), np.asarray(product).ravel()


@dataclass(frozen=True, eq=False)
class Quadrature:
    """A rule for elements of one type, on a device.

    Attributes
    ----------
    device: where it lives.
    element: the type.
    n_points: g points of an element.
    shape: (g, k) shape functions.
    slopes: (g, k, 3) their derivatives; the third of quads is 0.
    weights: (g,).
    corners: (g, c) shape functions of the straight element on its corners.
    """

    device: Device
    element: Element
    n_points: int
    shape: Buffer
    slopes: Buffer
    weights: Buffer
    corners: Buffer

    def places(self, points: Buffer, n: int, nodes: Buffer, m: int, out: list[Buffer], volume: Buffer) -> None:
        """Write places (three of (g, m)) and volumes (g, m) of elements of ``nodes`` (k, m) on points (3, n)."""
        where = (points, n, nodes, self.element.n_nodes, m, int(self.element.dimension == 2))
        how = (self.shape, self.slopes, self.weights, self.n_points)
        self.device.launch("quadrature.places", m, *where, *how, *out, volume)

    def interpolate(self, field: Buffer, nodes: Buffer, m: int, out: Buffer) -> None:
        """Write a nodal field (n) at the points (g, m), within what it is at the element's own nodes."""
        where = (field, nodes, self.element.n_nodes, m, self.shape)
        self.device.launch("quadrature.interpolate", (self.n_points, m), *where, out)

    def means(self, values: Buffer, volume: Buffer, m: int, out: Buffer) -> None:
        """Write the means (m) of values (g, m) by volumes (g, m)."""
        self.device.launch("quadrature.means", m, values, volume, self.n_points, m, out)

    def shares(self, values: Buffer, volume: Buffer, m: int, out: Buffer) -> None:
        """Write the integrals (c, m) of values (g, m) times each corner's shape function, by volumes (g, m)."""
        sizes = (self.n_points, self.element.n_corners, m)
        self.device.launch("quadrature.shares", m, values, volume, self.corners, *sizes, out)

    def chunks(self, n_elements: int) -> Iterator[slice]:
        """Elements that are handled together."""
        size = max((CHUNK_FAST if "cuda" in self.device.name else CHUNK) // self.n_points, 8)
        for first in range(0, n_elements, size):
            yield slice(first, min(first + size, n_elements))


def quadrature(element: Element, n: int, device: Device) -> Quadrature:
    """Bring the rule of ``n`` points per direction to a device."""
    at, weights = rule(element, n)
    slopes = np.zeros((len(weights), element.n_nodes, 3))
    slopes[..., : element.dimension] = element.gradient(at).transpose(1, 2, 0)
    straight = ELEMENTS[{2: "quad4", 3: "hex8"}[element.dimension]]
    tables = (device.put(values) for values in (element.shape(at), slopes, weights, straight.shape(at)))
    return Quadrature(device, element, len(weights), *tables)


def nodes_of(mesh: Mesh, elements: slice, device: Device) -> Buffer:
    """Bring the nodes (k, m) of some elements to a device."""
    return device.put(mesh.cells_of(np.arange(elements.start, elements.stop)).T)


def integral(mesh: Mesh, field: str, device: Device, points: int | None = None) -> float:
    """Integral of a nodal field over a mesh of hexes, field times mm3; of quads times mm2.

    ``points``: per direction; as many as make it exact where None, 2 for straight and 4 for curved elements.
    """
    gauss = quadrature(mesh.element, points or 2 * mesh.element.order, device)
    planes = mesh.planes
    if planes.dtype.itemsize > device.real.itemsize:  # float32 keeps more of their digits from their middle
        planes = planes - planes.mean(axis=1)[:, None]
    points, values = device.put(planes), device.put(mesh.fields[field].astype(device.real, copy=False))
    size = next(gauss.chunks(mesh.n_elements)).stop * gauss.n_points
    *places, volume, at_points = (device.empty(size) for _ in range(5))
    total = 0.0
    for elements in gauss.chunks(mesh.n_elements):
        m, nodes = elements.stop - elements.start, nodes_of(mesh, elements, device)
        gauss.places(points, mesh.n_nodes, nodes, m, places, volume)
        gauss.interpolate(values, nodes, m, at_points)
        count = m * gauss.n_points
        total += float(np.einsum("s,s->", device.get(volume)[:count], device.get(at_points)[:count], dtype=np.float64))
    return total
