"""Volume and area of elements with straight or curved sides."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.mesh.elements import ELEMENTS

_CHUNK = 1 << 16
"""Faces integrated at a time, which bounds the memory."""


def enclosed_volume_mm3(planes: NDArray[Any], faces: NDArray[Any], face_type: str) -> float:
    """Signed volume, mm3, inside a closed surface of outward faces.

    The divergence theorem, a third of the surface integral of x . n: faces between elements cancel, so it equals the
    sum of the elements' volumes (trilinear, or curved with curved faces) to rounding, at the cost of the surface only.

    Arguments
    ---------
    planes: (3, n) coordinates, mm.
    faces: (f, k) node numbers.
    face_type: quad4, quad8 or quad9.
    """
    centre = planes.mean(axis=1, dtype=np.float64)
    at, weights = ELEMENTS[face_type].gauss()
    total = 0.0
    for first in range(0, len(faces), _CHUNK):
        x, normal = _faces_at(planes, faces[first : first + _CHUNK], face_type, at, centre)
        total += float(np.einsum("cgf,cgf,g->", x, normal, weights))
    return total / 3


def area_vector_mm2(planes: NDArray[Any], faces: NDArray[Any], face_type: str) -> tuple[float, NDArray[np.float64]]:
    """Area, mm2, and its vector sum (3,) of faces (f, k) of a type (quad4, quad8, quad9) on planes (3, n), mm.

    The vector is exact; the area is for flat faces, and to quadrature (2 or 3 points per parameter) for warped ones.
    """
    centre = planes.mean(axis=1, dtype=np.float64)
    at, weights = ELEMENTS[face_type].gauss()
    area, vector = 0.0, np.zeros(3)
    for first in range(0, len(faces), _CHUNK):
        _, normal = _faces_at(planes, faces[first : first + _CHUNK], face_type, at, centre)
        area += float(np.einsum("gf,g->", np.linalg.norm(normal, axis=0), weights))
        vector += np.einsum("cgf,g->c", normal, weights)
    return area, vector


def _faces_at(
    planes: NDArray[Any], faces: NDArray[Any], face_type: str, at: NDArray[np.float64], centre: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Points and normals (3, g, f) of the faces, the normals as long as the area per unit of the parameters."""
    element = ELEMENTS[face_type]
    nodes = planes[:, faces].astype(np.float64) - centre[:, None, None]
    along_u, along_v = (np.einsum("gk,cfk->cgf", gradient, nodes) for gradient in element.gradient(at))
    return np.einsum("gk,cfk->cgf", element.shape(at), nodes), np.cross(along_u, along_v, axis=0)
