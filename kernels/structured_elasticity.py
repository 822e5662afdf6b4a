"""Linear elasticity of a structured mesh of hex8: K u by rows of elements, without connectivity, matrix or gather.

The mathematics, 2 x 2 x 2 Gauss points and names are those of ``trilinear.py``. Nodes are n_u x n_v x n_w, u fastest,
so that the vertices a of a run of elements along u lie side by side in the planes: all is in lanes (``lanes.py``), lane
l being the element l further on in the row.

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
from gpubspline.kernels.trilinear import WEIGHT, derivatives, no_derivatives, stressed, vertices

REGISTER = REGISTER_BYTES


@wp.func
def along(plane: LaneArray, at: wp.int32, n_u: wp.int32, n_uv: wp.int32, none: Any):
    """Derivatives (12) of what a plane holds at the vertices of the elements from ``at`` on."""
    to = at + n_u
    up = at + n_uv
    far = up + n_u
    return derivatives(
        plane[at], plane[at + 1], plane[to], plane[to + 1], plane[up], plane[up + 1], plane[far], plane[far + 1], none
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
    none = no_derivatives(weight)
    x = along(points, at, n_u, n_uv, none)
    y = along(points, n + at, n_u, n_uv, none)
    z = along(points, 2 * n + at, n_u, n_uv, none)
    hx = along(displacement, at, n_u, n_uv, none)
    hy = along(displacement, n + at, n_u, n_uv, none)
    hz = along(displacement, 2 * n + at, n_u, n_uv, none)
    fx, fy, fz = stressed(x, y, z, hx, hy, hz, lam, mu, place, n_e, weight)
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
