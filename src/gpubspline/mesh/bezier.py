"""Each block a Bezier hyperpatch: a hex mesh as a solid of curved blocks, C0 between them, that any density samples.

Control points come from points that the blocks pass through: on the surface they are projected onto it, inside they
follow by transfinite interpolation (Gordon and Hall 1973) of edges and faces.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import count
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.errors import InputError
from gpubspline.mesh.bernstein import bernstein, from_samples, lobatto
from gpubspline.mesh.elements import find_element
from gpubspline.mesh.mesh import Mesh
from gpubspline.mesh.shared_lattice import FACES, SharedLattice
from gpubspline.mesh.sheets import OnSheet, Project, Sheet, laid_on, outer_faces, ways

Floats = NDArray[np.float64]
Put = Callable[[Floats, int, int], None]

MAX_DEGREE = 3

KEPT = 0.25
"""Of a straight hex's least determinant, over its mean one: what is certified of the curved block."""

EASED, EASINGS = 0.7, 12
"""What is left, each time, of the way of a block's outer points to the surface; after so many times none is."""

_CHUNK = 1 << 20  # samples held at a time


@dataclass(frozen=True, eq=False)
class BezierBlocks:
    """A solid of Bezier hyperpatches of one degree that share the control points of faces, edges and corners.

    Attributes
    ----------
    lattice: numbers of the blocks' control points.
    control: (n, 3) float64, mm.
    element_sets: members of each named set of blocks.
    sheets: what their faces follow.
    there: points (p,) of the lattice that went all their way to each of these.
    held_back: points that went part of their way alone, so that no block folds, and how far they stayed off:
        ``{"count": 0, "max_mm": 0.0}``.
    """

    lattice: SharedLattice
    control: Floats
    element_sets: dict[str, NDArray[np.int32]]
    sheets: tuple[Sheet, ...]
    there: tuple[NDArray[np.int64], ...]
    held_back: dict[str, float]

    @property
    def degree(self) -> int:
        """Degree along each of u, v, w."""
        return self.lattice.degree

    def block(self, number: int) -> Floats:
        """Control points (d + 1, d + 1, d + 1, 3) of one block, as ``spline.hyperpatch.bezier`` takes them."""
        return np.asarray(self.control[self.lattice.numbers[number]])

    def sample(self, density: int = 1, element_type: str = "hex8", *, exact: bool = False) -> Mesh:
        """Divide every block into ``density`` elements along each of its directions.

        Arguments
        ---------
        element_type: ``"hex8"``, ``"hex20"`` or ``"hex27"``; midway nodes lie on the blocks.
        exact: put nodes onto the sheets, where the blocks only come near; those of blocks that were held back stay on
            these.

        Returns
        -------
        Mesh of float64 points with the blocks' element sets.
        """
        element = find_element(element_type)
        if element.dimension != 3 or density < 1:
            raise InputError(f"expected hexes and a density of 1 or more, got {density} and {element_type}")
        fine = SharedLattice(self.lattice.hexes, self.lattice.n_corners, element.order * density)
        at = bernstein(self.degree, np.linspace(0, 1, fine.degree + 1))
        points = np.empty((fine.starts[-1], 3))
        points[fine.numbers] = _along_axes(at, self.control[self.lattice.numbers])
        if exact:
            points += ways(self._finer(fine), points)
        cells = np.stack([_of_vertex(fine.numbers, vertex, element.order) for vertex in element.vertices], axis=-1)
        used, renumbered = np.unique(cells, return_inverse=True)
        sets = {name: _children(blocks, density**3) for name, blocks in self.element_sets.items()}
        connectivity = renumbered.reshape(-1, element.n_nodes).astype(np.int32)
        return Mesh(points[used], element_type, connectivity=connectivity, element_sets=sets)

    def _finer(self, fine: SharedLattice) -> list[OnSheet]:
        """Points of a finer lattice that are on the sheets."""
        found, share = [], np.empty(fine.starts[-1])
        for sheet, points in zip(self.sheets, self.there, strict=True):
            there = np.zeros(len(self.control))
            there[points] = 1.0
            share[fine.numbers] = _broken_lines(self.degree, fine.degree, there[self.lattice.numbers, None])[..., 0]
            numbers, normals = laid_on(fine, self.control[: fine.n_corners], sheet.faces)
            found.append(OnSheet(numbers, normals, share[numbers], sheet.project))
        return found


def _of_vertex(numbers: NDArray[np.int64], vertex: tuple[int, ...], order: int) -> NDArray[np.int64]:
    """(m, elements of a block, u fastest) number of one vertex of the elements that divide each block."""
    for axis, half_steps in enumerate(vertex):
        first, count = half_steps * order // 2, numbers.shape[1 + axis] - 1
        numbers = np.take(numbers, np.arange(first, first + count, order), axis=1 + axis)
    return np.asarray(numbers.transpose(0, 3, 2, 1).reshape(len(numbers), -1))


def _children(blocks: NDArray[np.int32], count: int) -> NDArray[np.int32]:
    return (blocks[:, None] * count + np.arange(count)).ravel().astype(np.int32)


def bezier_blocks(
    mesh: Mesh,
    project: Project,
    degree: int = 2,
    floor: float = 0.0,
    stay: NDArray[np.int32] | None = None,
    within: Sequence[Sheet] = (),
) -> BezierBlocks:
    """Curve the hexes of a mesh so that their outer faces follow a surface, and others sheets within.

    A block's points on these go only part of the way, if need be none, where its least scaled Jacobian would fall to
    ``floor``, or its least determinant over the mean one, as its Bernstein coefficients bound it, below ``KEPT`` of the
    straight hex's.

    Arguments
    ---------
    mesh: hex8; corners on no sheet stay.
    project: onto the outer surface.
    degree: 1 to 3.
    floor: least scaled Jacobian at (3 d)^3 points of a block; blocks whose straight hex is below stay straight.
    stay: corners that are off the surface on purpose; what lies near them goes to it the less the nearer.
    within: sheets inside the mesh.

    Raises
    ------
    InputError for other elements or degrees.
    """
    if mesh.element_type != "hex8" or not 1 <= degree <= MAX_DEGREE:
        raise InputError(f"expected hex8 and a degree of 1 to {MAX_DEGREE}, got {mesh.element_type} and {degree}")
    lattice = SharedLattice(mesh.cells.astype(np.int64), mesh.n_nodes, degree)
    corners = mesh.points.astype(np.float64)
    sheets = (*within, Sheet(outer_faces(lattice), project, np.zeros(0, int) if stay is None else stay))
    held = [_on_sheet(lattice, corners, sheet) for sheet in sheets]
    share, off = np.ones(lattice.starts[-1]), np.zeros(lattice.starts[-1])

    def put(points: Floats, first: int, stop: int) -> None:
        part = slice(first, stop)
        way = ways([sheet.within(first, stop) for sheet in held], points[part])
        points[part] += share[part, None] * way
        off[part] = (1 - share[part]) * np.linalg.norm(way, axis=1)

    on_sheet = np.zeros(len(share), dtype=bool)
    on_sheet[np.concatenate([sheet.numbers for sheet in held])] = True
    curved = np.asarray(on_sheet[lattice.numbers].any(axis=(1, 2, 3)))
    kept = np.full(len(curved), -np.inf)
    kept[curved] = KEPT * _least_jacobian(_broken_lines(1, degree, corners[lattice.corners[curved]]), degree)[1]
    changed = curved
    poor = np.zeros(len(curved), dtype=bool)
    for times in count():
        control = _control(lattice, _through(lattice, corners, put))
        scaled, ratio = _least_jacobian(control[lattice.numbers[changed]], degree)
        poor[changed] = (scaled <= floor) | (ratio < kept[changed])
        eased = np.zeros(len(share), dtype=bool)
        eased[lattice.numbers[poor]] = True
        if not share[eased].any():
            break
        share[eased] *= EASED if times < EASINGS else 0.0
        changed = curved & eased[lattice.numbers].any(axis=(1, 2, 3))
    there = tuple(sheet.numbers[(sheet.share == 1) & (share[sheet.numbers] == 1)] for sheet in held)
    back = off[on_sheet & (share < 1) & (off > 0)]
    held_back = {"count": len(back), "max_mm": float(back.max(initial=0.0))}
    return BezierBlocks(lattice, control, dict(mesh.element_sets), sheets, there, held_back)


def _on_sheet(lattice: SharedLattice, corners: Floats, sheet: Sheet) -> OnSheet:
    """Points of a lattice on a sheet; the nearer they are to corners that stay, the less they go."""
    goes, share = np.ones(len(corners)), np.empty(lattice.starts[-1])
    goes[sheet.stay] = 0.0
    share[lattice.numbers] = _broken_lines(1, lattice.degree, goes[lattice.corners, None])[..., 0]
    numbers, normals = laid_on(lattice, corners, sheet.faces)
    return OnSheet(numbers, normals, share[numbers], sheet.project)


def _control(lattice: SharedLattice, through: Floats) -> Floats:
    """Control points (n, 3) of blocks that pass through points (n, 3) at even parameters."""
    to_control = np.asarray(np.linalg.inv(bernstein(lattice.degree, np.linspace(0, 1, lattice.degree + 1))))
    control = np.empty_like(through)
    control[lattice.numbers] = _along_axes(to_control, through[lattice.numbers])
    return control


def _least_jacobian(blocks: Floats, degree: int) -> tuple[Floats, Floats]:
    """Bound the Jacobian of blocks (m, d + 1, d + 1, d + 1, 3).

    Returns (m,) least scaled Jacobian at (3 d)^3 points, and the least coefficient of the determinant over its mean,
    below which it is nowhere (see ``validity``).
    """
    n = 3 * degree
    step = max(1, _CHUNK // n**3)
    at = lobatto(n - 1)
    value, slope = bernstein(degree, at), _bernstein_slope(degree, at)
    scaled, ratio = [], []
    for first in range(0, len(blocks), step):
        part = blocks[first : first + step]
        tangents = [_tensor([slope if i == axis else value for i in range(3)], part) for axis in range(3)]
        lengths = np.prod([np.linalg.norm(tangent, axis=-1) for tangent in tangents], axis=0)
        volume = np.einsum("...x,...x->...", np.cross(tangents[0], tangents[1]), tangents[2])
        scaled.append((volume / np.maximum(lengths, np.finfo(float).tiny)).min(axis=(1, 2, 3)))
        coefficients = _along_axes(from_samples(n - 1), volume[..., None])[..., 0]
        mean = np.abs(coefficients.mean(axis=(1, 2, 3), keepdims=True))  # negative where a block is inside out
        ratio.append((coefficients / np.where(mean > 0, mean, 1.0)).min(axis=(1, 2, 3)))
    return np.concatenate([np.zeros(0), *scaled]), np.concatenate([np.zeros(0), *ratio])


def _through(lattice: SharedLattice, corners: Floats, put: Put) -> Floats:
    """Points (n, 3) that the blocks pass through at even parameters: of edges, then of faces, then inside."""
    on_edges, on_faces, inside, count = lattice.starts
    d = lattice.degree
    points = np.zeros((count, 3))
    points[:on_edges] = corners
    put(points, 0, on_edges)
    low, high = points[lattice.edges[0].T]
    part = (np.arange(1, d) / d)[:, None]
    points[on_edges:on_faces] = (low[:, None] * (1 - part) + high[:, None] * part).reshape(-1, 3)
    put(points, on_edges, on_faces)
    for axis, side in FACES:
        numbers = np.take(lattice.numbers, side * d, axis=1 + axis)
        values = points[numbers]
        one, other = _between_ends(values, 1), _between_ends(values, 2)
        points[numbers[:, 1:d, 1:d]] = (one + other - _between_ends(one, 2))[:, 1:d, 1:d]
    put(points, on_faces, inside)
    values = points[lattice.numbers]
    inner = values
    for axis in (1, 2, 3):  # what three differences from the linear blends leave is nothing: the blend of all faces
        inner = inner - _between_ends(inner, axis)
    points[lattice.numbers[:, 1:d, 1:d, 1:d]] = (values - inner)[:, 1:d, 1:d, 1:d]
    return points


def _broken_lines(degree: int, fine: int, values: Floats) -> Floats:
    """Values (m, d + 1, d + 1, d + 1, c) of lattices of one degree at the points of another, linear between theirs."""
    at = np.linspace(0, degree, fine + 1)[:, None]
    return _along_axes(np.maximum(0, 1 - np.abs(at - np.arange(degree + 1))), values)


def _between_ends(values: Floats, axis: int) -> Floats:
    """Linear interpolation along an axis between its first and its last values."""
    count = values.shape[axis]
    shape = [1] * values.ndim
    shape[axis] = count
    share = np.linspace(0, 1, count).reshape(shape)
    first, last = (np.take(values, [end], axis=axis) for end in (0, -1))
    return np.asarray(first * (1 - share) + last * share)


def _bernstein_slope(degree: int, at: Floats) -> Floats:
    """(points, d + 1) derivatives of the Bernstein polynomials."""
    lower = np.pad(bernstein(degree - 1, at), ((0, 0), (1, 1)))
    return degree * (lower[:, :-1] - lower[:, 1:])


def _along_axes(matrix: NDArray[Any], values: Floats) -> Floats:
    """Apply a matrix (k, d + 1) along each of u, v, w of (m, d + 1, d + 1, d + 1, 3)."""
    return _tensor([matrix] * 3, values)


def _tensor(matrices: list[Any], values: Floats) -> Floats:
    """Apply a matrix (k, d + 1) along u, one along v and one along w of (m, d + 1, d + 1, d + 1, 3)."""
    return np.asarray(np.einsum("au,bv,cw,muvwx->mabcx", *matrices, values, optimize=True))
