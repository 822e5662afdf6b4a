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
    centre, total = planes[:, :1].astype(np.float64), 0.0  # of coordinates: any place in the body
    at, weights = ELEMENTS[face_type].gauss()
    for first in range(0, len(faces), _CHUNK):
        part = faces[first : first + _CHUNK]
        if face_type == "quad4":
            total += _below_bilinear(planes, part, centre)
            continue
        x, normal = _faces_at(planes, part, face_type, at, centre[:, 0])
        total += float(np.einsum("cgf,cgf,g->", x, normal, weights)) / 3
    return total


def _below_bilinear(planes: NDArray[Any], faces: NDArray[Any], centre: NDArray[np.float64]) -> float:
    """Volume between a centre and bilinear quads: the mean of what either pair of triangles gives, a twelfth of
    (a x b) . (c + d) + (a + b) . (c x d), as the product of a bilinear place and its normal integrates.
    """
    a, b, c, d = (planes[:, corner].astype(np.float64) - centre for corner in faces.T)
    one, other = np.cross(a, b, axis=0), np.cross(c, d, axis=0)
    return float(np.einsum("cf,cf", one, c + d) + np.einsum("cf,cf", a + b, other)) / 12


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
