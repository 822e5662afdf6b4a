"""MED: MEDCoupling, by the MED library itself; the units in the file's own attribute by h5py."""

from pathlib import Path

from foreign import Found, faces, load_fields, materials

VTK = {8: (0, 3, 2, 1, 4, 7, 6, 5), 20: (0, 3, 2, 1, 4, 7, 6, 5, 11, 10, 9, 8, 15, 14, 13, 12, 16, 19, 18, 17)}
"""Vertices of VTK in MED's numbers; the corners are their own inverse, the midpoints are checked by where they lie."""


def read(path: Path) -> Found:
    import h5py
    import medcoupling as mc

    file = mc.MEDFileUMesh(str(path))
    solid = file.getMeshAtLevel(0)
    assert (solid.getMeasureField(False).getArray().toNumPyArray() > 0).all()
    cells = connectivity(solid)
    cells = cells[:, VTK[cells.shape[1]]]
    outer = connectivity(file.getMeshAtLevel(-1))
    groups = {
        level: {name: file.getGroupArr(level, name).toNumPyArray() for name in names(file, level)}
        for level in (0, -1, 1)
    }
    fields, cell_fields = {}, {}
    for name in mc.GetAllFieldNames(str(path)):
        kinds = mc.GetTypesOfField(str(path), "mesh", name)
        values = mc.ReadField(kinds[0], str(path), "mesh", 0, name, 1, -1).getArray().toNumPyArray()
        (fields if kinds[0] == mc.ON_NODES else cell_fields)[name] = values
    with h5py.File(path) as raw:
        comment = raw.attrs["COMMENT"].decode()
    return Found(
        "MEDCoupling",
        solid.getCoords().toNumPyArray(),
        cells,
        groups[1],
        groups[0],
        {name: faces(outer[members]) for name, members in groups[-1].items()},
        **load_fields(fields),
        **materials(fields, cell_fields),
        fields=fields,
        cell_fields=cell_fields,
        comment=comment,
    )


def names(file, level):
    return file.getGroupsOnSpecifiedLev(level)


def connectivity(mesh):
    flat, index = mesh.getNodalConnectivity().toNumPyArray(), mesh.getNodalConnectivityIndex().toNumPyArray()
    return flat.reshape(len(index) - 1, -1)[:, 1:]  # the first is the type
