"""Hex8 in linear elasticity, full integration, in lanes: forces against the derivatives of its 3 trilinear functions.

Vertices are numbered u fastest, Gauss points w fastest. Derivatives are 12 a component: 4 along u at the Gauss points
of v and w, u does not matter, then 4 along v, then 4 along w. The mathematics are those of ``elasticity.py``. There
are functions here and no kernels: the OpenCL twin of this is ``trilinear.h``.
"""

from typing import Any

import warp as wp

from gpubspline.kernels.lanes import LaneArray

NEAR = wp.constant(wp.float64(0.21132486540518711775))  # (1 - 1 / sqrt 3) / 2, the nearer Gauss point
FAR = wp.constant(wp.float64(0.78867513459481288225))
WEIGHT = wp.constant(wp.float64(0.125))


@wp.func
def bilinear(a: Any, b: Any, c: Any, d: Any):
    """Values at four corners (0, 0), (1, 0), (0, 1), (1, 1) to the four Gauss points in that order; symmetric."""
    near = type(a[0])(NEAR)
    far = type(a[0])(FAR)
    s = b - a
    t = d - c
    p = a + near * s
    q = a + far * s
    r = c + near * t
    o = c + far * t
    u = r - p
    v = o - q
    return p + near * u, q + near * v, p + far * u, q + far * v


@wp.func
def no_derivatives(like: Any):
    """12 vectors of 0."""
    zero = type(like[0])(0.0)
    return wp.outer(wp.vector(zero, zero, zero, zero, zero, zero, zero, zero, zero, zero, zero, zero), like)


@wp.func
def derivatives(a: Any, b: Any, c: Any, d: Any, p: Any, q: Any, r: Any, s: Any, none: Any):
    """Derivatives of a trilinear function from its values at the vertices."""
    u0, u1, u2, u3 = bilinear(b - a, d - c, q - p, s - r)
    v0, v1, v2, v3 = bilinear(c - a, d - b, r - p, s - q)
    w0, w1, w2, w3 = bilinear(p - a, q - b, r - c, s - d)
    rows = none  # filled row by row: matrix_from_rows copies number by number, many times slower
    rows[0] = u0
    rows[1] = u1
    rows[2] = u2
    rows[3] = u3
    rows[4] = v0
    rows[5] = v1
    rows[6] = v2
    rows[7] = v3
    rows[8] = w0
    rows[9] = w1
    rows[10] = w2
    rows[11] = w3
    return rows


@wp.func
def dot3(a: Any, b: Any, c: Any, x: Any, y: Any, z: Any):
    return wp.cw_mul(a, x) + wp.cw_mul(b, y) + wp.cw_mul(c, z)


@wp.func
def minor(a: Any, b: Any, c: Any, d: Any):
    return wp.cw_mul(a, d) - wp.cw_mul(b, c)


@wp.func
def vertices(d: Any):
    """The transpose: what the vertices get."""
    u0, u1, u2, u3 = bilinear(d[0], d[1], d[2], d[3])
    v0, v1, v2, v3 = bilinear(d[4], d[5], d[6], d[7])
    w0, w1, w2, w3 = bilinear(d[8], d[9], d[10], d[11])
    return (
        -u0 - v0 - w0,
        u0 - v1 - w1,
        v0 - u1 - w2,
        u1 + v1 - w3,
        w0 - u2 - v2,
        u2 - v3 + w1,
        v2 - u3 + w2,
        u3 + v3 + w3,
    )


@wp.func
def stressed(
    x: Any,
    y: Any,
    z: Any,
    hx: Any,
    hy: Any,
    hz: Any,
    lam: LaneArray,
    mu: LaneArray,
    place: wp.int32,
    step: wp.int32,
    weight: Any,
):
    """Forces against the derivatives from those of places and of displacements.

    Moduli of the first Gauss point begin at ``place``, those of the next are ``step`` further on; ``weight`` is that of
    a Gauss point for each element.
    """
    fx = no_derivatives(weight)
    fy = fx
    fz = fx
    g = place
    for i in range(2):
        for j in range(2):
            for k in range(2):
                u = j + 2 * k
                v = 4 + i + 2 * k
                w = 8 + i + 2 * j
                a0 = minor(y[v], y[w], z[v], z[w])  # rows of A: t_v x t_w, t_w x t_u, t_u x t_v
                a1 = minor(z[v], z[w], x[v], x[w])
                a2 = minor(x[v], x[w], y[v], y[w])
                b0 = minor(y[w], y[u], z[w], z[u])
                b1 = minor(z[w], z[u], x[w], x[u])
                b2 = minor(x[w], x[u], y[w], y[u])
                c0 = minor(y[u], y[v], z[u], z[v])
                c1 = minor(z[u], z[v], x[u], x[v])
                c2 = minor(x[u], x[v], y[u], y[v])
                factor = wp.cw_div(weight, dot3(x[u], y[u], z[u], a0, a1, a2))
                xx = dot3(hx[u], hx[v], hx[w], a0, b0, c0)
                yy = dot3(hy[u], hy[v], hy[w], a1, b1, c1)
                zz = dot3(hz[u], hz[v], hz[w], a2, b2, c2)
                shear = wp.cw_mul(factor, mu[g])
                yz = dot3(hy[u], hy[v], hy[w], a2, b2, c2) + dot3(hz[u], hz[v], hz[w], a1, b1, c1)
                xz = dot3(hx[u], hx[v], hx[w], a2, b2, c2) + dot3(hz[u], hz[v], hz[w], a0, b0, c0)
                xy = dot3(hx[u], hx[v], hx[w], a1, b1, c1) + dot3(hy[u], hy[v], hy[w], a0, b0, c0)
                pressure = wp.cw_mul(wp.cw_mul(factor, lam[g]), xx + yy + zz)
                twice = shear + shear
                xx = pressure + wp.cw_mul(twice, xx)
                yy = pressure + wp.cw_mul(twice, yy)
                zz = pressure + wp.cw_mul(twice, zz)
                yz = wp.cw_mul(shear, yz)
                xz = wp.cw_mul(shear, xz)
                xy = wp.cw_mul(shear, xy)
                fx[u] = fx[u] + dot3(xx, xy, xz, a0, a1, a2)
                fx[v] = fx[v] + dot3(xx, xy, xz, b0, b1, b2)
                fx[w] = fx[w] + dot3(xx, xy, xz, c0, c1, c2)
                fy[u] = fy[u] + dot3(xy, yy, yz, a0, a1, a2)
                fy[v] = fy[v] + dot3(xy, yy, yz, b0, b1, b2)
                fy[w] = fy[w] + dot3(xy, yy, yz, c0, c1, c2)
                fz[u] = fz[u] + dot3(xz, yz, zz, a0, a1, a2)
                fz[v] = fz[v] + dot3(xz, yz, zz, b0, b1, b2)
                fz[w] = fz[w] + dot3(xz, yz, zz, c0, c1, c2)
                g = g + step
    return fx, fy, fz
