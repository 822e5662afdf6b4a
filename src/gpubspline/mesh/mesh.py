"""A finite element mesh whose nodes and elements carry named fields and sets."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.errors import BackendUnavailable, InputError
from gpubspline.mesh import measure, structure
from gpubspline.mesh.elements import Element, find_element
from gpubspline.shown import brief, shown

Fields = dict[str, NDArray[Any]]

_PART = 1 << 16
"""Elements of a table handed out at a time."""


@dataclass(frozen=True, eq=False)
class Mesh:
    """Nodes and elements of one type, with fields and sets by name.

    A structured mesh has no table of connectivity: it is implied by ``structure`` and spelled out when ``cells`` is
    asked for. Nodes and elements are numbered from 0, along u, then v, then w.

    Attributes
    ----------
    points: (n, 3) float32 or float64, mm, LPS, Fortran-ordered: the memory is the planes x[], y[], z[].
    element_type: ``"quad4"``, ``"quad8"``, ``"quad9"``, ``"hex8"``, ``"hex20"`` or ``"hex27"``.
    structure: corner nodes per direction (n_u, n_v[, n_w]) of a structured mesh, else None.
    connectivity: (m, k) int32 node numbers of each element in VTK's vertex order (drawn in ``elements.py``), else None.
    fields: (n,) each, values at nodes: ``HU``, ``density_g_cm3``, ``E_MPa``, ``nu``.
    cell_fields: (m,) each, values of elements: ``scaled_jacobian``, ``material``.
    node_sets: node numbers by name; a sampled mesh has its sides ``u0`` to ``w1`` and ``surface``, all of them.
    element_sets: element numbers by name; a sampled mesh has ``body``, all of them.
    density_kind: ``"apparent"``, ``"ash"`` or ``"QCT"``, what ``density_g_cm3`` is; None where it is not known.

    Raises
    ------
    InputError where shapes, node numbers or names do not fit each other.
    """

    points: NDArray[Any]
    element_type: str
    structure: tuple[int, ...] | None = None
    connectivity: NDArray[np.int32] | None = None
    fields: Fields = field(default_factory=dict)
    cell_fields: Fields = field(default_factory=dict)
    node_sets: dict[str, NDArray[Any]] = field(default_factory=dict)
    element_sets: dict[str, NDArray[Any]] = field(default_factory=dict)
    density_kind: str | None = None

    __repr__ = brief

    def __post_init__(self) -> None:
        """Check once, at the door, and bring the points into planes."""
        points = np.asarray(self.points)
        if points.ndim != 2 or points.shape[1] != 3:
            raise InputError(f"expected points of shape (n, 3), got {points.shape}")
        if points.dtype not in (np.float32, np.float64):
            points = points.astype(np.float64)
        object.__setattr__(self, "points", np.asfortranarray(points))
        self._check_elements()
        for kind, given, count in (("node", self.fields, self.n_nodes), ("element", self.cell_fields, self.n_elements)):
            for name, values in given.items():
                if np.shape(values) != (count,):
                    raise InputError(f"expected {count} values in the {kind} field {name}, got {np.shape(values)}")
        for kind, sets, count in (
            ("node", self.node_sets, self.n_nodes),
            ("element", self.element_sets, self.n_elements),
        ):
            for name, members in sets.items():
                if len(members) and not 0 <= members.min() <= members.max() < count:
                    raise InputError(f"expected numbers from 0 to {count - 1} in the {kind} set {name}")

    def _check_elements(self) -> None:
        if (self.structure is None) == (self.connectivity is None):
            raise InputError("expected either a structure or connectivity")
        if self.structure is not None:
            if len(self.structure) != self.element.dimension or min(self.structure) < 2:
                wanted = f"{self.element.dimension} counts of at least 2"
                raise InputError(f"expected {wanted} as structure of {self.element_type}, got {self.structure}")
            count = structure.count_nodes(self.element, self.structure)
            if count != self.n_nodes:
                raise InputError(f"expected {count} nodes for the structure {self.structure}, got {self.n_nodes}")
            return
        cells = np.ascontiguousarray(self.connectivity, dtype=np.int32)
        if cells.ndim != 2 or cells.shape[1] != self.element.n_nodes:
            raise InputError(f"expected cells of shape (m, {self.element.n_nodes}), got {cells.shape}")
        if cells.size and not 0 <= cells.min() <= cells.max() < self.n_nodes:
            raise InputError(f"expected node numbers from 0 to {self.n_nodes - 1}, got {cells.min()} to {cells.max()}")
        object.__setattr__(self, "connectivity", cells)

    def check_finite(self, known: str = "") -> None:
        """Raise InputError where a node is nowhere: NaN or infinity; ``known``: what the mesh is called."""
        wild = int(np.count_nonzero(~np.isfinite(self.planes).all(axis=0)))
        if wild:
            whose = f" in {known}" if known else ""
            raise InputError(
                f"expected finite coordinates{whose}, got NaN or infinity at {wild} of {self.n_nodes} nodes"
            )

    @property
    def element(self) -> Element:
        """The element type: vertices, sides, shape functions."""
        return find_element(self.element_type)

    @property
    def planes(self) -> NDArray[Any]:
        """(3, n) C-contiguous view of the points: x[], y[], z[]."""
        return np.asarray(self.points.T)

    @property
    def n_nodes(self) -> int:
        """Number of nodes."""
        return len(self.points)

    @property
    def n_elements(self) -> int:
        """Number of elements."""
        if self.structure is not None:
            return structure.count_elements(self.structure)
        return 0 if self.connectivity is None else len(self.connectivity)

    @cached_property
    def cells(self) -> NDArray[np.int32]:
        """(m, k) int32 node numbers of each element in VTK's vertex order."""
        return self.cells_of(np.arange(self.n_elements)) if self.connectivity is None else self.connectivity

    def cells_of(self, elements: NDArray[Any]) -> NDArray[np.int32]:
        """Node numbers (m, k) int32 of the given elements (m,) alone."""
        if self.connectivity is not None:
            return np.asarray(self.connectivity[elements])
        assert self.structure is not None
        return structure.cells_of(self.element, self.structure, elements)

    def cell_blocks(self) -> Iterator[tuple[int, NDArray[np.int32]]]:
        """Node numbers of all elements part by part, for files: number of the first element, and cells (m, k) int32.

        A part is only good until the next one.
        """
        if self.structure is not None:
            yield from structure.cell_blocks(self.element, self.structure)
        for first in range(0, self.n_elements if self.structure is None else 0, _PART):
            yield first, self.cells[first : first + _PART]

    def boundary(self, side: str | None = None) -> NDArray[np.int32]:
        """Outward faces of the boundary, or of one side (``"u0"`` to ``"w1"``) of a structured mesh.

        Returns
        -------
        (f, k) int32 node numbers in VTK's vertex order: quads of a hex mesh, edges of a quad mesh, of the same order as
        the elements. Faces shared by two elements are inside.

        Raises
        ------
        InputError where the side is not one that the mesh has.
        """
        return self.faces(*self.boundary_places(side))

    def faces(self, elements: NDArray[Any], sides: NDArray[Any]) -> NDArray[np.int32]:
        """Node numbers (f, k) int32 of the sides of elements (f,), by their places (f,) in ``element.sides``."""
        if self.structure is not None:
            return structure.faces_of(self.element, self.structure, elements, sides)
        return np.take_along_axis(self.cells_of(elements), np.array(list(self.element.sides.values()))[sides], axis=1)

    def boundary_nodes(self, side: str | None = None) -> NDArray[np.int32]:
        """Numbers (k,) int32, ascending, of the nodes of ``boundary``; arguments and errors as there."""
        marked = np.zeros(self.n_nodes, dtype=bool)
        if self.structure is None or side not in (None, *self.element.sides):
            marked[self.boundary(side)] = True
        else:
            for each in self.element.sides if side is None else [side]:
                marked[structure.side_nodes(self.element, self.structure, each)] = True
        return np.flatnonzero(marked).astype(np.int32)

    def boundary_places(self, side: str | None = None) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Where the faces of ``boundary`` are, in its order: element numbers (f,) and places (f,) in ``element.sides``.

        Raises
        ------
        InputError where the side is not one that the mesh has.
        """
        element = self.element
        if self.structure is not None:
            if side is not None and side not in element.sides:
                raise InputError(f"expected a side of {', '.join(element.sides)}, got {side!r}")
            names = [(place, name) for place, name in enumerate(element.sides) if side in (None, name)]
            along = [(place, structure.elements_at(self.structure, name)) for place, name in names]
            places = np.repeat([place for place, _ in along], [elements.size for _, elements in along])
            return np.concatenate([elements for _, elements in along]), places
        if side is not None:
            raise InputError(f"expected a structured mesh to have a side {side!r}, got one with explicit cells")
        faces = self.cells[:, list(element.side_corners.values())].reshape(-1, len(element.side_corners["u0"]))
        keys = np.sort(faces, axis=1).T
        order = np.lexsort(keys)
        same = np.all(keys[:, order[1:]] == keys[:, order[:-1]], axis=0)
        shared = np.concatenate([same, [False]]) | np.concatenate([[False], same])
        outer = np.sort(order[~shared])
        return outer // len(element.sides), outer % len(element.sides)

    @cached_property
    def volume_mm3(self) -> float:
        """Sum of the signed volumes of the hexes, mm3, exact for straight and for curved sides.

        Raises InputError for a mesh of quads.
        """
        if self.element.dimension != 3:
            raise InputError(f"expected hexes to have a volume, got {self.element_type}; ask for area_mm2")
        return measure.enclosed_volume_mm3(self.planes, self.boundary(), self.element.side_name)

    @cached_property
    def area_mm2(self) -> float:
        """Area of the quads, or of the surface of the hexes, mm2."""
        surface = self.element.dimension == 2
        faces, kind = (self.cells, self.element_type) if surface else (self.boundary(), self.element.side_name)
        return measure.area_vector_mm2(self.planes, faces, kind)[0]

    def with_fields(self, fields: Fields) -> "Mesh":
        """Give the same mesh with more nodal fields, (n,) each; one of the same name is replaced."""
        return replace(self, fields={**self.fields, **fields})

    def with_cell_fields(self, fields: Fields) -> "Mesh":
        """Give the same mesh with more element fields, (m,) each; one of the same name is replaced."""
        return replace(self, cell_fields={**self.cell_fields, **fields})

    def _repr_html_(self) -> str:
        return str(shown("mesh_html", self))

    def plot(self, field: str | None = None, **how: Any) -> Any:
        """Draw the mesh: a picture that a notebook shows, and whose ``save`` writes a PNG.

        Arguments
        ---------
        field: a field, or the beginning of one such as ``"E"``; von Mises stress, HU, E or the scaled Jacobian unless
            told, the first that there is.
        how: ``clip="x"``, ``edges=True``, ``view``, ``title``; see ``report.picture.draw_picture``.

        Raises
        ------
        InputError where the mesh has no such field.
        """
        return shown("picture", self, field, **how)

    def to_meshio(self) -> Any:
        """Give a ``meshio.Mesh`` with all fields and sets."""
        import meshio

        return meshio.Mesh(
            np.ascontiguousarray(self.points),
            [(self.element.meshio_name, self.cells)],
            point_data=dict(self.fields),
            cell_data={name: [values] for name, values in self.cell_fields.items()},
            point_sets=dict(self.node_sets),
            cell_sets={name: [members] for name, members in self.element_sets.items()},
        )

    def to_pyvista(self) -> Any:
        """Give a ``pyvista.UnstructuredGrid`` with all fields.

        Raises BackendUnavailable where PyVista is not installed.
        """
        try:
            import pyvista
        except ImportError:
            raise BackendUnavailable("PyVista is not installed: pip install 'gpubspline[view]'") from None
        grid = pyvista.UnstructuredGrid({self.element.vtk_type: self.cells}, np.ascontiguousarray(self.points))
        for name, values in self.fields.items():
            grid.point_data[name] = values
        for name, values in self.cell_fields.items():
            grid.cell_data[name] = values
        return grid
