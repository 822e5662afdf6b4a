"""Linear elasticity of hexes, element by element: what ``hex8.py``, ``isoparametric.py`` and ``orthotropic.py`` share.

Vectors are component planes, x[], y[], z[] of n nodes each. ``nodes`` is (k, m): plane a holds the number of vertex a
of each element, in VTK's order. Lame's moduli are given at the Gauss points, (points, m), in MPa; Gauss points run
along w fastest. What an element gives its nodes is (3, k, m): ``nodal.py`` sums it node by node.

With the tangents t_d = dx/dt_d the inverse of the Jacobian is A / det, where A's rows are t_1 x t_2, t_2 x t_0 and
t_0 x t_1. A displacement gradient H along the parameters is H A / det in space, and a stress S gives S A^T, times the
weight, against the parameters' derivatives of the shape functions. There are functions here and no kernels: the OpenCL
twin of this is ``elasticity.h``.
"""

from typing import Any

import warp as wp


@wp.func
def cofactors(t: Any):
    """A, whose rows are products of the tangents, the columns of t; its product with a column is the determinant."""
    u = wp.vector(t[0, 0], t[1, 0], t[2, 0])
    v = wp.vector(t[0, 1], t[1, 1], t[2, 1])
    w = wp.vector(t[0, 2], t[1, 2], t[2, 2])
    return wp.matrix_from_rows(wp.cross(v, w), wp.cross(w, u), wp.cross(u, v))


@wp.func
def determinant_of(t: Any, A: Any):
    return t[0, 0] * A[0, 0] + t[1, 0] * A[0, 1] + t[2, 0] * A[0, 2]


@wp.func
def stress(G: Any, lam: Any, mu: Any):
    """Stress of a displacement gradient in space."""
    pressure = lam * (G[0, 0] + G[1, 1] + G[2, 2])
    S = mu * (G + wp.transpose(G))
    S[0, 0] = S[0, 0] + pressure
    S[1, 1] = S[1, 1] + pressure
    S[2, 2] = S[2, 2] + pressure
    return S


@wp.func
def tangents(
    planes: wp.array(dtype=Any),
    n: wp.int32,
    nodes: wp.array(dtype=wp.int32),
    k: wp.int32,
    m: wp.int32,
    e: wp.int32,
    slopes: wp.array(dtype=Any),
    g: wp.int32,
):
    """Derivatives at one Gauss point from ``slopes`` (points, k, 3), those of the shape functions."""
    t = wp.matrix(shape=(3, 3), dtype=planes.dtype)
    for a in range(k):
        node = nodes[a * m + e]
        at = (g * k + a) * 3
        value = wp.vector(planes[node], planes[n + node], planes[2 * n + node])
        t = t + wp.outer(value, wp.vector(slopes[at], slopes[at + 1], slopes[at + 2]))
    return t


@wp.func
def gradient(
    points: wp.array(dtype=Any),
    displacement: wp.array(dtype=Any),
    n: wp.int32,
    nodes: wp.array(dtype=wp.int32),
    k: wp.int32,
    m: wp.int32,
    e: wp.int32,
    slopes: wp.array(dtype=Any),
    g: wp.int32,
):
    """Gradient of the displacement in space at one Gauss point, and A there."""
    t = tangents(points, n, nodes, k, m, e, slopes, g)
    A = cofactors(t)
    H = tangents(displacement, n, nodes, k, m, e, slopes, g)
    return H * A * (points.dtype(1.0) / determinant_of(t, A)), A


@wp.func
def store_flux(F: Any, g: wp.int32, m: wp.int32, e: wp.int32, fluxes: wp.array(dtype=Any)):
    """Keep what one Gauss point of an element gives in (points, 3, 3, m)."""
    for c in range(3):
        for d in range(3):
            fluxes[(9 * g + 3 * c + d) * m + e] = F[c, d]
