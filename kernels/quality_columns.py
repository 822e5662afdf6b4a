"""Scaled Jacobian of structured hexes on a GPU: what cells along w and two rows of them share is worked out once."""

from typing import Any

import warp as wp

from gpubspline.kernels.lanes import element, root_of_inverse, set_element
from gpubspline.kernels.quality import least4

SHORTEST = wp.constant(1e-37)  # squared, of an edge
TILE = wp.constant(32)  # cells along u whose nodes a group of threads reads at once
TILE_ROWS = wp.constant(4)  # such tiles along v, of two cells each, which read the same nodes


@wp.func
def node(x: wp.array(dtype=Any), y: wp.array(dtype=Any), z: wp.array(dtype=Any), at: wp.int32):
    return wp.vector(element(x, at), element(y, at), element(z, at))


@wp.func
def inverse_length(edge: Any):
    """1 / length, and of an edge without length a number."""
    none = type(edge[0])(SHORTEST)
    return root_of_inverse(edge[0] * edge[0] + (edge[1] * edge[1] + (edge[2] * edge[2] + none)))


@wp.func
def unit_between(a: Any, b: Any):
    edge = b - a
    return edge * inverse_length(edge)


@wp.func
def normals(u: Any, v: Any, a: Any, b: Any):
    """Cross products at the nodes (0, 0), (1, 0), (0, 1), (1, 1) of a face with edges u, v along u and a, b along v."""
    return wp.cross(u, a), wp.cross(u, b), wp.cross(v, a), wp.cross(v, b)


@wp.func
def least_of_edge(edge: Any, inverse: Any, before: Any, behind: Any):
    return wp.min(wp.dot(edge, before), wp.dot(edge, behind)) * inverse


@wp.func
def least_of_four(a: Any, b: Any, c: Any, d: Any):
    """No number where one is none."""
    total = (a + b) + (c + d)
    return least4(a, b, c, d) + (total - total)


@wp.kernel(enable_backward=False, module="unique", launch_bounds=(256, 3))
def hex_scaled_jacobian(
    x: wp.array(dtype=Any),
    y: wp.array(dtype=Any),
    z: wp.array(dtype=Any),
    n_u: wp.int32,
    n_v: wp.int32,
    n_w: wp.int32,
    part: wp.int32,
    out: wp.array(dtype=Any),
    first: wp.int32,
):
    """Nodes n_u x n_v x n_w, u fastest; launched over (parts, bands * chunks * TILE_ROWS * TILE).

    A part is ``part`` cells along w, a band TILE_ROWS pairs of cells along v, a chunk TILE cells along u. A work item
    goes along w with two cells, one behind the other along v: edges that they share are worked out once, and so are the
    cross products of the faces between cells and those that follow. Six nodes, u fastest, are a to f here, and g, h, p
    to s in the next plane.
    """
    tid_part, item = wp.tid()
    n_chunks = (n_u - 1 + TILE - 1) // TILE
    tile = item // TILE
    i = tile // TILE_ROWS % n_chunks * TILE + item % TILE
    j = 2 * (tile // (TILE_ROWS * n_chunks) * TILE_ROWS + tile % TILE_ROWS)
    if i >= n_u - 1 or j >= n_v - 1:
        return
    k = (tid_part + first) * part
    end = wp.min(k + part, n_w - 1)
    on = wp.where(j + 2 < n_v, n_u, 0)  # to the nodes of the second cell, where there is one
    at = (k * n_v + j) * n_u + i
    to = (k * (n_v - 1) + j) * (n_u - 1) + i
    a = node(x, y, z, at)
    b = node(x, y, z, at + 1)
    c = node(x, y, z, at + n_u)
    d = node(x, y, z, at + n_u + 1)
    e = node(x, y, z, at + n_u + on)
    f = node(x, y, z, at + n_u + on + 1)
    u = unit_between(c, d)
    m0, m1, m2, m3 = normals(unit_between(a, b), u, unit_between(a, c), unit_between(b, d))
    m4, m5, m6, m7 = normals(u, unit_between(e, f), unit_between(c, e), unit_between(d, f))
    while k < end:
        at = at + n_u * n_v
        g = node(x, y, z, at)
        h = node(x, y, z, at + 1)
        p = node(x, y, z, at + n_u)
        q = node(x, y, z, at + n_u + 1)
        r = node(x, y, z, at + n_u + on)
        s = node(x, y, z, at + n_u + on + 1)
        u = unit_between(p, q)
        n0, n1, n2, n3 = normals(unit_between(g, h), u, unit_between(g, p), unit_between(h, q))
        n4, n5, n6, n7 = normals(u, unit_between(r, s), unit_between(p, r), unit_between(q, s))
        c = p - c
        d = q - d
        inverse_c = inverse_length(c)
        inverse_d = inverse_length(d)
        here = least_of_four(
            least_of_edge(g - a, inverse_length(g - a), m0, n0),
            least_of_edge(h - b, inverse_length(h - b), m1, n1),
            least_of_edge(c, inverse_c, m2, n2),
            least_of_edge(d, inverse_d, m3, n3),
        )
        behind = least_of_four(
            least_of_edge(c, inverse_c, m4, n4),
            least_of_edge(d, inverse_d, m5, n5),
            least_of_edge(r - e, inverse_length(r - e), m6, n6),
            least_of_edge(s - f, inverse_length(s - f), m7, n7),
        )
        set_element(out, to, here)
        if on > 0:
            set_element(out, to + n_u - 1, behind)
        to = to + (n_u - 1) * (n_v - 1)
        a = g
        b = h
        c = p
        d = q
        e = r
        f = s
        m0 = n0
        m1 = n1
        m2 = n2
        m3 = n3
        m4 = n4
        m5 = n5
        m6 = n6
        m7 = n7
        k = k + 1
