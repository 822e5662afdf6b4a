"""Gmsh's format: meshio. Gmsh itself, which is under the GPL, was run on these files by hand, not in the tests."""

from pathlib import Path

import numpy as np

from foreign import Found, faces, load_fields, materials


def read(path: Path) -> Found:
    import meshio

    mesh = meshio.read(path)
    ends = np.cumsum([0, *(len(block.data) for block in mesh.cells)])
    kinds = np.concatenate([[block.dim] * len(block.data) for block in mesh.cells])
    rows = [row for block in mesh.cells for row in block.data]
    solid = np.flatnonzero(kinds == 3)
    by_name = {name: np.concatenate([np.asarray(m, dtype=int) + s for m, s in zip(members, ends[:-1], strict=True)])
               for name, members in mesh.cell_sets.items() if name in mesh.field_data}  # fmt: skip
    label = labels(path)
    cells = np.empty((len(solid), len(rows[solid[0]])), dtype=int)
    cells[label[solid]] = np.array([rows[i] for i in solid])
    of = {name: (mesh.field_data[name][1], members) for name, members in by_name.items()}
    fields = {name: values for name, values in mesh.point_data.items() if not name.startswith("gmsh:")}
    cell_fields = {}
    for name, parts in mesh.cell_data.items():
        if not name.startswith("gmsh:"):
            cell_fields[name] = np.empty(len(solid))
            cell_fields[name][label[solid]] = np.concatenate(parts).ravel()[solid]
    text = path.read_text()
    return Found(
        "meshio; Gmsh",
        mesh.points,
        cells,
        {name.removesuffix("_nodes"): np.array([rows[i][0] for i in m]) for name, (d, m) in of.items() if d == 0},
        {name: label[members] for name, (d, members) in of.items() if d == 3},
        {name: faces([rows[i] for i in members]) for name, (d, members) in of.items() if d == 2},
        **load_fields(fields),
        **materials(fields, cell_fields),
        fields=fields,
        cell_fields=cell_fields,
        comment=text[: text.index("$EndComments")],
    )


def labels(path: Path) -> np.ndarray:
    """Labels of the elements, from 0, in the order of the file; meshio leaves them out."""
    lines = path.read_text().split("$Elements\n")[1].splitlines()
    found, at = [], 1
    for _ in range(int(lines[0].split()[0])):
        count = int(lines[at].split()[3])
        found += [int(line.split()[0]) - 1 for line in lines[at + 1 : at + 1 + count]]
        at += 1 + count
    return np.array(found)
