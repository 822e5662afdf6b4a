"""Scaled Jacobian of quads and hexes (eqs 3.4 and 3.5 of the paper).

At each corner the determinant of the unit edge vectors, for the element the least of its corners. A corner with an edge
of no length counts 0. Source: Knupp 2000; quads in space as the Verdict library defines them, against the normal at the
centre.

Coordinates are lanes (``kernels/lanes.py``): lane l of a vector belongs to the element l further on in the row.
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
def unit_edge(x: LaneArray, y: LaneArray, z: LaneArray, start: wp.int32, end: wp.int32):
    ex, ey, ez = unit(x[end] - x[start], y[end] - y[start], z[end] - z[start])
    return ex, ey, ez


@wp.func
def det3(ax: Any, ay: Any, az: Any, bx: Any, by: Any, bz: Any, cx: Any, cy: Any, cz: Any):
    first = wp.cw_mul(ax, wp.cw_mul(by, cz) - wp.cw_mul(bz, cy))
    second = wp.cw_mul(ay, wp.cw_mul(bz, cx) - wp.cw_mul(bx, cz))
    return first + second + wp.cw_mul(az, wp.cw_mul(bx, cy) - wp.cw_mul(by, cx))


@wp.func
def hex_corners(
    x: LaneArray,
    y: LaneArray,
    z: LaneArray,
    n0: wp.int32,
    n1: wp.int32,
    n2: wp.int32,
    n3: wp.int32,
    n4: wp.int32,
    n5: wp.int32,
    n6: wp.int32,
    n7: wp.int32,
):
    """Determinants at corners 0 to 3 round one face, 4 to 7 over them."""
    u0, u1, u2 = unit_edge(x, y, z, n0, n1)
    v0, v1, v2 = unit_edge(x, y, z, n0, n3)
    w0, w1, w2 = unit_edge(x, y, z, n0, n4)
    c0 = det3(u0, u1, u2, v0, v1, v2, w0, w1, w2)
    s0, s1, s2 = unit_edge(x, y, z, n1, n2)
    t0, t1, t2 = unit_edge(x, y, z, n1, n5)
    c1 = det3(u0, u1, u2, s0, s1, s2, t0, t1, t2)
    p0, p1, p2 = unit_edge(x, y, z, n3, n2)
    q0, q1, q2 = unit_edge(x, y, z, n2, n6)
    c2 = det3(p0, p1, p2, s0, s1, s2, q0, q1, q2)
    r0, r1, r2 = unit_edge(x, y, z, n3, n7)
    c3 = det3(p0, p1, p2, v0, v1, v2, r0, r1, r2)
    a0, a1, a2 = unit_edge(x, y, z, n4, n5)
    b0, b1, b2 = unit_edge(x, y, z, n4, n7)
    c4 = det3(a0, a1, a2, b0, b1, b2, w0, w1, w2)
    d0, d1, d2 = unit_edge(x, y, z, n5, n6)
    c5 = det3(a0, a1, a2, d0, d1, d2, t0, t1, t2)
    e0, e1, e2 = unit_edge(x, y, z, n7, n6)
    c6 = det3(e0, e1, e2, d0, d1, d2, q0, q1, q2)
    c7 = det3(e0, e1, e2, b0, b1, b2, r0, r1, r2)
    return c0, c1, c2, c3, c4, c5, c6, c7


@wp.func
def quad_corners(x: LaneArray, y: LaneArray, z: LaneArray, n0: wp.int32, n1: wp.int32, n2: wp.int32, n3: wp.int32):
    a0, a1, a2 = unit_edge(x, y, z, n0, n1)
    b0, b1, b2 = unit_edge(x, y, z, n1, n2)
    c0, c1, c2 = unit_edge(x, y, z, n2, n3)
    d0, d1, d2 = unit_edge(x, y, z, n3, n0)
    s0 = (x[n1] - x[n0]) - (x[n3] - x[n2])
    s1 = (y[n1] - y[n0]) - (y[n3] - y[n2])
    s2 = (z[n1] - z[n0]) - (z[n3] - z[n2])
    t0 = (x[n2] - x[n1]) - (x[n0] - x[n3])
    t1 = (y[n2] - y[n1]) - (y[n0] - y[n3])
    t2 = (z[n2] - z[n1]) - (z[n0] - z[n3])
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
def hex_of(x: LaneArray, y: LaneArray, z: LaneArray, cells: wp.array(dtype=wp.int32), c: wp.int32):
    k = c * 8
    c0, c1, c2, c3, c4, c5, c6, c7 = hex_corners(
        x,
        y,
        z,
        cells[k],
        cells[k + 1],
        cells[k + 2],
        cells[k + 3],
        cells[k + 4],
        cells[k + 5],
        cells[k + 6],
        cells[k + 7],
    )
    return c0, c1, c2, c3, c4, c5, c6, c7


@wp.func
def quad_of(x: LaneArray, y: LaneArray, z: LaneArray, cells: wp.array(dtype=wp.int32), c: wp.int32):
    k = c * 4
    c0, c1, c2, c3 = quad_corners(x, y, z, cells[k], cells[k + 1], cells[k + 2], cells[k + 3])
    return c0, c1, c2, c3


@wp.kernel(enable_backward=False, module="unique")
def hex_scaled_jacobian(
    x: LaneArray,
    y: LaneArray,
    z: LaneArray,
    cells: wp.array(dtype=wp.int32),
    n_cells: wp.int32,
    out: LaneArray,
    first: wp.int32,
):
    c = wp.tid() + first
    c0, c1, c2, c3, c4, c5, c6, c7 = hex_of(x, y, z, cells, c)
    out[c] = wp.min(least4(c0, c1, c2, c3), least4(c4, c5, c6, c7))


@wp.kernel(enable_backward=False, module="unique")
def quad_scaled_jacobian(
    x: LaneArray,
    y: LaneArray,
    z: LaneArray,
    cells: wp.array(dtype=wp.int32),
    n_cells: wp.int32,
    out: LaneArray,
    first: wp.int32,
):
    c = wp.tid() + first
    c0, c1, c2, c3 = quad_of(x, y, z, cells, c)
    out[c] = least4(c0, c1, c2, c3)


@wp.kernel(enable_backward=False, module="unique")
def hex_corner_jacobian(
    x: LaneArray,
    y: LaneArray,
    z: LaneArray,
    cells: wp.array(dtype=wp.int32),
    n_cells: wp.int32,
    out: LaneArray,
    first: wp.int32,
):
    """out: (8, n_cells) planes."""
    c = wp.tid() + first
    c0, c1, c2, c3, c4, c5, c6, c7 = hex_of(x, y, z, cells, c)
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
    x: LaneArray,
    y: LaneArray,
    z: LaneArray,
    cells: wp.array(dtype=wp.int32),
    n_cells: wp.int32,
    out: LaneArray,
    first: wp.int32,
):
    """out: (4, n_cells) planes."""
    c = wp.tid() + first
    c0, c1, c2, c3 = quad_of(x, y, z, cells, c)
    out[c] = c0
    out[n_cells + c] = c1
    out[2 * n_cells + c] = c2
    out[3 * n_cells + c] = c3


@wp.kernel(enable_backward=False, module="unique")
def hex_scaled_jacobian_structured(
    x: LaneArray,
    y: LaneArray,
    z: LaneArray,
    n_u: wp.int32,
    n_v: wp.int32,
    n_w: wp.int32,
    out: LaneArray,
    first: wp.int32,
    lanes: wp.int32,
):
    """Nodes n_u x n_v x n_w, u fastest; launched over (n_w - 1, n_v - 1, n_u - 1) cells."""
    tid_k, j, item = wp.tid()
    k = tid_k + first
    i = wp.min(item * lanes, n_u - 1 - lanes)
    a = (k * n_v + j) * n_u + i
    b = a + n_u
    c = a + n_u * n_v
    d = c + n_u
    c0, c1, c2, c3, c4, c5, c6, c7 = hex_corners(x, y, z, a, a + 1, b + 1, b, c, c + 1, d + 1, d)
    out[(k * (n_v - 1) + j) * (n_u - 1) + i] = wp.min(least4(c0, c1, c2, c3), least4(c4, c5, c6, c7))


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
    c0, c1, c2, c3 = quad_corners(x, y, z, a, a + 1, b + 1, b)
    out[j * (n_u - 1) + i] = least4(c0, c1, c2, c3)
