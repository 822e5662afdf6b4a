"""MED: MEDCoupling, by the MED library itself; the units in the file's own attribute by h5py.

MEDCoupling reads in a process of its own: its HDF5 library does not get on with those of h5py and netCDF4.
"""

import pickle
import subprocess
import sys
from pathlib import Path

VTK = {8: (0, 3, 2, 1, 4, 7, 6, 5), 20: (0, 3, 2, 1, 4, 7, 6, 5, 11, 10, 9, 8, 15, 14, 13, 12, 16, 19, 18, 17)}
"""Vertices of VTK in MED's numbers; the corners are their own inverse, the midpoints are checked by where they lie."""


def read(path: Path):
    import h5py

    from foreign import Found, faces, load_fields, materials

    done = subprocess.run([sys.executable, __file__, str(path)], capture_output=True, timeout=300)
    assert done.returncode == 0, done.stderr.decode()[-2000:]
    plain = pickle.loads(done.stdout)
    fields, cell_fields, groups = plain["fields"], plain["cell_fields"], plain["groups"]
    with h5py.File(path) as raw:
        comment = raw.attrs["COMMENT"].decode()
    return Found(
        "MEDCoupling",
        plain["points"],
        plain["cells"],
        groups[1],
        groups[0],
        {name: faces(plain["outer"][members]) for name, members in groups[-1].items()},
        **load_fields(fields),
        **materials(fields, cell_fields),
        fields=fields,
        cell_fields=cell_fields,
        comment=comment,
    )


def plain(path: str) -> dict:
    """What MEDCoupling reads, as arrays; it uses no other code of this project."""
    import medcoupling as mc

    file = mc.MEDFileUMesh(path)
    solid = file.getMeshAtLevel(0)
    assert (solid.getMeasureField(False).getArray().toNumPyArray() > 0).all()
    cells = connectivity(solid)
    groups = {
        level: {name: file.getGroupArr(level, name).toNumPyArray() for name in names(file, level)}
        for level in (0, -1, 1)
    }
    fields, cell_fields = {}, {}
    for name in mc.GetAllFieldNames(path):
        kinds = mc.GetTypesOfField(path, "mesh", name)
        values = mc.ReadField(kinds[0], path, "mesh", 0, name, 1, -1).getArray().toNumPyArray()
        (fields if kinds[0] == mc.ON_NODES else cell_fields)[name] = values
    return {
        "points": solid.getCoords().toNumPyArray(),
        "cells": cells[:, VTK[cells.shape[1]]],
        "outer": connectivity(file.getMeshAtLevel(-1)),
        "groups": groups,
        "fields": fields,
        "cell_fields": cell_fields,
    }


def names(file, level):
    return file.getGroupsOnSpecifiedLev(level)


def connectivity(mesh):
    flat, index = mesh.getNodalConnectivity().toNumPyArray(), mesh.getNodalConnectivityIndex().toNumPyArray()
    return flat.reshape(len(index) - 1, -1)[:, 1:]  # the first is the type


if __name__ == "__main__":
    pickle.dump(plain(sys.argv[1]), sys.stdout.buffer)
