"""Linear elasticity of a structured mesh of hex8: K u by rows of elements, without connectivity, matrix or gather.

The mathematics, 2 x 2 x 2 Gauss points and names are those of ``elasticity.py``. Nodes are n_u x n_v x n_w, u fastest,
so that the vertices a of a run of elements along u lie side by side in the planes: all is in lanes (``lanes.py``), lane
l being the element l further on in the row. Derivatives are 12 a component: 4 along u, 4 along v, 4 along w.

What elements give their nodes goes into ``shares`` (n_w, n_v, 4, 3, 2, n_u): of each row of nodes what comes from
elements on its 4 sides, a component after the other, from the right and from the left of each node. No two elements
write the same number, and what none writes must be 0. The force on a node is the sum of its 8, always in this order.
"""

from typing import Any

import warp as wp

from gpubspline.kernels.lanes import LaneArray

GAUSS = wp.constant(wp.float64(0.21132486540518711775))  # (1 - 1 / sqrt 3) / 2
WEIGHT = wp.constant(wp.float64(0.125))


@wp.func
def bilinear(a: Any, b: Any, c: Any, d: Any):
    """Values at four corners (0, 0), (1, 0), (0, 1), (1, 1) to the four Gauss points in that order; symmetric."""
    gauss = type(a[0])(GAUSS)
    s = gauss * (b - a)
    t = gauss * (d - c)
    p = a + s
    q = b - s
    r = c + t
    o = d - t
    u = gauss * (r - p)
    v = gauss * (o - q)
    return p + u, q + v, r - u, o - v


@wp.func
def along(plane: LaneArray, at: wp.int32, n_u: wp.int32, n_uv: wp.int32, none: Any):
    """Derivatives (12) of a trilinear function, 4 along each parameter at the Gauss points of the other two."""
    a = plane[at]
    b = plane[at + 1]
    c = plane[at + n_u + 1]
    d = plane[at + n_u]
    p = plane[at + n_uv]
    q = plane[at + n_uv + 1]
    r = plane[at + n_uv + n_u + 1]
    s = plane[at + n_uv + n_u]
    u0, u1, u2, u3 = bilinear(b - a, c - d, q - p, r - s)
    v0, v1, v2, v3 = bilinear(d - a, c - b, s - p, r - q)
    w0, w1, w2, w3 = bilinear(p - a, q - b, s - d, r - c)
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
def store_vertices(d: Any, c: wp.int32, at: wp.int32, n_u: wp.int32, n_v: wp.int32, out: LaneArray):
    """The transpose of ``along`` of component c; ``at`` is where the block of the nodes of vertex 0 begins."""
    u0, u1, u2, u3 = bilinear(d[0], d[1], d[2], d[3])
    v0, v1, v2, v3 = bilinear(d[4], d[5], d[6], d[7])
    w0, w1, w2, w3 = bilinear(d[8], d[9], d[10], d[11])
    a = at + 2 * c * n_u
    b = a + 30 * n_u  # the next row of nodes, and there the next 6 of its 24
    e = a + (24 * n_v + 12) * n_u
    f = e + 30 * n_u
    out[a] = -u0 - v0 - w0
    out[a + n_u + 1] = u0 - v1 - w1
    out[b] = v0 - u1 - w2
    out[b + n_u + 1] = u1 + v1 - w3
    out[e] = w0 - u2 - v2
    out[e + n_u + 1] = u2 - v3 + w1
    out[f] = v2 - u3 + w2
    out[f + n_u + 1] = u3 + v3 + w3


# Left a loop over Gauss points: unrolled, a CPU's compiler works on it for most of a minute, for nothing.
@wp.kernel(enable_backward=False, module="unique", module_options={"max_unroll": 1})
def shares(
    points: LaneArray,
    displacement: LaneArray,
    n_u: wp.int32,
    n_v: wp.int32,
    n_w: wp.int32,
    lam: LaneArray,
    mu: LaneArray,
    out: LaneArray,
    first: wp.int32,
    lanes: wp.int32,
):
    """Shares of the nodes' forces; launched over (n_w - 1, n_v - 1, n_u - 1) elements."""
    tid_k, row, item = wp.tid()
    layer = tid_k + first
    column = wp.min(item * lanes, n_u - 1 - lanes)
    n_uv = n_u * n_v
    n = n_uv * n_w
    m = (n_u - 1) * (n_v - 1) * (n_w - 1)
    at = layer * n_uv + row * n_u + column
    zero = type(points[at][0])(0.0)
    nil = wp.vector(zero, zero, zero, zero, zero, zero, zero, zero, zero, zero, zero, zero)
    none = wp.outer(nil, out.dtype(zero))
    x = along(points, at, n_u, n_uv, none)
    y = along(points, n + at, n_u, n_uv, none)
    z = along(points, 2 * n + at, n_u, n_uv, none)
    hx = along(displacement, at, n_u, n_uv, none)
    hy = along(displacement, n + at, n_u, n_uv, none)
    hz = along(displacement, 2 * n + at, n_u, n_uv, none)
    fx = none
    fy = none
    fz = none
    weight = out.dtype(type(points[at][0])(WEIGHT))
    g = (layer * (n_v - 1) + row) * (n_u - 1) + column
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
                g = g + m
    block = 24 * (layer * n_v + row) * n_u + column
    store_vertices(fx, 0, block, n_u, n_v, out)
    store_vertices(fy, 1, block, n_u, n_v, out)
    store_vertices(fz, 2, block, n_u, n_v, out)


@wp.kernel(enable_backward=False, module="unique")
def sum_shares(
    values: LaneArray,
    free: LaneArray,
    n_u: wp.int32,
    n_rows: wp.int32,
    out: LaneArray,
    first: wp.int32,
    lanes: wp.int32,
):
    """Forces (3, n) from the shares, 0 where ``free`` (3, n) is 0; launched over (n_rows, n_u) nodes."""
    tid_row, item = wp.tid()
    row = tid_row + first
    i = wp.min(item * lanes, n_u - lanes)
    for c in range(3):
        a = (24 * row + 2 * c) * n_u + i
        b = a + 6 * n_u
        e = b + 6 * n_u
        f = e + 6 * n_u
        low = (values[a] + values[a + n_u]) + (values[b] + values[b + n_u])
        high = (values[e] + values[e + n_u]) + (values[f] + values[f + n_u])
        at = (c * n_rows + row) * n_u + i
        out[at] = wp.cw_mul(low + high, free[at])
