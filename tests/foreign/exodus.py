"""Exodus: netCDF4 reads every variable; the order of vertices and the fields are checked with VTK elsewhere."""

from pathlib import Path

import numpy as np

from foreign import Found, load_fields, materials

ORDER = {8: range(8), 20: (*range(12), 16, 17, 18, 19, 12, 13, 14, 15)}
SIDES = {1: (0, 1, 5, 4), 2: (1, 2, 6, 5), 3: (2, 3, 7, 6), 4: (0, 4, 7, 3), 5: (0, 3, 2, 1), 6: (4, 5, 6, 7)}
"""Figure of HEX in the Exodus II manual."""


def read(path: Path) -> Found:
    import netCDF4

    with netCDF4.Dataset(path) as file:
        file.set_auto_mask(False)

        def texts(name):
            table = file[name][:] if name in file.variables else ()
            return [b"".join(row).split(b"\0")[0].decode() for row in table]

        points = np.stack([file[f"coord{axis}"][:] for axis in "xyz"], axis=1)
        blocks = [file[f"connect{n}"][:] - 1 for n in range(1, 1 + len(texts("eb_names")))]
        stacked = np.concatenate(blocks)[:, ORDER[blocks[0].shape[1]]]
        label = file["elem_num_map"][:] - 1
        cells = np.empty_like(stacked)
        cells[label] = stacked
        ends = np.cumsum([0, *map(len, blocks)])
        sets = {name: file[f"node_ns{n}"][:] - 1 for n, name in enumerate(texts("ns_names"), start=1)}
        elements = {name: label[a:b] for name, a, b in zip(texts("eb_names"), ends[:-1], ends[1:], strict=True)}
        elements |= {name: label[file[f"elem_els{n}"][:] - 1] for n, name in enumerate(texts("els_names"), start=1)}
        surfaces = {}
        for n, name in enumerate(texts("ss_names"), start=1):
            of = zip(stacked[file[f"elem_ss{n}"][:] - 1], file[f"side_ss{n}"][:], strict=True)
            surfaces[name] = {frozenset(cell[list(SIDES[side])].tolist()) for cell, side in of}
        fields = {name: file[f"vals_nod_var{n}"][0] for n, name in enumerate(texts("name_nod_var"), start=1)}
        cell_fields = {}
        for n, name in enumerate(texts("name_elem_var"), start=1):
            values = np.concatenate([file[f"vals_elem_var{n}eb{b}"][0] for b in range(1, 1 + len(blocks))])
            cell_fields[name] = np.empty_like(values)
            cell_fields[name][label] = values
        comment = " ".join(texts("info_records"))
    known = {**load_fields(fields), **materials(fields, cell_fields)}
    return Found(
        "netCDF4, VTK",
        points,
        cells,
        sets,
        elements,
        surfaces,
        **known,
        fields=fields,
        cell_fields=cell_fields,
        comment=comment,
    )
