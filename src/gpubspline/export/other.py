"""Whatever else meshio writes: formats that give back what they were given, checked with every element type.

Left out: .off, .wkt, .svg and .xml, which hold triangles; .ugrid, .ele and .vol, whose files meshio does not read
back; .med, .cgns, .h5m and .exo, which need HDF5 and whose vertex order meshio does not convert.
"""

import warnings
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from gpubspline.errors import GpubsplineWarning
from gpubspline.export.appended import xml_comment
from gpubspline.export.deck import Deck
from gpubspline.export.formats import Format
from gpubspline.export.quiet import quiet_meshio
from gpubspline.export.sets import set_flags
from gpubspline.files import whole_file
from gpubspline.mesh.elements import MESHABLE

STRAIGHT = ("quad4", "hex8")


def write(deck: Deck, path: Path, form: Format, name: str, options: Mapping[str, Any]) -> None:
    """Write elements, and the fields that the format holds, by meshio's writer ``name`` and its options.

    Sets are fields of 0 and 1 where ``form.sets``, as ``sets`` names them. Fields that are left out are warned of.
    """
    import meshio

    mesh = deck.with_all_fields if form.loads else deck.mesh
    flags = set_flags(deck) if form.sets else ({}, {})
    kept = replace(
        mesh,
        fields={**mesh.fields, **flags[0]} if form.fields else {},
        cell_fields={**mesh.cell_fields, **flags[1]} if form.cell_fields else {},
        node_sets={},
        element_sets={},
    )
    lost = [name for name in (*mesh.fields, *mesh.cell_fields) if name not in {**kept.fields, **kept.cell_fields}]
    if lost:
        words = f"{path.suffix.lower()} holds no field {', '.join(lost)}: left out"
        warnings.warn(words, GpubsplineWarning, stacklevel=4)
    if name == "vtk42":  # whose names end at a space
        fields, cell_fields = ({"_".join(k.split()): v for k, v in f.items()} for f in (kept.fields, kept.cell_fields))
        kept = replace(kept, fields=fields, cell_fields=cell_fields)
    with whole_file(path) as temporary, quiet_meshio():
        meshio.write(temporary, kept.to_meshio(), file_format=name, **options)
        if name == "xdmf":
            with open(temporary, "a", encoding="ascii", errors="replace") as out:
                out.writelines(f"\n{xml_comment(line)}" for line in deck.comment_lines(100))


def _format(
    name: str, extensions: tuple[str, ...], element_types: tuple[str, ...], *, fields: bool = False, **held: Any
) -> Format:
    """Format that meshio calls ``name``."""
    options = held.pop("options", {})

    def write_it(deck: Deck, path: Path) -> None:
        write(deck, path, form, name, options)

    short = extensions[0][1:]
    nodal = "field" if fields else ""
    form = Format(short, extensions, element_types, write_it, nodal, fields=fields, loads=fields, **held)
    return form


FORMATS = (
    # VTK does not know the integers of meshio's 5.1
    _format("vtk42", (".vtk",), MESHABLE, fields=True, cell_fields=True),
    # meshio's other way to write XDMF, HDF5, makes a second file that holds the data
    _format(
        "xdmf",
        (".xdmf", ".xmf"),
        MESHABLE,
        fields=True,
        cell_fields=True,
        sets=True,
        needs="h5py",
        options={"data_format": "XML"},
    ),
    _format("tecplot", (".dat", ".tec"), STRAIGHT, fields=True, cell_fields=True),
    _format("avsucd", (".avs",), STRAIGHT, fields=True),
    _format("mdpa", (".mdpa",), STRAIGHT),
    _format("medit", (".mesh", ".meshb"), STRAIGHT),
    _format("flac3d", (".f3grid",), ("hex8",)),
    _format("permas", (".dato",), STRAIGHT),
    _format("su2", (".su2",), ("hex8",)),
    _format("obj", (".obj",), ("quad4",)),
)
