"""VTK's XML unstructured grid (.vtu): binary, with every field; connectivity is spelled out part by part.

Sets and surfaces are field data; see ``sets``. Source: VTK file formats, "UnstructuredGrid".
"""

from pathlib import Path

import numpy as np

from gpubspline.export.appended import (
    FIELD_DATA,
    AppendedFile,
    Array,
    appended_file,
    field_arrays,
    set_arrays_of,
    stored_type,
)
from gpubspline.export.deck import Deck
from gpubspline.export.formats import Format
from gpubspline.export.rows import chunks
from gpubspline.export.sets import set_arrays
from gpubspline.mesh.elements import MESHABLE
from gpubspline.mesh.mesh import Mesh


def write(deck: Deck, path: Path) -> None:
    """Write all fields with the precision they have."""
    mesh = deck.with_all_fields
    n_entries = mesh.n_elements * mesh.element.n_nodes
    counting = np.dtype(np.int32 if n_entries <= np.iinfo(np.int32).max else np.int64)
    sets = set_arrays(deck)
    sections = {
        FIELD_DATA: set_arrays_of(sets),
        "PointData": field_arrays({name: values.dtype for name, values in mesh.fields.items()}, mesh.n_nodes),
        "CellData": field_arrays({name: values.dtype for name, values in mesh.cell_fields.items()}, mesh.n_elements),
        "Points": [Array("Points", stored_type(mesh.points.dtype, "Points"), mesh.n_nodes, 3)],
        "Cells": [
            Array("connectivity", stored_type(np.int32, "connectivity"), n_entries),
            Array("offsets", stored_type(counting, "offsets"), mesh.n_elements),
            Array("types", np.dtype(np.uint8), mesh.n_elements),
        ],
    }
    size = {"NumberOfPoints": str(mesh.n_nodes), "NumberOfCells": str(mesh.n_elements)}
    with appended_file(path, "UnstructuredGrid", size, sections, deck.comment_lines(100)) as file:
        for name, values in sets.items():
            file.put(FIELD_DATA, name, 0, values)
        for name, values in mesh.fields.items():
            file.put("PointData", name, 0, values)
        for name, values in mesh.cell_fields.items():
            file.put("CellData", name, 0, values)
        file.put_planes("Points", "Points", 0, mesh.planes)
        _write_cells(file, mesh, counting)


def _write_cells(file: AppendedFile, mesh: Mesh, counting: np.dtype[np.int32 | np.int64]) -> None:
    n_nodes = mesh.element.n_nodes
    for first, cells in mesh.cell_blocks():
        file.put("Cells", "connectivity", n_nodes * first, cells)
    for rows in chunks(mesh.n_elements):
        offsets = np.arange(n_nodes * (rows.start + 1), n_nodes * rows.stop + 1, n_nodes, dtype=counting)
        file.put("Cells", "offsets", rows.start, offsets)
        file.put("Cells", "types", rows.start, np.full(offsets.size, mesh.element.vtk_type, dtype=np.uint8))


FORMATS = (
    Format("vtu", (".vtu",), MESHABLE, write, nodal="field", loads=True, sets=True, fields=True, cell_fields=True),
)
