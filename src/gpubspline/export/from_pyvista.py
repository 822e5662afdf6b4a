"""A mesh of a PyVista or VTK grid that is in memory."""

from typing import Any

import numpy as np

from gpubspline.errors import InputError
from gpubspline.export.density_names import without_kind
from gpubspline.export.read import scalars
from gpubspline.mesh.elements import ELEMENTS, MESHABLE
from gpubspline.mesh.mesh import Mesh


def from_pyvista(grid: Any) -> Mesh:
    """Take the hexes of a grid, or its quads where it has no hexes.

    Arguments
    ---------
    grid: a ``pyvista.UnstructuredGrid``, ``StructuredGrid``, ``ImageData`` or ``PolyData``, in mm.

    Returns
    -------
    Mesh with explicit cells, every scalar nodal and element field; fields with several components come as one field
    each, ``NAME_0`` and on. Nodes that none of the cells has stay.

    Raises
    ------
    InputError where the grid has neither hexes nor quads, or hexes of several orders.
    """
    if not hasattr(grid, "cast_to_unstructured_grid"):
        raise InputError(f"expected a grid of PyVista, got {type(grid).__name__}")
    cells = grid.cast_to_unstructured_grid()
    types = np.asarray(cells.celltypes)
    name = _element_of(set(types.tolist()))
    kept = np.flatnonzero(types == ELEMENTS[name].vtk_type)
    mesh = Mesh(
        np.asarray(cells.points),
        name,
        connectivity=np.asarray(cells.cells_dict[ELEMENTS[name].vtk_type], dtype=np.int32),
        fields=scalars({key: np.asarray(values) for key, values in cells.point_data.items()}),
        cell_fields=scalars({key: np.asarray(values)[kept] for key, values in cells.cell_data.items()}),
    )
    return without_kind(mesh)


def _element_of(types: set[int]) -> str:
    for dimension in (3, 2):
        found = [n for n in MESHABLE if ELEMENTS[n].dimension == dimension and ELEMENTS[n].vtk_type in types]
        if len(found) > 1:
            raise InputError(f"expected elements of one type, got {', '.join(found)}")
        if found:
            return found[0]
    raise InputError(f"expected hexes or quads, got VTK's cell types {', '.join(map(str, sorted(types))) or 'none'}")
