"""Surfaces as triangles: STL (.stl, binary) of the boundary of hexes or of quads, each quad as two.

The format has neither units nor fields nor shared vertices: all but the surface is left out, fields with a warning.
Quads of order 2 are cut through their midpoints. Source: 3D Systems, Stereolithography interface specification.
"""

import warnings
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gpubspline.errors import GpubsplineWarning
from gpubspline.export.deck import Deck
from gpubspline.export.formats import Format
from gpubspline.export.rows import chunks
from gpubspline.files import whole_file
from gpubspline.mesh.elements import MESHABLE

TRIANGLES: dict[int, tuple[tuple[int, int, int], ...]] = {
    4: ((0, 1, 2), (0, 2, 3)),
    8: ((0, 4, 7), (4, 1, 5), (5, 2, 6), (6, 3, 7), (4, 5, 7), (5, 6, 7)),
    9: ((0, 4, 8), (0, 8, 7), (4, 1, 5), (4, 5, 8), (8, 5, 2), (8, 2, 6), (7, 8, 6), (7, 6, 3)),
}
"""Of a quad by its number of vertices, in VTK's order, as it is seen from outside."""

_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def write(deck: Deck, path: Path) -> None:
    """Write the surface; fields that are left out are warned of."""
    lost = [*deck.mesh.fields, *deck.mesh.cell_fields]
    if lost:
        warnings.warn(f".stl holds no field {', '.join(lost)}: left out", GpubsplineWarning, stacklevel=4)
    triangles = surface_triangles(deck)
    with whole_file(path) as temporary, open(temporary, "wb") as out:
        out.write(f"gpubspline, {deck.units.length}".encode("ascii").ljust(80))
        out.write(np.uint32(len(triangles)).astype("<u4").tobytes())
        for rows in chunks(len(triangles)):
            corners = deck.mesh.points[triangles[rows]].astype(np.float64)
            facets = np.zeros(len(corners), dtype=_FACET)
            normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
            facets["normal"] = normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
            facets["corners"] = corners
            out.write(facets.tobytes())


def surface_triangles(deck: Deck) -> NDArray[np.int32]:
    """(t, 3) node numbers of the boundary of hexes, outward, or of quads."""
    mesh = deck.mesh
    quads = mesh.cells if mesh.element.dimension == 2 else mesh.boundary()
    return np.concatenate([quads[:, corners] for corners in TRIANGLES[quads.shape[1]]])


FORMATS = (Format("stl", (".stl",), MESHABLE, write, readable=False),)
