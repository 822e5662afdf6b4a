"""Each block a Bezier hyperpatch: a hex mesh as a solid of curved blocks, C0 between them, that any density samples.

Control points come from points that the blocks pass through: on the surface they are projected onto it, inside they
follow by transfinite interpolation (Gordon and Hall 1973) of edges and faces.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import comb
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.errors import InputError
from gpubspline.mesh.elements import find_element
from gpubspline.mesh.mesh import Mesh
from gpubspline.mesh.shared_lattice import FACES, SharedLattice

Floats = NDArray[np.float64]
Project = Callable[[Floats], Floats]
"""Moves points (n, 3), mm, near a surface onto it."""

MAX_DEGREE = 3


@dataclass(frozen=True, eq=False)
class BezierBlocks:
    """A solid of Bezier hyperpatches of one degree that share the control points of faces, edges and corners.

    Attributes
    ----------
    lattice: numbers of the blocks' control points.
    control: (n, 3) float64, mm.
    element_sets: members of each named set of blocks.
    """

    lattice: SharedLattice
    control: Floats
    element_sets: dict[str, NDArray[np.int32]]

    @property
    def degree(self) -> int:
        """Degree along each of u, v, w."""
        return self.lattice.degree

    def block(self, number: int) -> Floats:
        """Control points (d + 1, d + 1, d + 1, 3) of one block, as ``spline.hyperpatch.bezier`` takes them."""
        return np.asarray(self.control[self.lattice.numbers[number]])

    def sample(self, density: int = 1, element_type: str = "hex8", project: Project | None = None) -> Mesh:
        """Divide every block into ``density`` elements along each of its directions.

        Arguments
        ---------
        element_type: ``"hex8"``, ``"hex20"`` or ``"hex27"``; midway nodes lie on the blocks.
        project: puts the nodes of the surface onto it, where the blocks only come near; None leaves them.

        Returns
        -------
        Mesh of float64 points with the blocks' element sets.
        """
        element = find_element(element_type)
        if element.dimension != 3 or density < 1:
            raise InputError(f"expected hexes and a density of 1 or more, got {density} and {element_type}")
        fine = SharedLattice(self.lattice.hexes, self.lattice.n_corners, element.order * density)
        at = _bernstein(self.degree, np.linspace(0, 1, fine.degree + 1))
        points = np.empty((fine.starts[-1], 3))
        points[fine.numbers] = _along_axes(at, self.control[self.lattice.numbers])
        if project is not None:
            points[fine.on_boundary] = project(points[fine.on_boundary])
        cells = np.stack([_of_vertex(fine.numbers, vertex, element.order) for vertex in element.vertices], axis=-1)
        used, renumbered = np.unique(cells, return_inverse=True)
        sets = {name: _children(blocks, density**3) for name, blocks in self.element_sets.items()}
        connectivity = renumbered.reshape(-1, element.n_nodes).astype(np.int32)
        return Mesh(points[used], element_type, connectivity=connectivity, element_sets=sets)


def _of_vertex(numbers: NDArray[np.int64], vertex: tuple[int, ...], order: int) -> NDArray[np.int64]:
    """(m, elements of a block, u fastest) number of one vertex of the elements that divide each block."""
    for axis, half_steps in enumerate(vertex):
        first, count = half_steps * order // 2, numbers.shape[1 + axis] - 1
        numbers = np.take(numbers, np.arange(first, first + count, order), axis=1 + axis)
    return np.asarray(numbers.transpose(0, 3, 2, 1).reshape(len(numbers), -1))


def _children(blocks: NDArray[np.int32], count: int) -> NDArray[np.int32]:
    return (blocks[:, None] * count + np.arange(count)).ravel().astype(np.int32)


def bezier_blocks(mesh: Mesh, project: Project, degree: int = 2) -> BezierBlocks:
    """Curve the hexes of a mesh so that their outer faces follow a surface.

    Arguments
    ---------
    mesh: hex8; its corners stay.
    project: onto the surface.
    degree: 1 to 3.

    Raises
    ------
    InputError for other elements or degrees.
    """
    if mesh.element_type != "hex8" or not 1 <= degree <= MAX_DEGREE:
        raise InputError(f"expected hex8 and a degree of 1 to {MAX_DEGREE}, got {mesh.element_type} and {degree}")
    lattice = SharedLattice(mesh.cells.astype(np.int64), mesh.n_nodes, degree)
    through = _through(lattice, mesh.points.astype(np.float64), project)
    at = np.linspace(0, 1, degree + 1)
    control = np.empty_like(through)
    control[lattice.numbers] = _along_axes(np.asarray(np.linalg.inv(_bernstein(degree, at))), through[lattice.numbers])
    return BezierBlocks(lattice, control, dict(mesh.element_sets))


def _through(lattice: SharedLattice, corners: Floats, project: Project) -> Floats:
    """Points (n, 3) that the blocks pass through at even parameters: of edges, then of faces, then inside."""
    on_edges, on_faces, inside, count = lattice.starts
    d, outer = lattice.degree, lattice.on_boundary
    points = np.zeros((count, 3))
    points[:on_edges] = corners
    low, high = corners[lattice.edges[0].T]
    share = (np.arange(1, d) / d)[:, None]
    points[on_edges:on_faces] = (low[:, None] * (1 - share) + high[:, None] * share).reshape(-1, 3)
    _put_on(points, project, np.flatnonzero(outer[:on_faces]), skip=on_edges)
    for axis, side in FACES:
        numbers = np.take(lattice.numbers, side * d, axis=1 + axis)
        values = points[numbers]
        one, other = _between_ends(values, 1), _between_ends(values, 2)
        points[numbers[:, 1:d, 1:d]] = (one + other - _between_ends(one, 2))[:, 1:d, 1:d]
    _put_on(points, project, np.flatnonzero(outer[:inside]), skip=on_faces)
    values = points[lattice.numbers]
    inner = values
    for axis in (1, 2, 3):  # what three differences from the linear blends leave is nothing: the blend of all faces
        inner = inner - _between_ends(inner, axis)
    points[lattice.numbers[:, 1:d, 1:d, 1:d]] = (values - inner)[:, 1:d, 1:d, 1:d]
    return points


def _put_on(points: Floats, project: Project, numbers: NDArray[np.int64], skip: int) -> None:
    chosen = numbers[numbers >= skip]
    if chosen.size:
        points[chosen] = project(points[chosen])


def _between_ends(values: Floats, axis: int) -> Floats:
    """Linear interpolation along an axis between its first and its last values."""
    count = values.shape[axis]
    shape = [1] * values.ndim
    shape[axis] = count
    share = np.linspace(0, 1, count).reshape(shape)
    first, last = (np.take(values, [end], axis=axis) for end in (0, -1))
    return np.asarray(first * (1 - share) + last * share)


def _bernstein(degree: int, at: Floats) -> Floats:
    """(points, d + 1) Bernstein polynomials."""
    return np.stack([comb(degree, i) * at**i * (1 - at) ** (degree - i) for i in range(degree + 1)], axis=1)


def _along_axes(matrix: NDArray[Any], values: Floats) -> Floats:
    """Apply a matrix (k, d + 1) along each of u, v, w of (m, d + 1, d + 1, d + 1, 3)."""
    return np.asarray(np.einsum("au,bv,cw,muvwx->mabcx", matrix, matrix, matrix, values, optimize=True))
