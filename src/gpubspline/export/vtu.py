"""VTK's XML unstructured grid (.vtu): binary, compressed, with every field.

The format has no node or element sets: they are left out. Source: VTK file formats, "UnstructuredGrid".
"""

from dataclasses import replace
from pathlib import Path

from gpubspline.errors import InputError
from gpubspline.export.quiet import quiet_meshio
from gpubspline.files import whole_file
from gpubspline.material.laws import Law
from gpubspline.mesh.mesh import Mesh

EXTENSIONS = (".vtu",)


def write(mesh: Mesh, path: Path, *, law: Law | None = None, modulus_bins: int | None = None) -> None:
    """Write all fields with the precision they have.

    Raises InputError for ``modulus_bins``, which only decks have.
    """
    if modulus_bins is not None:
        raise InputError(f"expected modulus_bins with a .inp deck only, got {path.name!r}")
    import meshio

    with whole_file(path) as temporary, quiet_meshio():
        bare = replace(mesh, node_sets={}, element_sets={})
        meshio.write(temporary, bare.to_meshio(), file_format="vtu", binary=True, compression="zlib")
