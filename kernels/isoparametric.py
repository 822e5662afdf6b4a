"""Linear elasticity of hexes of any order: the forces of every element on its nodes, K u, by way of its Gauss points.

Layouts and the mathematics are those of ``elasticity.py``.
"""

from typing import Any

import warp as wp

from gpubspline.kernels.elasticity import cofactors, determinant_of, gradient, store_flux, stress, tangents


@wp.kernel(enable_backward=False, module="unique")
def jacobians(
    points: wp.array(dtype=Any),
    n: wp.int32,
    nodes: wp.array(dtype=wp.int32),
    k: wp.int32,
    m: wp.int32,
    slopes: wp.array(dtype=Any),
    n_points: wp.int32,
    out: wp.array(dtype=Any),
    first: wp.int32,
):
    """Determinants (points, m) of the Jacobian, mm3."""
    e = wp.tid() + first
    for g in range(n_points):
        t = tangents(points, n, nodes, k, m, e, slopes, g)
        out[g * m + e] = determinant_of(t, cofactors(t))


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
    lam: wp.array(dtype=Any),
    mu: wp.array(dtype=Any),
    out: wp.array(dtype=Any),
    first: wp.int32,
):
    """What the stress at each Gauss point gives against the parameters' derivatives, (points, 3, 3, m)."""
    e = wp.tid() + first
    for g in range(n_points):
        G, A = gradient(points, displacement, n, nodes, k, m, e, slopes, g)
        store_flux(weights[g] * stress(G, lam[g * m + e], mu[g * m + e]) * wp.transpose(A), g, m, e, out)


@wp.kernel(enable_backward=False, module="unique")
def flux_forces(
    fluxes: wp.array(dtype=Any),
    slopes: wp.array(dtype=Any),
    n_points: wp.int32,
    k: wp.int32,
    m: wp.int32,
    forces: wp.array(dtype=Any),
    first: wp.int32,
):
    """Forces (3, k, m) from the fluxes; launched over (k, m)."""
    tid_a, e = wp.tid()
    a = tid_a + first
    x = forces.dtype(0.0)
    y = forces.dtype(0.0)
    z = forces.dtype(0.0)
    for g in range(n_points):
        for d in range(3):
            slope = slopes[(g * k + a) * 3 + d]
            at = (9 * g + d) * m + e
            x = x + slope * fluxes[at]
            y = y + slope * fluxes[at + 3 * m]
            z = z + slope * fluxes[at + 6 * m]
    forces[a * m + e] = x
    forces[(k + a) * m + e] = y
    forces[(2 * k + a) * m + e] = z


@wp.kernel(enable_backward=False, module="unique")
def own_stiffness(
    points: wp.array(dtype=Any),
    n: wp.int32,
    nodes: wp.array(dtype=wp.int32),
    k: wp.int32,
    m: wp.int32,
    slopes: wp.array(dtype=Any),
    weights: wp.array(dtype=Any),
    n_points: wp.int32,
    lam: wp.array(dtype=Any),
    mu: wp.array(dtype=Any),
    out: wp.array(dtype=Any),
    first: wp.int32,
):
    """Stiffness of each node against itself, (6, k, m): xx, yy, zz, yz, xz, xy; launched over (k, m).

    Incompatible modes and mean dilatation, which make an element softer, are left out.
    """
    tid_a, e = wp.tid()
    a = tid_a + first
    total = wp.matrix(shape=(3, 3), dtype=out.dtype)
    for g in range(n_points):
        t = tangents(points, n, nodes, k, m, e, slopes, g)
        A = cofactors(t)
        at = (g * k + a) * 3
        b = wp.transpose(A) * wp.vector(slopes[at], slopes[at + 1], slopes[at + 2])
        factor = weights[g] / determinant_of(t, A)
        second = factor * mu[g * m + e]
        square = second * wp.dot(b, b)
        total = total + (factor * lam[g * m + e] + second) * wp.outer(b, b)
        for c in range(3):
            total[c, c] = total[c, c] + square
    out[a * m + e] = total[0, 0]
    out[(k + a) * m + e] = total[1, 1]
    out[(2 * k + a) * m + e] = total[2, 2]
    out[(3 * k + a) * m + e] = total[1, 2]
    out[(4 * k + a) * m + e] = total[0, 2]
    out[(5 * k + a) * m + e] = total[0, 1]
