"""What VTK's unstructured grids are made of, as XML and as HDF5; connectivity is spelled out part by part."""

import numpy as np

from gpubspline.export.placed import Array, PlacedArrays, field_arrays, stored_type
from gpubspline.export.rows import chunks
from gpubspline.mesh.mesh import Mesh

CELLS = "Cells"


def counting_type(mesh: Mesh) -> np.dtype[np.int32 | np.int64]:
    """Type of numbers up to the length of the connectivity."""
    large = mesh.n_elements * mesh.element.n_nodes > np.iinfo(np.int32).max
    return np.dtype(np.int64 if large else np.int32)


def sections(mesh: Mesh, connectivity: np.dtype[np.int32 | np.int64], first_offset: bool) -> dict[str, list[Array]]:
    """Arrays of fields, points and cells; offsets begin with that of the first element, zero, where it is wanted."""
    return {
        "PointData": field_arrays({name: values.dtype for name, values in mesh.fields.items()}, mesh.n_nodes),
        "CellData": field_arrays({name: values.dtype for name, values in mesh.cell_fields.items()}, mesh.n_elements),
        "Points": [Array("Points", stored_type(mesh.points.dtype, "Points"), mesh.n_nodes, 3)],
        CELLS: [
            Array("connectivity", stored_type(connectivity, "connectivity"), mesh.n_elements * mesh.element.n_nodes),
            Array("offsets", stored_type(counting_type(mesh), "offsets"), mesh.n_elements + first_offset),
            Array("types", np.dtype(np.uint8), mesh.n_elements),
        ],
    }


def fill(file: PlacedArrays, mesh: Mesh, first_offset: bool) -> None:
    """Write the arrays of ``sections``."""
    for section, fields in (("PointData", mesh.fields), ("CellData", mesh.cell_fields)):
        for name, values in fields.items():
            file.put(section, name, 0, values)
    file.put_planes("Points", "Points", 0, mesh.planes)
    n_nodes, counting = mesh.element.n_nodes, counting_type(mesh)
    for first, cells in mesh.cell_blocks():
        file.put(CELLS, "connectivity", n_nodes * first, cells)
    if first_offset:
        file.put(CELLS, "offsets", 0, np.zeros(1, dtype=counting))
    for rows in chunks(mesh.n_elements):
        offsets = np.arange(n_nodes * (rows.start + 1), n_nodes * rows.stop + 1, n_nodes, dtype=counting)
        file.put(CELLS, "offsets", rows.start + first_offset, offsets)
        file.put(CELLS, "types", rows.start, np.full(offsets.size, mesh.element.vtk_type, dtype=np.uint8))
