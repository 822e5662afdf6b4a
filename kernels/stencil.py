"""Matrices of structured grids: each node's 3 x 3 blocks with itself and its 26 neighbours, for the multigrid.

Entry q = 9 o + 3 row + column of node i, o = (du + 1) + 3 (dv + 1) + 9 (dw + 1), lies at ((i / 8) 243 + q) 8 + i % 8:
eight nodes together, read as one stream. Vectors are three planes, x, y, z, each with ``pad`` zeros before and after,
which planes share, so that the neighbours of nodes at the ends are in reach: their entries are 0.
"""

from typing import Any

import warp as wp

from gpubspline.kernels.lanes import FUSED, LaneArray

REGISTER = 32  # bytes: the lanes of a vector must divide a tile


@wp.func
def tile(i: wp.int32):
    """Where the entries of a node begin."""
    return wp.int64(i >> 3) * wp.int64(1944) + wp.int64(i & 7)


@wp.func
def product(i: wp.int32, stencil: LaneArray, x: LaneArray, n_u: wp.int32, n_v: wp.int32, n: wp.int32, pad: wp.int32):
    """S x at the nodes from i on, a component after the other."""
    entry = tile(i)
    y0 = x.dtype(type(x[0][0])(0.0))
    y1 = x.dtype(type(x[0][0])(0.0))
    y2 = x.dtype(type(x[0][0])(0.0))
    for dw in range(-1, 2):
        for dv in range(-1, 2):
            at = pad + i + n_u * (dv + n_v * dw) - 1
            for _du in range(3):
                for column in range(3):
                    value = x[at + column * (n + pad)]
                    y0 = y0 + wp.cw_mul(stencil[entry], value)
                    y1 = y1 + wp.cw_mul(stencil[entry + wp.int64(24)], value)
                    y2 = y2 + wp.cw_mul(stencil[entry + wp.int64(48)], value)
                    entry = entry + wp.int64(8)
                entry = entry + wp.int64(48)
                at = at + 1
    return y0, y1, y2


@wp.kernel(enable_backward=False, module="unique", module_options={"max_unroll": 1, "cpu_compiler_flags": FUSED})
def defect(
    stencil: LaneArray,
    b: LaneArray,
    x: LaneArray,
    n_u: wp.int32,
    n_v: wp.int32,
    n: wp.int32,
    pad: wp.int32,
    r: LaneArray,
    first: wp.int32,
    lanes: wp.int32,
):
    """Write r = b - S x; launched over as many nodes as tiles hold, of which those past the last have only zeros."""
    i = (wp.tid() + first) * lanes
    y0, y1, y2 = product(i, stencil, x, n_u, n_v, n, pad)
    at = pad + i
    r[at] = b[at] - y0
    at = at + n + pad
    r[at] = b[at] - y1
    at = at + n + pad
    r[at] = b[at] - y2


@wp.func
def relaxed(
    i: wp.int32,
    inverse: LaneArray,
    b: LaneArray,
    x: LaneArray,
    y0: Any,
    y1: Any,
    y2: Any,
    still: wp.int32,
    keep: Any,
    step: Any,
    n: wp.int32,
    pad: wp.int32,
    out: LaneArray,
):
    """Make the step at nodes from i on: out = keep x + step B (b - y)."""
    pitch = n + pad
    at = pad + i
    r0 = b[at] - y0
    r1 = b[at + pitch] - y1
    r2 = b[at + 2 * pitch] - y2
    yz = inverse[3 * n + i]
    xz = inverse[4 * n + i]
    xy = inverse[5 * n + i]
    z0 = step * (wp.cw_mul(inverse[i], r0) + wp.cw_mul(xy, r1) + wp.cw_mul(xz, r2))
    z1 = step * (wp.cw_mul(xy, r0) + wp.cw_mul(inverse[n + i], r1) + wp.cw_mul(yz, r2))
    z2 = step * (wp.cw_mul(xz, r0) + wp.cw_mul(yz, r1) + wp.cw_mul(inverse[2 * n + i], r2))
    if still == 0:
        z0 = keep * x[at] + z0
        z1 = keep * x[at + pitch] + z1
        z2 = keep * x[at + 2 * pitch] + z2
    out[at] = z0
    out[at + pitch] = z1
    out[at + 2 * pitch] = z2


@wp.kernel(enable_backward=False, module="unique", module_options={"max_unroll": 1, "cpu_compiler_flags": FUSED})
def smooth(
    stencil: LaneArray,
    inverse: LaneArray,
    b: LaneArray,
    x: LaneArray,
    still: wp.int32,
    keep: Any,
    step: Any,
    n_u: wp.int32,
    n_v: wp.int32,
    n: wp.int32,
    pad: wp.int32,
    out: LaneArray,
    first: wp.int32,
    lanes: wp.int32,
):
    """A step of Richardson's iteration: out = keep x + step B (b - S x); launched as ``defect`` is.

    B is the inverse (6, n) of the nodes' own blocks. Where ``still`` is 1, x is 0.
    """
    i = (wp.tid() + first) * lanes
    y0 = x.dtype(type(x[0][0])(0.0))
    y1 = x.dtype(type(x[0][0])(0.0))
    y2 = x.dtype(type(x[0][0])(0.0))
    if still == 0:
        y0, y1, y2 = product(i, stencil, x, n_u, n_v, n, pad)
    relaxed(i, inverse, b, x, y0, y1, y2, still, keep, step, n, pad, out)


@wp.kernel(enable_backward=False, module="unique", module_options={"max_unroll": 1, "cpu_compiler_flags": FUSED})
def relax(
    known: LaneArray,
    inverse: LaneArray,
    b: LaneArray,
    x: LaneArray,
    still: wp.int32,
    keep: Any,
    step: Any,
    n: wp.int32,
    out: LaneArray,
    first: wp.int32,
    lanes: wp.int32,
):
    """Make that step with a y (3, n) that is ``known``, and no ``pad``."""
    i = wp.min((wp.tid() + first) * lanes, n - lanes)
    y0 = x.dtype(type(x[0][0])(0.0))
    y1 = x.dtype(type(x[0][0])(0.0))
    y2 = x.dtype(type(x[0][0])(0.0))
    if still == 0:
        y0 = known[i]
        y1 = known[n + i]
        y2 = known[2 * n + i]
    relaxed(i, inverse, b, x, y0, y1, y2, still, keep, step, n, 0, out)


@wp.kernel(enable_backward=False, module="unique")
def set_column(
    y: wp.array(dtype=Any),
    n_u: wp.int32,
    n_v: wp.int32,
    n: wp.int32,
    pad: wp.int32,
    at_u: wp.int32,
    at_v: wp.int32,
    at_w: wp.int32,
    column: wp.int32,
    stencil: wp.array(dtype=Any),
    first: wp.int32,
):
    """Set the entries of one column for the neighbours whose place is ``at_u``, ``at_v``, ``at_w`` modulo 3.

    Each node has one of them: y is the product with a vector that is 1 there and 0 elsewhere. Launched over
    (n_w, n_v, n_u).
    """
    tid_w, v, u = wp.tid()
    w = tid_w + first
    i = u + n_u * (v + n_v * w)
    o = (at_u - u % 3 + 4) % 3 + 3 * ((at_v - v % 3 + 4) % 3) + 9 * ((at_w - w % 3 + 4) % 3)
    for row in range(3):
        stencil[tile(i) + wp.int64(8 * (9 * o + 3 * row + column))] = y[pad + row * (n + pad) + i]


@wp.kernel(enable_backward=False, module="unique")
def own_blocks(stencil: wp.array(dtype=Any), n: wp.int32, blocks: wp.array(dtype=Any), first: wp.int32):
    """Blocks (6, n) of the nodes with themselves: xx, yy, zz, yz, xz, xy."""
    i = wp.tid() + first
    at = tile(i) + wp.int64(936)
    blocks[i] = stencil[at]
    blocks[n + i] = stencil[at + wp.int64(32)]
    blocks[2 * n + i] = stencil[at + wp.int64(64)]
    blocks[3 * n + i] = stencil[at + wp.int64(40)]
    blocks[4 * n + i] = stencil[at + wp.int64(16)]
    blocks[5 * n + i] = stencil[at + wp.int64(8)]


@wp.func
def weight(node: wp.int32, centre: wp.array(dtype=wp.int32), side: wp.array(dtype=Any), at: wp.int32):
    """Of the function of a coarse node at a fine node of the same direction.

    Coarse grids take some of the nodes of each direction. Node J of a direction lies at ``centre[J]``; its function is
    ``side[2 J]`` one node before and ``side[2 J + 1]`` one node after, 0 or 1/2. Directions follow each other.
    """
    away = at - centre[node]
    result = side.dtype(0.0)
    if away == 0:
        result = side.dtype(1.0)
    if away == -1:
        result = side[2 * node]
    if away == 1:
        result = side[2 * node + 1]
    return result


@wp.kernel(enable_backward=False, module="unique")
def coarsen(
    stencil: wp.array(dtype=Any),
    n_u: wp.int32,
    n_v: wp.int32,
    n_w: wp.int32,
    axis: wp.int32,
    count: wp.int32,
    begin: wp.int32,
    centre: wp.array(dtype=wp.int32),
    side: wp.array(dtype=Any),
    coarse: wp.array(dtype=Any),
    first: wp.int32,
):
    """S of a grid that is coarser along one axis only, with ``count`` nodes there, P^T S P.

    Launched over (27, its nodes). What ``centre`` and ``side`` say of that axis begins at ``begin``.
    """
    tid_o, node = wp.tid()
    o = tid_o + first
    c_u = wp.where(axis == 0, count, n_u)
    c_v = wp.where(axis == 1, count, n_v)
    u = node % c_u
    v = node // c_u % c_v
    w = node // c_u // c_v
    step = wp.where(axis == 0, u, wp.where(axis == 1, v, w))
    stride = wp.where(axis == 0, 1, wp.where(axis == 1, n_u, n_u * n_v))
    power = wp.where(axis == 0, 1, wp.where(axis == 1, 3, 9))
    start = node + (n_u - c_u) * (v + c_v * w) + n_u * (n_v - c_v) * w - step * stride
    shift = o // power % 3 - 1
    other = step + shift
    total = wp.matrix(shape=(3, 3), dtype=coarse.dtype)
    none = coarse.dtype(0.0)
    if other >= 0 and other < count:
        for row in range(-1, 2):
            at = centre[begin + step] + row
            share = weight(begin + step, centre, side, at)
            if share != none:
                entries = tile(start + at * stride)
                for q in range(-1, 2):
                    value = share * weight(begin + other, centre, side, at + q)
                    if value != none:
                        place = entries + wp.int64(8 * 9 * (o + (q - shift) * power))
                        for r in range(3):
                            for c in range(3):
                                total[r, c] = total[r, c] + value * stencil[place + wp.int64(8 * (3 * r + c))]
    for r in range(3):
        for c in range(3):
            coarse[tile(node) + wp.int64(8 * (9 * o + 3 * r + c))] = total[r, c]


@wp.kernel(enable_backward=False, module="unique")
def restrict_vector(
    fine: wp.array(dtype=Any),
    n_u: wp.int32,
    n_v: wp.int32,
    n: wp.int32,
    fine_pad: wp.int32,
    c_u: wp.int32,
    c_v: wp.int32,
    n_coarse: wp.int32,
    pad: wp.int32,
    centre: wp.array(dtype=wp.int32),
    side: wp.array(dtype=Any),
    coarse: wp.array(dtype=Any),
    first: wp.int32,
):
    """Write coarse = P^T fine; launched over the coarse nodes (w, v, u)."""
    tid_w, v, u = wp.tid()
    w = tid_w + first
    first_w = c_u + c_v + w
    first_v = c_u + v
    none = coarse.dtype(0.0)
    before = side[2 * u]
    after = side[2 * u + 1]
    total = wp.vector(none, none, none)
    for dw in range(-1, 2):
        of_w = weight(first_w, centre, side, centre[first_w] + dw)
        for dv in range(-1, 2):
            value = of_w * weight(first_v, centre, side, centre[first_v] + dv)
            if value != none:
                row = fine_pad + n_u * (centre[first_v] + dv + n_v * (centre[first_w] + dw)) + centre[u]
                for c in range(3):
                    at = row + c * (n + fine_pad)
                    along = fine[at]
                    if before != none:
                        along = along + before * fine[at - 1]
                    if after != none:
                        along = along + after * fine[at + 1]
                    total[c] = total[c] + value * along
    for c in range(3):
        coarse[pad + c * (n_coarse + pad) + u + c_u * (v + c_v * w)] = total[c]


@wp.kernel(enable_backward=False, module="unique")
def prolong(
    coarse: wp.array(dtype=Any),
    c_u: wp.int32,
    c_v: wp.int32,
    n_coarse: wp.int32,
    pad: wp.int32,
    below: wp.array(dtype=wp.int32),
    above: wp.array(dtype=Any),
    free: wp.array(dtype=Any),
    n_u: wp.int32,
    n_v: wp.int32,
    n: wp.int32,
    fine_pad: wp.int32,
    fine: wp.array(dtype=Any),
    first: wp.int32,
):
    """Add P coarse to fine; launched over the fine nodes (w, v, u).

    ``below`` is the last coarse node at or before each fine one of a direction, ``above`` the share of the next.
    """
    tid_w, v, u = wp.tid()
    w = tid_w + first
    i = u + n_u * (v + n_v * w)
    one = fine.dtype(1.0)
    none = fine.dtype(0.0)
    share = above[u]
    of_v = above[n_u + v]
    of_w = above[n_u + n_v + w]
    total = wp.vector(none, none, none)
    for q in range(4):
        dv = q & 1
        dw = q >> 1
        value = wp.where(dv > 0, of_v, one - of_v) * wp.where(dw > 0, of_w, one - of_w)
        if value != none:
            at = pad + below[u] + c_u * (below[n_u + v] + dv + c_v * (below[n_u + n_v + w] + dw))
            for c in range(3):
                here = coarse[at + c * (n_coarse + pad)]
                total[c] = total[c] + value * (here + share * (coarse[at + c * (n_coarse + pad) + 1] - here))
    for c in range(3):
        to = fine_pad + c * (n + fine_pad) + i
        fine[to] = fine[to] + free[c * n + i] * total[c]
