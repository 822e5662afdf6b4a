"""Surfaces as polygons: PLY (.ply, binary) of the boundary of hexes or of quads, with the nodal fields.

Only the nodes of the surface are kept, in their order. Quads of order 2 are cut into triangles, as in STL.
Source: Turk, The PLY polygon file format.
"""

import warnings
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.errors import GpubsplineWarning
from gpubspline.export.deck import Deck
from gpubspline.export.formats import Format
from gpubspline.export.stl import surface_triangles
from gpubspline.files import whole_file
from gpubspline.mesh.elements import MESHABLE

_TYPES = {np.dtype("<f4"): "float", np.dtype("<f8"): "double", np.dtype("<i4"): "int", np.dtype("u1"): "uchar"}


def write(deck: Deck, path: Path) -> None:
    """Write the surface; element fields are left out, with a warning."""
    mesh = deck.with_all_fields
    if mesh.cell_fields:
        words = f".ply holds no field {', '.join(mesh.cell_fields)}: left out"
        warnings.warn(words, GpubsplineWarning, stacklevel=4)
    quads = mesh.cells if mesh.element.dimension == 2 else mesh.boundary()
    faces = quads if quads.shape[1] == 4 else surface_triangles(deck)
    nodes, which = np.unique(faces, return_inverse=True)
    columns: dict[str, NDArray[Any]] = dict(zip("xyz", mesh.planes[:, nodes], strict=True))
    columns |= {name.replace(" ", "_"): _plain(values[nodes]) for name, values in mesh.fields.items()}
    vertices = np.empty(nodes.size, dtype=[(name, values.dtype.newbyteorder("<")) for name, values in columns.items()])
    for name, values in columns.items():
        vertices[name] = values
    polygons = np.empty(len(faces), dtype=[("count", "u1"), ("nodes", "<i4", (faces.shape[1],))])
    polygons["count"], polygons["nodes"] = faces.shape[1], which.reshape(faces.shape)
    with whole_file(path) as temporary, open(temporary, "wb") as out:
        out.write("\n".join(_header(deck, vertices, len(faces))).encode("ascii", "replace"))
        out.write(vertices.tobytes())
        out.write(polygons.tobytes())


def _plain(values: NDArray[Any]) -> NDArray[Any]:
    known = values.dtype.newbyteorder("<") in _TYPES
    return values if known else values.astype(np.int32 if values.dtype.kind in "iub" else np.float64)


def _header(deck: Deck, vertices: NDArray[Any], n_faces: int) -> list[str]:
    names = [f"property {_TYPES[vertices.dtype[name]]} {name}" for name in vertices.dtype.names or ()]
    return [
        "ply",
        "format binary_little_endian 1.0",
        *(f"comment {line}" for line in deck.comment_lines(100)),
        f"element vertex {len(vertices)}",
        *names,
        f"element face {n_faces}",
        "property list uchar int vertex_indices",
        "end_header",
        "",
    ]


FORMATS = (Format("ply", (".ply",), MESHABLE, write, nodal="field", loads=True, fields=True),)
