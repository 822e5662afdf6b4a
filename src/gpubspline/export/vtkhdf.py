"""VTK's HDF5 file of an unstructured grid (.vtkhdf): binary, with every field.

Sets and surfaces are field data; see ``sets``. Source: VTKHDF format specification, "UnstructuredGrid".
"""

from pathlib import Path
from typing import Any

import numpy as np

from gpubspline.export import unstructured
from gpubspline.export.deck import Deck
from gpubspline.export.formats import Format
from gpubspline.export.placed import Key, PlacedArrays, Sections, by_key
from gpubspline.export.read_appended import StoredGrid
from gpubspline.export.sets import set_arrays
from gpubspline.files import check_space, reserve, whole_file
from gpubspline.mesh.elements import MESHABLE

_AT_THE_TOP = {"Points": "Points", "connectivity": "Connectivity", "offsets": "Offsets", "types": "Types"}
"""Names of what belongs to no section here."""


def write(deck: Deck, path: Path) -> None:
    """Write all fields with the precision they have: HDF5 lays out the file, and plain writing fills it."""
    mesh = deck.with_all_fields
    sections = unstructured.sections(mesh, unstructured.counting_type(mesh), first_offset=True)
    arrays = by_key(sections)
    check_space(path, sum(array.n_bytes for array in arrays.values()))
    with whole_file(path) as temporary:
        starts = _lay_out(deck, sections, temporary)
        with open(temporary, "r+b") as stream:
            reserve(stream, temporary.stat().st_size)
            unstructured.fill(PlacedArrays(stream, arrays, starts), mesh, first_offset=True)


def _lay_out(deck: Deck, sections: Sections, path: Path) -> dict[Key, int]:
    """Make a file in which only the sets and the counts are written; where each array of the sections begins, bytes."""
    import h5py

    early = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    early.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
    early.set_fill_time(h5py.h5d.FILL_TIME_NEVER)
    starts = {}
    with h5py.File(path, "w") as file:
        file.attrs["comment"] = "\n".join(deck.comments)
        group = file.create_group("VTKHDF")
        _describe(group, deck)
        for section, arrays in sections.items():
            data = group.create_group(section) if section.endswith("Data") else group
            for array in arrays:
                name = _AT_THE_TOP[array.name] if data is group else array.name.replace("/", "_")  # which makes a group
                shape = (array.n_rows, *((array.n_components,) if array.n_components > 1 else ()))
                made = data.create_dataset(name, shape, array.dtype, dcpl=early)
                starts[section, array.name] = made.id.get_offset() or 0  # none of an array without rows
    return starts


def _describe(group: Any, deck: Deck) -> None:
    mesh = deck.mesh
    group.attrs["Version"] = (1, 0)
    group.attrs["Type"] = np.bytes_("UnstructuredGrid")
    counts = {"Points": mesh.n_nodes, "Cells": mesh.n_elements}
    for name, count in {**counts, "ConnectivityIds": mesh.n_elements * mesh.element.n_nodes}.items():
        group[f"NumberOf{name}"] = np.array([count], dtype=np.int64)
    data = group.create_group("FieldData")
    for name, values in set_arrays(deck).items():
        data[name] = values


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
