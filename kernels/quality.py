"""Scaled Jacobian of quads and hexes (eqs 3.4 and 3.5 of the paper).

At each corner the determinant of the unit edge vectors, for the element the least of its corners. A corner with an edge
of no length counts 0. Source: Knupp 2000; quads in space as the Verdict library defines them, against the normal at the
centre.
"""

from typing import Any

import warp as wp


@wp.func
def unit_edge(start: Any, end: Any):
    return wp.normalize(end - start)


@wp.func
def det3(a: Any, b: Any, c: Any):
    return wp.dot(a, wp.cross(b, c))


@wp.func
def hex_corners(p0: Any, p1: Any, p2: Any, p3: Any, p4: Any, p5: Any, p6: Any, p7: Any):
    """Determinants at corners 0 to 3 round one face, 4 to 7 over them."""
    u0 = unit_edge(p0, p1)
    u1 = unit_edge(p3, p2)
    u2 = unit_edge(p4, p5)
    u3 = unit_edge(p7, p6)
    v0 = unit_edge(p0, p3)
    v1 = unit_edge(p1, p2)
    v2 = unit_edge(p4, p7)
    v3 = unit_edge(p5, p6)
    w0 = unit_edge(p0, p4)
    w1 = unit_edge(p1, p5)
    w2 = unit_edge(p2, p6)
    w3 = unit_edge(p3, p7)
    return wp.vector(
        det3(u0, v0, w0),
        det3(u0, v1, w1),
        det3(u1, v1, w2),
        det3(u1, v0, w3),
        det3(u2, v2, w0),
        det3(u2, v3, w1),
        det3(u3, v3, w2),
        det3(u3, v2, w3),
    )


@wp.func
def quad_corners(p0: Any, p1: Any, p2: Any, p3: Any):
    e0 = unit_edge(p0, p1)
    e1 = unit_edge(p1, p2)
    e2 = unit_edge(p2, p3)
    e3 = unit_edge(p3, p0)
    normal = wp.normalize(wp.cross((p1 - p0) - (p3 - p2), (p2 - p1) - (p0 - p3)))
    return wp.vector(det3(normal, e3, e0), det3(normal, e0, e1), det3(normal, e1, e2), det3(normal, e2, e3))


@wp.func
def node(x: wp.array(dtype=Any), y: wp.array(dtype=Any), z: wp.array(dtype=Any), n: Any):
    return wp.vector(x[n], y[n], z[n])


@wp.func
def hex_of(
    x: wp.array(dtype=Any), y: wp.array(dtype=Any), z: wp.array(dtype=Any), cells: wp.array(dtype=wp.int32), c: wp.int32
):
    return hex_corners(
        node(x, y, z, cells[c * 8 + 0]),
        node(x, y, z, cells[c * 8 + 1]),
        node(x, y, z, cells[c * 8 + 2]),
        node(x, y, z, cells[c * 8 + 3]),
        node(x, y, z, cells[c * 8 + 4]),
        node(x, y, z, cells[c * 8 + 5]),
        node(x, y, z, cells[c * 8 + 6]),
        node(x, y, z, cells[c * 8 + 7]),
    )


@wp.func
def quad_of(
    x: wp.array(dtype=Any), y: wp.array(dtype=Any), z: wp.array(dtype=Any), cells: wp.array(dtype=wp.int32), c: wp.int32
):
    return quad_corners(
        node(x, y, z, cells[c * 4 + 0]),
        node(x, y, z, cells[c * 4 + 1]),
        node(x, y, z, cells[c * 4 + 2]),
        node(x, y, z, cells[c * 4 + 3]),
    )


@wp.kernel(enable_backward=False, module="unique")
def hex_scaled_jacobian(
    x: wp.array(dtype=Any),
    y: wp.array(dtype=Any),
    z: wp.array(dtype=Any),
    cells: wp.array(dtype=wp.int32),
    n_cells: wp.int32,
    out: wp.array(dtype=Any),
    first: wp.int32,
):
    c = wp.tid() + first
    out[c] = wp.min(hex_of(x, y, z, cells, c))


@wp.kernel(enable_backward=False, module="unique")
def quad_scaled_jacobian(
    x: wp.array(dtype=Any),
    y: wp.array(dtype=Any),
    z: wp.array(dtype=Any),
    cells: wp.array(dtype=wp.int32),
    n_cells: wp.int32,
    out: wp.array(dtype=Any),
    first: wp.int32,
):
    c = wp.tid() + first
    out[c] = wp.min(quad_of(x, y, z, cells, c))


@wp.kernel(enable_backward=False, module="unique")
def hex_corner_jacobian(
    x: wp.array(dtype=Any),
    y: wp.array(dtype=Any),
    z: wp.array(dtype=Any),
    cells: wp.array(dtype=wp.int32),
    n_cells: wp.int32,
    out: wp.array(dtype=Any),
    first: wp.int32,
):
    """out: (8, n_cells) planes."""
    c = wp.tid() + first
    corner = hex_of(x, y, z, cells, c)
    for n in range(8):
        out[n * n_cells + c] = corner[n]


@wp.kernel(enable_backward=False, module="unique")
def quad_corner_jacobian(
    x: wp.array(dtype=Any),
    y: wp.array(dtype=Any),
    z: wp.array(dtype=Any),
    cells: wp.array(dtype=wp.int32),
    n_cells: wp.int32,
    out: wp.array(dtype=Any),
    first: wp.int32,
):
    """out: (4, n_cells) planes."""
    c = wp.tid() + first
    corner = quad_of(x, y, z, cells, c)
    for n in range(4):
        out[n * n_cells + c] = corner[n]


@wp.kernel(enable_backward=False, module="unique")
def hex_scaled_jacobian_structured(
    x: wp.array(dtype=Any),
    y: wp.array(dtype=Any),
    z: wp.array(dtype=Any),
    n_u: wp.int32,
    n_v: wp.int32,
    n_w: wp.int32,
    out: wp.array(dtype=Any),
    first: wp.int32,
):
    """Nodes n_u x n_v x n_w, u fastest; launched over (n_w - 1, n_v - 1, n_u - 1) cells."""
    tid_k, j, i = wp.tid()
    k = tid_k + first
    low = (k * n_v + j) * n_u + i
    high = low + n_u * n_v
    corner = hex_corners(
        node(x, y, z, low),
        node(x, y, z, low + 1),
        node(x, y, z, low + n_u + 1),
        node(x, y, z, low + n_u),
        node(x, y, z, high),
        node(x, y, z, high + 1),
        node(x, y, z, high + n_u + 1),
        node(x, y, z, high + n_u),
    )
    out[(k * (n_v - 1) + j) * (n_u - 1) + i] = wp.min(corner)


@wp.kernel(enable_backward=False, module="unique")
def quad_scaled_jacobian_structured(
    x: wp.array(dtype=Any),
    y: wp.array(dtype=Any),
    z: wp.array(dtype=Any),
    n_u: wp.int32,
    n_v: wp.int32,
    out: wp.array(dtype=Any),
    first: wp.int32,
):
    """Nodes n_u x n_v, u fastest; launched over (n_v - 1, n_u - 1) cells."""
    tid_j, i = wp.tid()
    j = tid_j + first
    low = j * n_u + i
    corner = quad_corners(
        node(x, y, z, low), node(x, y, z, low + 1), node(x, y, z, low + n_u + 1), node(x, y, z, low + n_u)
    )
    out[j * (n_u - 1) + i] = wp.min(corner)
