"""Scaled Jacobian of quads and hexes (eqs 3.4 and 3.5 of the paper).

At each corner the determinant of the unit edge vectors, for the element the least of its corners. A corner with an edge
of no length counts 0. Source: Knupp 2000; quads in space as the Verdict library defines them, against the normal at the
centre.

Coordinates are lanes (``kernels/lanes.py``): lane l of a vector belongs to the element l further on in the row, or in
the table of elements.
"""

from typing import Any

import warp as wp

from gpubspline.kernels.lanes import LaneArray, inverse_root


@wp.func
def squared(x: Any, y: Any, z: Any):
    return wp.cw_mul(x, x) + wp.cw_mul(y, y) + wp.cw_mul(z, z)


@wp.func
def unit(x: Any, y: Any, z: Any):
    inverse = inverse_root(squared(x, y, z))
    return wp.cw_mul(x, inverse), wp.cw_mul(y, inverse), wp.cw_mul(z, inverse)


@wp.func
def unit_edge(ax: Any, ay: Any, az: Any, bx: Any, by: Any, bz: Any):
    ex, ey, ez = unit(bx - ax, by - ay, bz - az)
    return ex, ey, ez


@wp.func
def det3(ax: Any, ay: Any, az: Any, bx: Any, by: Any, bz: Any, cx: Any, cy: Any, cz: Any):
    first = wp.cw_mul(ax, wp.cw_mul(by, cz) - wp.cw_mul(bz, cy))
    second = wp.cw_mul(ay, wp.cw_mul(bz, cx) - wp.cw_mul(bx, cz))
    return first + second + wp.cw_mul(az, wp.cw_mul(bx, cy) - wp.cw_mul(by, cx))


@wp.func
def edge(ax: Any, ay: Any, az: Any, bx: Any, by: Any, bz: Any):
    """An edge and one over its length, 0 where it has none."""
    ex = bx - ax
    ey = by - ay
    ez = bz - az
    return ex, ey, ez, inverse_root(squared(ex, ey, ez))


@wp.func
def corner(ux: Any, uy: Any, uz: Any, u: Any, vx: Any, vy: Any, vz: Any, v: Any, wx: Any, wy: Any, wz: Any, w: Any):
    """Determinant of three edges over their lengths, which are brought in last, since roots take long."""
    vw = wp.cw_mul(v, w)
    first = wp.cw_mul(ux, wp.cw_mul(vw, wp.cw_mul(vy, wz) - wp.cw_mul(vz, wy)))
    second = wp.cw_mul(uy, wp.cw_mul(vw, wp.cw_mul(vz, wx) - wp.cw_mul(vx, wz)))
    third = wp.cw_mul(uz, wp.cw_mul(vw, wp.cw_mul(vx, wy) - wp.cw_mul(vy, wx)))
    return wp.cw_mul(u, first + second + third)


@wp.func
def hex_corners(
    x0: Any,
    y0: Any,
    z0: Any,
    x1: Any,
    y1: Any,
    z1: Any,
    x2: Any,
    y2: Any,
    z2: Any,
    x3: Any,
    y3: Any,
    z3: Any,
    x4: Any,
    y4: Any,
    z4: Any,
    x5: Any,
    y5: Any,
    z5: Any,
    x6: Any,
    y6: Any,
    z6: Any,
    x7: Any,
    y7: Any,
    z7: Any,
):
    """Determinants at corners 0 to 3 round one face, 4 to 7 over them."""
    u0, u1, u2, u = edge(x0, y0, z0, x1, y1, z1)
    v0, v1, v2, v = edge(x0, y0, z0, x3, y3, z3)
    w0, w1, w2, w = edge(x0, y0, z0, x4, y4, z4)
    c0 = corner(u0, u1, u2, u, v0, v1, v2, v, w0, w1, w2, w)
    s0, s1, s2, s = edge(x1, y1, z1, x2, y2, z2)
    t0, t1, t2, t = edge(x1, y1, z1, x5, y5, z5)
    c1 = corner(u0, u1, u2, u, s0, s1, s2, s, t0, t1, t2, t)
    p0, p1, p2, p = edge(x3, y3, z3, x2, y2, z2)
    q0, q1, q2, q = edge(x2, y2, z2, x6, y6, z6)
    c2 = corner(p0, p1, p2, p, s0, s1, s2, s, q0, q1, q2, q)
    r0, r1, r2, r = edge(x3, y3, z3, x7, y7, z7)
    c3 = corner(p0, p1, p2, p, v0, v1, v2, v, r0, r1, r2, r)
    a0, a1, a2, a = edge(x4, y4, z4, x5, y5, z5)
    b0, b1, b2, b = edge(x4, y4, z4, x7, y7, z7)
    c4 = corner(a0, a1, a2, a, b0, b1, b2, b, w0, w1, w2, w)
    d0, d1, d2, d = edge(x5, y5, z5, x6, y6, z6)
    c5 = corner(a0, a1, a2, a, d0, d1, d2, d, t0, t1, t2, t)
    e0, e1, e2, e = edge(x7, y7, z7, x6, y6, z6)
    c6 = corner(e0, e1, e2, e, d0, d1, d2, d, q0, q1, q2, q)
    c7 = corner(e0, e1, e2, e, b0, b1, b2, b, r0, r1, r2, r)
    return c0, c1, c2, c3, c4, c5, c6, c7


@wp.func
def quad_corners(
    x0: Any,
    y0: Any,
    z0: Any,
    x1: Any,
    y1: Any,
    z1: Any,
    x2: Any,
    y2: Any,
    z2: Any,
    x3: Any,
    y3: Any,
    z3: Any,
):
    """Determinants at corners 0 to 3."""
    a0, a1, a2 = unit_edge(x0, y0, z0, x1, y1, z1)
    b0, b1, b2 = unit_edge(x1, y1, z1, x2, y2, z2)
    c0, c1, c2 = unit_edge(x2, y2, z2, x3, y3, z3)
    d0, d1, d2 = unit_edge(x3, y3, z3, x0, y0, z0)
    s0 = (x1 - x0) - (x3 - x2)
    s1 = (y1 - y0) - (y3 - y2)
    s2 = (z1 - z0) - (z3 - z2)
    t0 = (x2 - x1) - (x0 - x3)
    t1 = (y2 - y1) - (y0 - y3)
    t2 = (z2 - z1) - (z0 - z3)
    m0, m1, m2 = unit(
        wp.cw_mul(s1, t2) - wp.cw_mul(s2, t1),
        wp.cw_mul(s2, t0) - wp.cw_mul(s0, t2),
        wp.cw_mul(s0, t1) - wp.cw_mul(s1, t0),
    )
    return (
        det3(m0, m1, m2, d0, d1, d2, a0, a1, a2),
        det3(m0, m1, m2, a0, a1, a2, b0, b1, b2),
        det3(m0, m1, m2, b0, b1, b2, c0, c1, c2),
        det3(m0, m1, m2, c0, c1, c2, d0, d1, d2),
    )


@wp.func
def least4(a: Any, b: Any, c: Any, d: Any):
    return wp.min(wp.min(a, b), wp.min(c, d))


@wp.func
def least8(c0: Any, c1: Any, c2: Any, c3: Any, c4: Any, c5: Any, c6: Any, c7: Any):
    """The least of a hex's corners; no number where a node is none.

    Then corner 0 is, or corner 6, whose edges have all nodes of the hex; the least of the others would be some number.
    """
    return wp.min(least4(c0, c1, c2, c3), least4(c4, c5, c6, c7)) + (c0 - c0) + (c6 - c6)


@wp.func
def corner_nodes(
    nodes: wp.array(dtype=Any),
    cells: wp.array(dtype=wp.int32),
    corners: wp.int32,
    c: wp.int32,
    corner: wp.int32,
    like: Any,
):
    """One of the corners of the cells c and on."""
    x = type(like)()
    y = type(like)()
    z = type(like)()
    for lane in range(len(like)):
        node = 4 * cells[corners * (c + lane) + corner]
        x[lane] = nodes[node]
        y[lane] = nodes[node + 1]
        z[lane] = nodes[node + 2]
    return x, y, z


@wp.func
def corners_of_hexes(nodes: wp.array(dtype=Any), cells: wp.array(dtype=wp.int32), c: wp.int32, like: Any):
    """Determinants at the corners of the cells c and on."""
    x0, y0, z0 = corner_nodes(nodes, cells, 8, c, 0, like)
    x1, y1, z1 = corner_nodes(nodes, cells, 8, c, 1, like)
    x2, y2, z2 = corner_nodes(nodes, cells, 8, c, 2, like)
    x3, y3, z3 = corner_nodes(nodes, cells, 8, c, 3, like)
    x4, y4, z4 = corner_nodes(nodes, cells, 8, c, 4, like)
    x5, y5, z5 = corner_nodes(nodes, cells, 8, c, 5, like)
    x6, y6, z6 = corner_nodes(nodes, cells, 8, c, 6, like)
    x7, y7, z7 = corner_nodes(nodes, cells, 8, c, 7, like)
    c0, c1, c2, c3, c4, c5, c6, c7 = hex_corners(
        x0, y0, z0, x1, y1, z1, x2, y2, z2, x3, y3, z3, x4, y4, z4, x5, y5, z5, x6, y6, z6, x7, y7, z7
    )
    return c0, c1, c2, c3, c4, c5, c6, c7


@wp.func
def corners_of_quads(nodes: wp.array(dtype=Any), cells: wp.array(dtype=wp.int32), c: wp.int32, like: Any):
    """Determinants at the corners of the cells c and on."""
    x0, y0, z0 = corner_nodes(nodes, cells, 4, c, 0, like)
    x1, y1, z1 = corner_nodes(nodes, cells, 4, c, 1, like)
    x2, y2, z2 = corner_nodes(nodes, cells, 4, c, 2, like)
    x3, y3, z3 = corner_nodes(nodes, cells, 4, c, 3, like)
    c0, c1, c2, c3 = quad_corners(x0, y0, z0, x1, y1, z1, x2, y2, z2, x3, y3, z3)
    return c0, c1, c2, c3


@wp.kernel(enable_backward=False, module="unique")
def interleave(
    x: wp.array(dtype=Any),
    y: wp.array(dtype=Any),
    z: wp.array(dtype=Any),
    n_nodes: wp.int32,
    nodes: wp.array(dtype=Any),
    first: wp.int32,
):
    """nodes: (n_nodes, 4), the fourth is 0."""
    i = wp.tid() + first
    nodes[4 * i] = x[i]
    nodes[4 * i + 1] = y[i]
    nodes[4 * i + 2] = z[i]
    nodes[4 * i + 3] = nodes.dtype(0.0)


@wp.kernel(enable_backward=False, module="unique")
def hex_scaled_jacobian(
    nodes: wp.array(dtype=Any),
    cells: wp.array(dtype=wp.int32),
    n_cells: wp.int32,
    out: LaneArray,
    first: wp.int32,
    lanes: wp.int32,
):
    c = wp.min((wp.tid() + first) * lanes, n_cells - lanes)
    c0, c1, c2, c3, c4, c5, c6, c7 = corners_of_hexes(nodes, cells, c, out.dtype())
    out[c] = least8(c0, c1, c2, c3, c4, c5, c6, c7)


@wp.kernel(enable_backward=False, module="unique")
def quad_scaled_jacobian(
    nodes: wp.array(dtype=Any),
    cells: wp.array(dtype=wp.int32),
    n_cells: wp.int32,
    out: LaneArray,
    first: wp.int32,
    lanes: wp.int32,
):
    c = wp.min((wp.tid() + first) * lanes, n_cells - lanes)
    c0, c1, c2, c3 = corners_of_quads(nodes, cells, c, out.dtype())
    out[c] = least4(c0, c1, c2, c3)


@wp.kernel(enable_backward=False, module="unique")
def hex_corner_jacobian(
    nodes: wp.array(dtype=Any),
    cells: wp.array(dtype=wp.int32),
    n_cells: wp.int32,
    out: LaneArray,
    first: wp.int32,
    lanes: wp.int32,
):
    """out: (8, n_cells) planes."""
    c = wp.min((wp.tid() + first) * lanes, n_cells - lanes)
    c0, c1, c2, c3, c4, c5, c6, c7 = corners_of_hexes(nodes, cells, c, out.dtype())
    out[c] = c0
    out[n_cells + c] = c1
    out[2 * n_cells + c] = c2
    out[3 * n_cells + c] = c3
    out[4 * n_cells + c] = c4
    out[5 * n_cells + c] = c5
    out[6 * n_cells + c] = c6
    out[7 * n_cells + c] = c7


@wp.kernel(enable_backward=False, module="unique")
def quad_corner_jacobian(
    nodes: wp.array(dtype=Any),
    cells: wp.array(dtype=wp.int32),
    n_cells: wp.int32,
    out: LaneArray,
    first: wp.int32,
    lanes: wp.int32,
):
    """out: (4, n_cells) planes."""
    c = wp.min((wp.tid() + first) * lanes, n_cells - lanes)
    c0, c1, c2, c3 = corners_of_quads(nodes, cells, c, out.dtype())
    out[c] = c0
    out[n_cells + c] = c1
    out[2 * n_cells + c] = c2
    out[3 * n_cells + c] = c3


@wp.kernel(enable_backward=False, module="unique")
def quad_scaled_jacobian_structured(
    x: LaneArray,
    y: LaneArray,
    z: LaneArray,
    n_u: wp.int32,
    n_v: wp.int32,
    out: LaneArray,
    first: wp.int32,
    lanes: wp.int32,
):
    """Nodes n_u x n_v, u fastest; launched over (n_v - 1, n_u - 1) cells."""
    tid_j, item = wp.tid()
    j = tid_j + first
    i = wp.min(item * lanes, n_u - 1 - lanes)
    a = j * n_u + i
    b = a + n_u
    c0, c1, c2, c3 = quad_corners(
        x[a], y[a], z[a], x[a + 1], y[a + 1], z[a + 1], x[b + 1], y[b + 1], z[b + 1], x[b], y[b], z[b]
    )
    out[j * (n_u - 1) + i] = least4(c0, c1, c2, c3)
