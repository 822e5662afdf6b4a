"""VTK's own formats, by VTK; XDMF by meshio here, and by VTK in ``test_export.py``."""

from pathlib import Path

import numpy as np

from foreign import Found, faces, load_fields, materials

SIDES = ((0, 4, 7, 3), (1, 2, 6, 5), (0, 1, 5, 4), (3, 7, 6, 2), (0, 3, 2, 1), (4, 5, 6, 7))
"""u0 to w1 of a hex by its corners."""


def read(path: Path) -> Found:
    import pyvista

    if path.suffix == ".xdmf":
        return read_xdmf(path)
    grid = pyvista.read(path).cast_to_unstructured_grid()
    (cells,) = grid.cells_dict.values()
    data = {name: np.asarray(values) for name, values in grid.field_data.items()}
    surfaces = {}
    for name, rows in data.items():
        if name.startswith("surface "):
            corners = np.take_along_axis(cells[rows[:, 0]], np.array(SIDES)[rows[:, 1]], axis=1)
            surfaces[name.removeprefix("surface ")] = faces(corners)
    fields = {name: np.asarray(values) for name, values in grid.point_data.items()}
    cell_fields = {name: np.asarray(values) for name, values in grid.cell_data.items()}
    raw = path.read_bytes()
    start = raw.find(b"Units: ")
    return Found(
        "VTK",
        np.asarray(grid.points),
        cells,
        named(data, "node_set "),
        named(data, "element_set "),
        surfaces,
        **load_fields(fields),
        **materials(fields, cell_fields),
        fields=fields,
        cell_fields=cell_fields,
        comment=raw[start : start + 200].decode("ascii", "replace"),
    )


def named(data, kind):
    return {name.removeprefix(kind): values for name, values in data.items() if name.startswith(kind)}


def read_xdmf(path: Path) -> Found:
    import meshio

    mesh = meshio.read(path)
    fields, cell_fields = dict(mesh.point_data), {name: parts[0] for name, parts in mesh.cell_data.items()}
    text = path.read_text()
    return Found(
        "meshio, VTK",
        mesh.points,
        mesh.cells[0].data,
        {name: np.flatnonzero(values) for name, values in named(fields, "node_set ").items()},
        {name: np.flatnonzero(values) for name, values in named(cell_fields, "element_set ").items()},
        **load_fields(fields),
        **materials(fields, cell_fields),
        fields=fields,
        cell_fields=cell_fields,
        comment=text[text.index("Units:") :],
    )
