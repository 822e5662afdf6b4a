"""Whatever else meshio writes: formats that give back what they were given, checked with every element type.

Left out: .stl, .off, .wkt, .svg and .xml, which hold triangles; .ugrid, .ele and .vol, whose files meshio does not read
back; .med, .cgns, .h5m and .exo, which need HDF5 and whose vertex order meshio does not convert.
"""

import importlib.util
import warnings
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from gpubspline.errors import GpubsplineWarning, InputError
from gpubspline.export.quiet import quiet_meshio
from gpubspline.files import whole_file
from gpubspline.material.laws import Law
from gpubspline.mesh.elements import MESHABLE
from gpubspline.mesh.mesh import Mesh

STRAIGHT = ("quad4", "hex8")


@dataclass(frozen=True)
class Format:
    """What a format of meshio can hold.

    Attributes
    ----------
    name: meshio's name of it.
    element_types: those that come back as they were.
    nodal, elemental: whether nodal and element fields come back.
    needs: a package that meshio wants for it.
    options: for meshio's writer.
    """

    name: str
    element_types: tuple[str, ...]
    nodal: bool = False
    elemental: bool = False
    needs: str = ""
    options: tuple[tuple[str, Any], ...] = ()


_NASTRAN = Format("nastran", ("quad4", "quad8", "hex8", "hex20"))
_TECPLOT = Format("tecplot", STRAIGHT, nodal=True, elemental=True)
_MEDIT = Format("medit", STRAIGHT)
# meshio's other way to write XDMF, HDF5, makes a second file that holds the data
_XDMF = Format("xdmf", MESHABLE, nodal=True, elemental=True, needs="h5py", options=(("data_format", "XML"),))
FORMATS = {
    ".vtk": Format("vtk42", MESHABLE, nodal=True, elemental=True),  # VTK does not know the integers of meshio's 5.1
    ".msh": Format("gmsh", MESHABLE, nodal=True, elemental=True),
    ".xdmf": _XDMF,
    ".xmf": _XDMF,
    ".dat": _TECPLOT,
    ".tec": _TECPLOT,
    ".avs": Format("avsucd", STRAIGHT, nodal=True),
    ".bdf": _NASTRAN,
    ".nas": _NASTRAN,
    ".fem": _NASTRAN,
    ".mdpa": Format("mdpa", STRAIGHT),
    ".mesh": _MEDIT,
    ".meshb": _MEDIT,
    ".f3grid": Format("flac3d", ("hex8",)),
    ".dato": Format("permas", STRAIGHT),
    ".su2": Format("su2", ("hex8",)),
    ".obj": Format("obj", ("quad4",)),
    ".ply": Format("ply", ("quad4",), nodal=True),
}
EXTENSIONS = tuple(FORMATS)


def check(extension: str) -> None:
    """Raise ``InputError`` where a package that the format needs is not installed."""
    needs = FORMATS[extension].needs
    if needs and importlib.util.find_spec(needs) is None:
        raise InputError(f"expected {needs}, which {extension} files need, to be installed: pip install {needs}")


def write(mesh: Mesh, path: Path, *, law: Law | None = None, modulus_bins: int | None = None) -> None:
    """Write elements, and the fields that the format holds; node and element sets are left out.

    Raises
    ------
    InputError where the format cannot hold the elements, or for ``modulus_bins``, which only decks have. Fields left
    out are warned of.
    """
    extension = path.suffix.lower()
    form = FORMATS[extension]
    if modulus_bins is not None:
        raise InputError(f"expected modulus_bins with a .inp deck only, got {path.name!r}")
    if mesh.element_type not in form.element_types:
        held = ", ".join(form.element_types)
        raise InputError(f"expected elements of {held} for {extension}, got {mesh.element_type}; .vtu holds them")
    kept = replace(
        mesh,
        fields=mesh.fields if form.nodal else {},
        cell_fields=mesh.cell_fields if form.elemental else {},
        node_sets={},
        element_sets={},
    )
    lost = [name for name in (*mesh.fields, *mesh.cell_fields) if name not in {**kept.fields, **kept.cell_fields}]
    if lost:
        warnings.warn(f"{extension} holds no field {', '.join(lost)}: left out", GpubsplineWarning, stacklevel=3)
    _write(kept, path, form)


def _write(mesh: Mesh, path: Path, form: Format) -> None:
    import meshio

    with whole_file(path) as temporary, quiet_meshio():
        meshio.write(temporary, mesh.to_meshio(), file_format=form.name, **dict(form.options))
