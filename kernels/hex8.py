"""Linear elasticity of hex8: the forces of every element on its nodes, K u, without any matrix, 2 x 2 x 2 Gauss points.

Layouts and the mathematics are those of ``elasticity.py``.
"""

from typing import Any

import warp as wp

from gpubspline.kernels.elasticity import cofactors, determinant_of, stress

INCOMPATIBLE = wp.constant(1)  # three quadratic modes a component. Source: Taylor, Beresford and Wilson 1976
BBAR = wp.constant(2)  # mean dilatation. Source: Hughes 1980
GAUSS = wp.constant(wp.float64(0.21132486540518711775))  # (1 - 1 / sqrt 3) / 2
WEIGHT = wp.constant(wp.float64(0.125))


@wp.func
def bilinear(a: Any, b: Any, c: Any, d: Any):
    """Values at four corners (0, 0), (1, 0), (0, 1), (1, 1) to the four Gauss points in that order; symmetric."""
    gauss = type(a)(GAUSS)
    s = gauss * (b - a)
    t = gauss * (d - c)
    u = gauss * (c + t - a - s)
    v = gauss * (d - t - b + s)
    return wp.vector(a + s + u, b - s + v, c + t - u, d - t - v)


@wp.func
def along(plane: wp.array(dtype=Any), offset: wp.int32, nodes: wp.array(dtype=wp.int32), m: wp.int32, e: wp.int32):
    """Derivatives of a trilinear function along each parameter, which does not depend on that parameter.

    Gives 3 x 4 values at the Gauss points of the other two.
    """
    a = plane[offset + nodes[e]]
    b = plane[offset + nodes[m + e]]
    c = plane[offset + nodes[2 * m + e]]
    d = plane[offset + nodes[3 * m + e]]
    p = plane[offset + nodes[4 * m + e]]
    q = plane[offset + nodes[5 * m + e]]
    r = plane[offset + nodes[6 * m + e]]
    s = plane[offset + nodes[7 * m + e]]
    return wp.matrix_from_rows(
        bilinear(b - a, c - d, q - p, r - s),
        bilinear(d - a, c - b, s - p, r - q),
        bilinear(p - a, q - b, s - d, r - c),
    )


@wp.func
def at_point(x: Any, y: Any, z: Any, i: wp.int32, j: wp.int32, k: wp.int32):
    """The 3 x 3 derivatives, component by direction, at a Gauss point."""
    u = j + 2 * k
    v = i + 2 * k
    w = i + 2 * j
    return wp.matrix_from_rows(
        wp.vector(x[0, u], x[1, v], x[2, w]),
        wp.vector(y[0, u], y[1, v], y[2, w]),
        wp.vector(z[0, u], z[1, v], z[2, w]),
    )


@wp.func
def row_mean(d: Any):
    """Derivatives at the element's centre."""
    quarter = type(d[0, 0])(0.25)
    return wp.vector(
        quarter * (d[0, 0] + d[0, 1] + d[0, 2] + d[0, 3]),
        quarter * (d[1, 0] + d[1, 1] + d[1, 2] + d[1, 3]),
        quarter * (d[2, 0] + d[2, 1] + d[2, 2] + d[2, 3]),
    )


@wp.func
def centre_cofactors(x: Any, y: Any, z: Any):
    return cofactors(wp.matrix_from_rows(row_mean(x), row_mean(y), row_mean(z)))


@wp.func
def signed(A: Any, i: wp.int32, j: wp.int32, k: wp.int32):
    """Rows of A with the signs of a Gauss point's parameters."""
    one = type(A[0, 0])(1.0)
    return wp.matrix_from_rows(
        wp.where(i == 1, one, -one) * A[0], wp.where(j == 1, one, -one) * A[1], wp.where(k == 1, one, -one) * A[2]
    )


@wp.func
def store_vertices(d: Any, c: wp.int32, m: wp.int32, e: wp.int32, forces: wp.array(dtype=Any)):
    """The transpose of ``along``, stored."""
    u = bilinear(d[0, 0], d[0, 1], d[0, 2], d[0, 3])
    w = bilinear(d[1, 0], d[1, 1], d[1, 2], d[1, 3])
    t = bilinear(d[2, 0], d[2, 1], d[2, 2], d[2, 3])
    at = 8 * c * m + e
    forces[at] = -u[0] - w[0] - t[0]
    forces[at + m] = u[0] - w[1] - t[1]
    forces[at + 2 * m] = u[1] + w[1] - t[3]
    forces[at + 3 * m] = -u[1] + w[0] - t[2]
    forces[at + 4 * m] = -u[2] - w[2] + t[0]
    forces[at + 5 * m] = u[2] - w[3] + t[1]
    forces[at + 6 * m] = u[3] + w[3] + t[3]
    forces[at + 7 * m] = -u[3] + w[2] + t[2]


@wp.kernel(enable_backward=False, module="unique")
def forces(
    points: wp.array(dtype=Any),
    displacement: wp.array(dtype=Any),
    n: wp.int32,
    nodes: wp.array(dtype=wp.int32),
    m: wp.int32,
    lam: wp.array(dtype=Any),
    mu: wp.array(dtype=Any),
    formulation: wp.int32,
    inverse_modes: wp.array(dtype=Any),
    forces: wp.array(dtype=Any),
    first: wp.int32,
):
    """Forces (3, 8, m) of hex8 elements on their nodes, 2 x 2 x 2 Gauss points.

    ``inverse_modes`` is (9, 9, m), the inverse of ``modes``, where the formulation has modes.
    """
    e = wp.tid() + first
    x = along(points, 0, nodes, m, e)
    y = along(points, n, nodes, m, e)
    z = along(points, 2 * n, nodes, m, e)
    u = along(displacement, 0, nodes, m, e)
    v = along(displacement, n, nodes, m, e)
    w = along(displacement, 2 * n, nodes, m, e)
    weight = forces.dtype(WEIGHT)
    none = forces.dtype(0.0)
    one = forces.dtype(1.0)
    centre = wp.matrix(shape=(3, 3), dtype=forces.dtype)
    alpha = wp.matrix(shape=(3, 3), dtype=forces.dtype)  # component by mode
    pressure = none
    if formulation == INCOMPATIBLE:
        centre = centre_cofactors(x, y, z)
        r = wp.matrix(shape=(3, 3), dtype=forces.dtype)
        for i in range(2):
            for j in range(2):
                for k in range(2):
                    g = (4 * i + 2 * j + k) * m + e
                    t = at_point(x, y, z, i, j, k)
                    A = cofactors(t)
                    G = at_point(u, v, w, i, j, k) * A * (one / determinant_of(t, A))
                    r = r + weight * stress(G, lam[g], mu[g]) * wp.transpose(signed(centre, i, j, k))
        for p in range(9):
            total = none
            for q in range(9):
                total = total + inverse_modes[(9 * p + q) * m + e] * r[q % 3, q // 3]
            alpha[p % 3, p // 3] = -total
    if formulation == BBAR:
        volume = none
        growth = none
        bulk = none
        for i in range(2):
            for j in range(2):
                for k in range(2):
                    g = (4 * i + 2 * j + k) * m + e
                    t = at_point(x, y, z, i, j, k)
                    A = cofactors(t)
                    det = determinant_of(t, A)
                    volume = volume + det
                    growth = growth + wp.trace(at_point(u, v, w, i, j, k) * A)
                    bulk = bulk + det * (lam[g] + forces.dtype(2.0) / forces.dtype(3.0) * mu[g])
        pressure = growth / volume * bulk / volume
    fx = wp.matrix(shape=(3, 4), dtype=forces.dtype)
    fy = wp.matrix(shape=(3, 4), dtype=forces.dtype)
    fz = wp.matrix(shape=(3, 4), dtype=forces.dtype)
    for i in range(2):
        for j in range(2):
            for k in range(2):
                g = (4 * i + 2 * j + k) * m + e
                t = at_point(x, y, z, i, j, k)
                A = cofactors(t)
                G = at_point(u, v, w, i, j, k) * A
                if formulation == INCOMPATIBLE:
                    G = G + alpha * signed(centre, i, j, k)
                G = G * (one / determinant_of(t, A))
                lambda_here = lam[g]
                if formulation == BBAR:
                    lambda_here = -forces.dtype(2.0) / forces.dtype(3.0) * mu[g]
                S = stress(G, lambda_here, mu[g])
                S[0, 0] = S[0, 0] + pressure
                S[1, 1] = S[1, 1] + pressure
                S[2, 2] = S[2, 2] + pressure
                F = weight * S * wp.transpose(A)
                fx[0, j + 2 * k] += F[0, 0]
                fx[1, i + 2 * k] += F[0, 1]
                fx[2, i + 2 * j] += F[0, 2]
                fy[0, j + 2 * k] += F[1, 0]
                fy[1, i + 2 * k] += F[1, 1]
                fy[2, i + 2 * j] += F[1, 2]
                fz[0, j + 2 * k] += F[2, 0]
                fz[1, i + 2 * k] += F[2, 1]
                fz[2, i + 2 * j] += F[2, 2]
    store_vertices(fx, 0, m, e, forces)
    store_vertices(fy, 1, m, e, forces)
    store_vertices(fz, 2, m, e, forces)


@wp.kernel(enable_backward=False, module="unique")
def modes(
    points: wp.array(dtype=Any),
    n: wp.int32,
    nodes: wp.array(dtype=wp.int32),
    m: wp.int32,
    lam: wp.array(dtype=Any),
    mu: wp.array(dtype=Any),
    modes: wp.array(dtype=Any),
    first: wp.int32,
):
    """Stiffness (9, 9, m) of the incompatible modes, mode by component."""
    e = wp.tid() + first
    x = along(points, 0, nodes, m, e)
    y = along(points, n, nodes, m, e)
    z = along(points, 2 * n, nodes, m, e)
    centre = centre_cofactors(x, y, z)
    square = centre * wp.transpose(centre)
    weights = wp.matrix(shape=(3, 3), dtype=modes.dtype)
    shears = wp.matrix(shape=(3, 3), dtype=modes.dtype)
    one = modes.dtype(1.0)
    for i in range(2):
        for j in range(2):
            for k in range(2):
                g = (4 * i + 2 * j + k) * m + e
                t = at_point(x, y, z, i, j, k)
                factor = modes.dtype(WEIGHT) / determinant_of(t, cofactors(t))
                s = wp.vector(wp.where(i == 1, one, -one), wp.where(j == 1, one, -one), wp.where(k == 1, one, -one))
                signs = wp.outer(s, s)
                weights = weights + factor * lam[g] * signs
                shears = shears + factor * mu[g] * signs
    for p in range(3):
        for q in range(3):
            for c in range(3):
                for d in range(3):
                    value = weights[p, q] * centre[p, c] * centre[q, d] + shears[p, q] * centre[p, d] * centre[q, c]
                    if c == d:
                        value = value + shears[p, q] * square[p, q]
                    modes[(9 * (3 * p + c) + 3 * q + d) * m + e] = value
