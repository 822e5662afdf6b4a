"""The elements: where their vertices sit, in VTK's order, and their shape functions.

Every vertex has lattice coordinates (a, b, c) in half steps along u, v, w: 0 and 2 are corners, 1 lies midway.

    quad4, quad8, quad9                 hex8, hex20, hex27

    3 ----6---- 2                            7 ----14--- 6
    |           |                           /|          /|
    7     8     5      v                  15 |        13 |        faces of hex27
    |           |      |                  /  19       /  18       20 u0   21 u1
    0 ----4---- 1      +-- u             4 ----12--- 5   |        22 v0   23 v1
                                         |   |       |   |        24 w0   25 w1
                                         |   3 ---10-|-- 2        26 the centre
                                         16 /        17 /
                                         | 11        | 9       w  v
                                         |/          |/        | /
                                         0 ----8---- 1         |/__ u

Source: VTK_QUAD, VTK_QUADRATIC_QUAD, VTK_BIQUADRATIC_QUAD, VTK_HEXAHEDRON, VTK_QUADRATIC_HEXAHEDRON and
VTK_TRIQUADRATIC_HEXAHEDRON of the VTK file formats. Abaqus and CalculiX number C3D8, C3D20, S4 and S8R the same way.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpubspline.errors import InputError

Floats = NDArray[np.float64]
Lattice = tuple[int, ...]

_QUAD: tuple[Lattice, ...] = ((0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1), (1, 1))
_HEX_CORNERS: tuple[Lattice, ...] = tuple((*corner, c) for c in (0, 2) for corner in _QUAD[:4])
_HEX_EDGES: tuple[Lattice, ...] = (
    *((*middle, c) for c in (0, 2) for middle in _QUAD[4:8]),
    *((*corner, 1) for corner in _QUAD[:4]),
)
_HEX_FACES: tuple[Lattice, ...] = ((0, 1, 1), (2, 1, 1), (1, 0, 1), (1, 2, 1), (1, 1, 0), (1, 1, 2), (1, 1, 1))
_HEX = _HEX_CORNERS + _HEX_EDGES + _HEX_FACES
_QUAD_SIDES: dict[str, tuple[int, ...]] = {"u0": (3, 0), "u1": (1, 2), "v0": (0, 1), "v1": (2, 3)}
_HEX_SIDES: dict[str, tuple[int, ...]] = {
    "u0": (0, 4, 7, 3),
    "u1": (1, 2, 6, 5),
    "v0": (0, 1, 5, 4),
    "v1": (3, 7, 6, 2),
    "w0": (0, 3, 2, 1),
    "w1": (4, 5, 6, 7),
}


@dataclass(frozen=True)
class Element:
    """An element type.

    Attributes
    ----------
    name: ``"quad4"`` to ``"hex27"``; the sides of those are ``"line2"`` and ``"line3"``.
    order: 1 with straight edges, 2 with a vertex midway along each edge.
    vertices: lattice coordinates of each vertex, in VTK's order.
    side_corners: the corners of each side by name, outward: quads of a hex, edges of a quad.
    side_name: element type of a side.
    vtk_type, meshio_name: what VTK and meshio call it.
    """

    name: str
    order: int
    vertices: tuple[Lattice, ...]
    side_corners: dict[str, tuple[int, ...]]
    side_name: str
    vtk_type: int
    meshio_name: str

    @property
    def dimension(self) -> int:
        """Number of parameters: 3 for a hex, 2 for a quad, 1 for a line."""
        return len(self.vertices[0])

    @property
    def n_nodes(self) -> int:
        """Number of vertices."""
        return len(self.vertices)

    @property
    def n_corners(self) -> int:
        """Number of corners, which are the first vertices."""
        return int(2**self.dimension)

    @property
    def serendipity(self) -> bool:
        """Whether the vertices inside faces and inside the element are left out (quad8, hex20)."""
        return self.n_nodes < int((self.order + 1) ** self.dimension)

    @cached_property
    def sides(self) -> dict[str, tuple[int, ...]]:
        """All vertices of each side by name, in the order of its own element type: corners, midway, centre."""
        place = {vertex: number for number, vertex in enumerate(self.vertices)}
        sides = {}
        for name, corners in self.side_corners.items():
            around = np.array([self.vertices[corner] for corner in corners])
            after = np.roll(around, -1, axis=0)
            middles = (around + after)[: 1 if len(corners) == 2 else 4] // 2
            wanted = [*corners, *(place.get(tuple(p.tolist()), -1) for p in middles)]
            if len(corners) == 4:
                wanted.append(place.get(tuple((around.sum(axis=0) // 4).tolist()), -1))
            sides[name] = tuple(vertex for vertex in wanted if vertex >= 0)
        return sides

    @cached_property
    def _exponents(self) -> NDArray[np.int64]:
        """(k, d) exponents of the monomials that the shape functions span."""
        powers = product(range(self.order + 1), repeat=self.dimension)
        return np.array([p for p in powers if not self.serendipity or p.count(2) <= 1])

    @cached_property
    def _coefficients(self) -> Floats:
        """(k, k) the monomials' coefficients of each shape function."""
        at = np.array(self.vertices, dtype=np.float64) / 2
        return np.asarray(np.linalg.inv(_monomials(at, self._exponents)))

    def shape(self, at: ArrayLike) -> Floats:
        """Shape functions (points, k) at the parameters ``at`` (points, d) in 0..1."""
        return np.asarray(_monomials(np.asarray(at, dtype=np.float64), self._exponents) @ self._coefficients)

    def gradient(self, at: ArrayLike) -> Floats:
        """Derivatives (d, points, k) of the shape functions along each parameter at ``at`` (points, d)."""
        at = np.asarray(at, dtype=np.float64)
        rows = []
        for axis in range(self.dimension):
            lowered = self._exponents.copy()
            lowered[:, axis] = np.maximum(lowered[:, axis] - 1, 0)
            rows.append(_monomials(at, lowered) * self._exponents[:, axis] @ self._coefficients)
        return np.stack(rows)

    def gauss(self) -> tuple[Floats, Floats]:
        """Points (g, d) in 0..1 and weights (g,) that integrate the element's own volume or area form exactly.

        The form has degree 2 per parameter for straight edges and 5 for curved ones: 2 or 3 points.
        """
        points, weights = np.polynomial.legendre.leggauss(self.order + 1)
        grid = np.array(list(product((points + 1) / 2, repeat=self.dimension)))
        return grid, np.array([np.prod(w) for w in product(weights / 2, repeat=self.dimension)])


def _monomials(at: Floats, exponents: NDArray[np.int64]) -> Floats:
    return np.asarray(np.prod(at[:, None, :] ** exponents[None, :, :], axis=2))


ELEMENTS = {
    element.name: element
    for element in (
        Element("line2", 1, ((0,), (2,)), {}, "", 3, "line"),
        Element("line3", 2, ((0,), (2,), (1,)), {}, "", 21, "line3"),
        Element("quad4", 1, _QUAD[:4], _QUAD_SIDES, "line2", 9, "quad"),
        Element("quad8", 2, _QUAD[:8], _QUAD_SIDES, "line3", 23, "quad8"),
        Element("quad9", 2, _QUAD, _QUAD_SIDES, "line3", 28, "quad9"),
        Element("hex8", 1, _HEX[:8], _HEX_SIDES, "quad4", 12, "hexahedron"),
        Element("hex20", 2, _HEX[:20], _HEX_SIDES, "quad8", 25, "hexahedron20"),
        Element("hex27", 2, _HEX, _HEX_SIDES, "quad9", 29, "hexahedron27"),
    )
}
MESHABLE = tuple(name for name, element in ELEMENTS.items() if element.dimension > 1)


def find_element(name: str) -> Element:
    """Element of a mesh by name.

    Raises
    ------
    InputError where there is no such element.
    """
    if name not in MESHABLE:
        raise InputError(f"expected an element type of {', '.join(MESHABLE)}, got {name!r}")
    return ELEMENTS[name]
