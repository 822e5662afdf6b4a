"""VTK's HDF5 file of an unstructured grid (.vtkhdf): binary, with every field; connectivity is written part by part.

Sets and surfaces are field data; see ``sets``. Source: VTKHDF format specification, "UnstructuredGrid".
"""

from pathlib import Path
from typing import Any

import numpy as np

from gpubspline.export.deck import Deck
from gpubspline.export.formats import Format
from gpubspline.export.read_appended import StoredGrid
from gpubspline.export.rows import chunks
from gpubspline.export.sets import set_arrays
from gpubspline.files import whole_file
from gpubspline.mesh.elements import MESHABLE
from gpubspline.mesh.mesh import Mesh

_TIMES = 4
"""Chunks written at once: h5py takes a tenth of a millisecond for each."""


def write(deck: Deck, path: Path) -> None:
    """Write all fields with the precision they have."""
    import h5py

    mesh = deck.with_all_fields
    with whole_file(path) as temporary, h5py.File(temporary, "w") as file:
        file.attrs["comment"] = "\n".join(deck.comments)
        group = file.create_group("VTKHDF")
        group.attrs["Version"] = (1, 0)
        group.attrs["Type"] = np.bytes_("UnstructuredGrid")
        points = group.create_dataset("Points", (mesh.n_nodes, 3), mesh.points.dtype)
        for rows in chunks(mesh.n_nodes, _TIMES):
            points[rows] = np.ascontiguousarray(mesh.points[rows])
        _write_cells(group, mesh)
        for section, fields in (("PointData", mesh.fields), ("CellData", mesh.cell_fields)):
            data = group.create_group(section)
            for name, values in fields.items():
                data[name.replace("/", "_")] = values  # a slash would make a group
        data = group.create_group("FieldData")
        for name, values in set_arrays(deck).items():
            data[name] = values


def _write_cells(group: Any, mesh: Mesh) -> None:
    n_nodes, n_entries = mesh.element.n_nodes, mesh.n_elements * mesh.element.n_nodes
    counting = np.int32 if n_entries <= np.iinfo(np.int32).max else np.int64  # one type for both, or VTK copies them
    for name, count in (("Points", mesh.n_nodes), ("Cells", mesh.n_elements), ("ConnectivityIds", n_entries)):
        group[f"NumberOf{name}"] = np.array([count], dtype=np.int64)
    connectivity = group.create_dataset("Connectivity", n_entries, counting)
    offsets = group.create_dataset("Offsets", mesh.n_elements + 1, counting)
    types = group.create_dataset("Types", mesh.n_elements, np.uint8)
    for first, cells in mesh.cell_blocks():
        connectivity[n_nodes * first : n_nodes * (first + len(cells))] = cells.astype(counting, copy=False).ravel()
    for rows in chunks(mesh.n_elements, _TIMES):
        ends = np.arange(n_nodes * (rows.start + 1), n_nodes * rows.stop + 1, n_nodes, dtype=counting)
        offsets[rows.start + 1 : rows.stop + 1] = ends
        types[rows] = np.full(ends.size, mesh.element.vtk_type, dtype=np.uint8)


def read(path: Path) -> StoredGrid:
    """Read an unstructured grid in one piece.

    Raises
    ------
    KeyError, OSError or ValueError where the file is of another kind or broken.
    """
    import h5py

    with h5py.File(path, "r") as file:
        group = file["VTKHDF"]
        if group.attrs["Type"] != b"UnstructuredGrid" or len(group["NumberOfPoints"]) != 1:
            raise ValueError("not an unstructured grid in one piece")
        fields = {
            section: {name: values[:] for name, values in group.get(section, {}).items()}
            for section in ("FieldData", "PointData", "CellData")
        }
        cells = {"connectivity": group["Connectivity"][:], "types": group["Types"][:]}
        return StoredGrid("UnstructuredGrid", {}, {**fields, "Points": {"Points": group["Points"][:]}, "Cells": cells})


FORMATS = (
    Format(
        "vtkhdf",
        (".vtkhdf",),
        MESHABLE,
        write,
        nodal="field",
        loads=True,
        sets=True,
        fields=True,
        cell_fields=True,
        needs="h5py",
    ),
)
