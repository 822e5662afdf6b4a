"""Linear elasticity of a structured mesh of hex8: K u by rows of elements, without connectivity, matrix or gather.

The mathematics, 2 x 2 x 2 Gauss points and names are those of ``elasticity.py``. Nodes are n_u x n_v x n_w, u fastest,
so that the vertices a of a run of elements along u lie side by side in the planes: all is in lanes (``lanes.py``), lane
l being the element l further on in the row. Derivatives are 12 a component: 4 along u, 4 along v, 4 along w.

A GPU takes each element alone: what elements give their nodes goes into ``shares`` (n_w, n_v, 4, 3, 2, n_u): of each
row of nodes what comes from elements on its 4 sides, a component after the other, from the right and from the left of
each node. No two elements write the same number, and what none writes must be 0. The force on a node is the sum of its
8, always in this order.

A CPU takes ``size`` x ``size`` rows of elements at a time, a brick, and sums in its caches what they give their nodes:
``bricks`` (bricks along w, along v, 3, size + 1, size + 1, n_u). The force on a node is the sum of its 1, 2 or 4. Rows
of a brick are short and many lie side by side, more than a processor fetches by itself: it is told which come next.
"""

from typing import Any

import warp as wp

from gpubspline.kernels.lanes import FUSED, REGISTER_BYTES, LaneArray, fetch

NEAR = wp.constant(wp.float64(0.21132486540518711775))  # (1 - 1 / sqrt 3) / 2, the nearer Gauss point
FAR = wp.constant(wp.float64(0.78867513459481288225))
WEIGHT = wp.constant(wp.float64(0.125))

REGISTER = REGISTER_BYTES


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
def vertices(d: Any):
    """The transpose of ``along``: what the vertices get, u fastest."""
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
def store_vertices(d: Any, at: wp.int32, n_u: wp.int32, n_v: wp.int32, out: LaneArray):
    """Write the shares of a component; ``at`` is where it begins in the block of the nodes of vertex 0."""
    f0, f1, f2, f3, f4, f5, f6, f7 = vertices(d)
    b = at + 30 * n_u  # the next row of nodes, and there the next 6 of its 24
    e = at + (24 * n_v + 12) * n_u
    f = e + 30 * n_u
    out[at] = f0
    out[at + n_u + 1] = f1
    out[b] = f2
    out[b + n_u + 1] = f3
    out[e] = f4
    out[e + n_u + 1] = f5
    out[f] = f6
    out[f + n_u + 1] = f7


@wp.func
def add_vertices(d: Any, at: wp.int32, n_u: wp.int32, deep: wp.int32, out: LaneArray):
    """Add a component to the sums of a brick; ``at`` is vertex 0."""
    f0, f1, f2, f3, f4, f5, f6, f7 = vertices(d)
    b = at + n_u
    e = at + deep
    f = e + n_u
    out[at] = out[at] + f0
    out[b] = out[b] + f2
    out[e] = out[e] + f4
    out[f] = out[f] + f6
    out[at + 1] = out[at + 1] + f1
    out[b + 1] = out[b + 1] + f3
    out[e + 1] = out[e + 1] + f5
    out[f + 1] = out[f + 1] + f7


@wp.func
def forces_of(
    points: LaneArray,
    displacement: LaneArray,
    at: wp.int32,
    n_u: wp.int32,
    n_uv: wp.int32,
    n: wp.int32,
    lam: LaneArray,
    mu: LaneArray,
    place: wp.int32,
    n_e: wp.int32,
    weight: Any,
):
    """Forces against the derivatives, 12 a component, of elements whose vertices 0 are the nodes from ``at`` on.

    ``place`` is the first of the elements, ``weight`` that of a Gauss point for each.
    """
    zero = type(points[at][0])(0.0)
    nil = wp.vector(zero, zero, zero, zero, zero, zero, zero, zero, zero, zero, zero, zero)
    none = wp.outer(nil, weight)
    x = along(points, at, n_u, n_uv, none)
    y = along(points, n + at, n_u, n_uv, none)
    z = along(points, 2 * n + at, n_u, n_uv, none)
    hx = along(displacement, at, n_u, n_uv, none)
    hy = along(displacement, n + at, n_u, n_uv, none)
    hz = along(displacement, 2 * n + at, n_u, n_uv, none)
    fx = none
    fy = none
    fz = none
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
                g = g + n_e
    return fx, fy, fz


# Left a loop over Gauss points: unrolled, a CPU's compiler works on it for most of a minute, for nothing.
@wp.kernel(enable_backward=False, module="unique", module_options={"max_unroll": 1, "cpu_compiler_flags": FUSED})
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
    at = layer * n_uv + row * n_u + column
    place = (layer * (n_v - 1) + row) * (n_u - 1) + column
    n_e = (n_u - 1) * (n_v - 1) * (n_w - 1)
    weight = out.dtype(type(points[0][0])(WEIGHT))
    fx, fy, fz = forces_of(points, displacement, at, n_u, n_uv, n_uv * n_w, lam, mu, place, n_e, weight)
    block = 24 * (layer * n_v + row) * n_u + column
    store_vertices(fx, block, n_u, n_v, out)
    store_vertices(fy, block + 2 * n_u, n_u, n_v, out)
    store_vertices(fz, block + 4 * n_u, n_u, n_v, out)


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


@wp.func
def fetch_rows(
    points: LaneArray,
    displacement: LaneArray,
    at: wp.int32,
    n_u: wp.int32,
    n_uv: wp.int32,
    n: wp.int32,
    lam: LaneArray,
    mu: LaneArray,
    place: wp.int32,
    n_e: wp.int32,
):
    """Ask for the nodes two rows on of the layer above, and for the moduli of the next row."""
    node = at + n_uv + 2 * n_u
    for _component in range(3):
        fetch(points, node)
        fetch(displacement, node)
        node = node + n
    element = place + n_u - 1
    for _point in range(8):
        fetch(lam, element)
        fetch(mu, element)
        element = element + n_e


@wp.kernel(enable_backward=False, module="unique", module_options={"max_unroll": 1, "cpu_compiler_flags": FUSED})
def bricks(
    points: LaneArray,
    displacement: LaneArray,
    n_u: wp.int32,
    n_v: wp.int32,
    n_w: wp.int32,
    lam: LaneArray,
    mu: LaneArray,
    size: wp.int32,
    out: LaneArray,
    first: wp.int32,
    lanes: wp.int32,
):
    """Sums of bricks of ``size`` x ``size`` rows; launched over (bricks along w, along v, n_u - 1).

    The first work item of a brick takes it all.
    """
    tid_w, brick_v, item = wp.tid()
    brick_w = tid_w + first
    if item > 0:
        return
    n_uv = n_u * n_v
    n = n_uv * n_w
    n_e = (n_u - 1) * (n_v - 1) * (n_w - 1)
    deep = (size + 1) * n_u
    component = (size + 1) * deep
    block = (brick_w * ((n_v - 2) / size + 1) + brick_v) * 3 * component
    for i in range(0, 3 * component, lanes):
        out[block + wp.min(i, 3 * component - lanes)] = out.dtype(type(points[0][0])(0.0))
    for layer in range(brick_w * size, wp.min(brick_w * size + size, n_w - 1)):
        for row in range(brick_v * size, wp.min(brick_v * size + size, n_v - 1)):
            for begin in range(0, n_u - 1, lanes):
                column = wp.min(begin, n_u - 1 - lanes)
                at = layer * n_uv + row * n_u + column
                place = (layer * (n_v - 1) + row) * (n_u - 1) + column
                weight = out.dtype(type(points[0][0])(WEIGHT))
                for lane in range(begin - column):  # what the vector before this has
                    weight[lane] = type(points[0][0])(0.0)
                fetch_rows(points, displacement, at, n_u, n_uv, n, lam, mu, place, n_e)
                fx, fy, fz = forces_of(points, displacement, at, n_u, n_uv, n, lam, mu, place, n_e, weight)
                to = block + (layer - brick_w * size) * deep + (row - brick_v * size) * n_u + column
                add_vertices(fx, to, n_u, deep, out)
                add_vertices(fy, to + component, n_u, deep, out)
                add_vertices(fz, to + 2 * component, n_u, deep, out)


@wp.kernel(enable_backward=False, module="unique")
def sum_bricks(
    values: LaneArray,
    free: LaneArray,
    n_u: wp.int32,
    n_v: wp.int32,
    n_w: wp.int32,
    size: wp.int32,
    out: LaneArray,
    first: wp.int32,
    lanes: wp.int32,
):
    """Forces (3, n) from the bricks, 0 where ``free`` (3, n) is 0; launched over (n_w, n_v, n_u) nodes."""
    tid_k, row, item = wp.tid()
    layer = tid_k + first
    i = wp.min(item * lanes, n_u - lanes)
    along_v = (n_v - 2) / size + 1
    last_w = wp.min(layer / size, (n_w - 2) / size)
    deep = (size + 1) * n_u
    component = (size + 1) * deep
    for c in range(3):
        total = out.dtype(type(values[0][0])(0.0))
        for q in range(wp.max(layer - 1, 0) / size, last_w + 1):
            for p in range(wp.max(row - 1, 0) / size, wp.min(row / size, along_v - 1) + 1):
                block = (3 * (q * along_v + p) + c) * component
                total = total + values[block + (layer - q * size) * deep + (row - p * size) * n_u + i]
        at = ((c * n_w + layer) * n_v + row) * n_u + i
        out[at] = wp.cw_mul(total, free[at])
