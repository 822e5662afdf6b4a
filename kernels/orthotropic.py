"""Linear elasticity of hexes of orthotropic material, one an element: what stress gives against the parameters.

With Q, symmetric, whose axes are the material's and whose values are fourth roots of its moduli, the stress of a strain
e is Q C(Q e Q) Q, where C is isotropic with a modulus of 1. Layouts and the rest as in ``elasticity.py``;
``flux_forces`` of ``isoparametric.py`` takes the fluxes on.
"""

from typing import Any

import warp as wp

from gpubspline.kernels.elasticity import gradient, store_flux, stress


@wp.kernel(enable_backward=False, module="unique")
def fluxes(
    points: wp.array(dtype=Any),
    displacement: wp.array(dtype=Any),
    n: wp.int32,
    nodes: wp.array(dtype=wp.int32),
    k: wp.int32,
    m: wp.int32,
    slopes: wp.array(dtype=Any),
    weights: wp.array(dtype=Any),
    n_points: wp.int32,
    roots: wp.array(dtype=Any),
    lam: wp.array(dtype=Any),
    mu: wp.array(dtype=Any),
    out: wp.array(dtype=Any),
    first: wp.int32,
):
    """Fluxes (points, 3, 3, m); ``roots`` (6, m) are Q: xx, yy, zz, yz, xz, xy; lam and mu (m), of a modulus of 1."""
    e = wp.tid() + first
    xx = roots[e]
    yy = roots[m + e]
    zz = roots[2 * m + e]
    yz = roots[3 * m + e]
    xz = roots[4 * m + e]
    xy = roots[5 * m + e]
    Q = wp.matrix_from_rows(wp.vector(xx, xy, xz), wp.vector(xy, yy, yz), wp.vector(xz, yz, zz))
    for g in range(n_points):
        G, A = gradient(points, displacement, n, nodes, k, m, e, slopes, g)
        S = Q * stress(Q * G * Q, lam[e], mu[e]) * Q
        store_flux(weights[g] * S * wp.transpose(A), g, m, e, out)
