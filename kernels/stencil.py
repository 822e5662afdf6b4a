"""Matrices of structured grids: each node's 3 x 3 blocks with itself and its 26 neighbours, for the multigrid.

Entry q = 9 o + 3 row + column of node i, o = (du + 1) + 3 (dv + 1) + 9 (dw + 1), lies at ((i / 8) 243 + q) 8 + i % 8:
eight nodes together, read as one stream. Vectors are three planes, x, y, z, each with ``pad`` zeros before and after,
which planes share, so that the neighbours of nodes at the ends are in reach: their entries are 0.
"""

from typing import Any

import warp as wp


@wp.func
def tile(i: wp.int32):
    """Where the entries of a node begin."""
    return wp.int64(i >> 3) * wp.int64(1944) + wp.int64(i & 7)


@wp.kernel(enable_backward=False, module="unique")
def add_forces(
    forces: wp.array(dtype=Any),
    n_u: wp.int32,
    n_v: wp.int32,
    n_w: wp.int32,
    parity: wp.int32,
    column: wp.int32,
    free: wp.array(dtype=Any),
    stencil: wp.array(dtype=Any),
    first: wp.int32,
):
    """Add what the elements give their nodes (3, 8, m) for a displacement of 1 along ``column``.

    It is that of the nodes of one parity in u, v, w (bits 1, 2, 4), of which each element has one.
    """
    i = wp.tid() + first
    n = n_u * n_v * n_w
    m = (n_u - 1) * (n_v - 1) * (n_w - 1)
    u = i % n_u
    v = i // n_u % n_v
    w = i // n_u // n_v
    for corner in range(8):
        eu = u - (corner & 1)
        ev = v - ((corner >> 1) & 1)
        ew = w - (corner >> 2)
        if eu >= 0 and ev >= 0 and ew >= 0 and eu < n_u - 1 and ev < n_v - 1 and ew < n_w - 1:
            du = eu + ((eu ^ parity) & 1) - u
            dv = ev + ((ev ^ (parity >> 1)) & 1) - v
            dw = ew + ((ew ^ (parity >> 2)) & 1) - w
            other = i + du + n_u * (dv + n_v * dw)
            o = (du + 1) + 3 * (dv + 1) + 9 * (dw + 1)
            vertex = (corner & 4) + wp.where((corner & 2) > 0, 3 - (corner & 1), corner & 1)
            for row in range(3):
                at = (8 * row + vertex) * m + (ew * (n_v - 1) + ev) * (n_u - 1) + eu
                both = free[row * n + i] * free[column * n + other]
                to = tile(i) + wp.int64(8 * (9 * o + 3 * row + column))
                stencil[to] = stencil[to] + both * forces[at]


@wp.func
def product(
    i: wp.int32,
    stencil: wp.array(dtype=Any),
    x: wp.array(dtype=Any),
    n_u: wp.int32,
    n_v: wp.int32,
    n: wp.int32,
    pad: wp.int32,
):
    begin = tile(i)
    y0 = x.dtype(0.0)
    y1 = x.dtype(0.0)
    y2 = x.dtype(0.0)
    for o in range(27):
        du = o % 3 - 1
        dv = o // 3 % 3 - 1
        dw = o // 9 - 1
        at = pad + i + du + n_u * (dv + n_v * dw)
        for column in range(3):
            value = x[at + column * (n + pad)]
            entry = begin + wp.int64(8 * (9 * o + column))
            y0 = y0 + stencil[entry] * value
            y1 = y1 + stencil[entry + wp.int64(24)] * value
            y2 = y2 + stencil[entry + wp.int64(48)] * value
    return wp.vector(y0, y1, y2)


@wp.kernel(enable_backward=False, module="unique")
def defect(
    stencil: wp.array(dtype=Any),
    b: wp.array(dtype=Any),
    x: wp.array(dtype=Any),
    n_u: wp.int32,
    n_v: wp.int32,
    n: wp.int32,
    pad: wp.int32,
    r: wp.array(dtype=Any),
    first: wp.int32,
):
    """Write r = b - S x."""
    i = wp.tid() + first
    y = product(i, stencil, x, n_u, n_v, n, pad)
    for c in range(3):
        at = pad + c * (n + pad) + i
        r[at] = b[at] - y[c]


@wp.kernel(enable_backward=False, module="unique")
def smooth(
    stencil: wp.array(dtype=Any),
    inverse: wp.array(dtype=Any),
    b: wp.array(dtype=Any),
    x: wp.array(dtype=Any),
    still: wp.int32,
    keep: Any,
    step: Any,
    n_u: wp.int32,
    n_v: wp.int32,
    n: wp.int32,
    pad: wp.int32,
    out: wp.array(dtype=Any),
    first: wp.int32,
):
    """A step of Richardson's iteration: out = keep x + step B (b - S x).

    B is the inverse (6, n) of the nodes' own blocks. Where ``still`` is 1, x is 0.
    """
    i = wp.tid() + first
    pitch = n + pad
    none = out.dtype(0.0)
    y = wp.vector(none, none, none)
    if still == 0:
        y = product(i, stencil, x, n_u, n_v, n, pad)
    y0 = b[pad + i] - y[0]
    y1 = b[pad + pitch + i] - y[1]
    y2 = b[pad + 2 * pitch + i] - y[2]
    yz = inverse[3 * n + i]
    xz = inverse[4 * n + i]
    xy = inverse[5 * n + i]
    z = wp.vector(
        inverse[i] * y0 + xy * y1 + xz * y2,
        xy * y0 + inverse[n + i] * y1 + yz * y2,
        xz * y0 + yz * y1 + inverse[2 * n + i] * y2,
    )
    for c in range(3):
        at = pad + c * pitch + i
        if still == 1:
            out[at] = step * z[c]
        else:
            out[at] = keep * x[at] + step * z[c]


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
    free: wp.array(dtype=Any),
    coarse: wp.array(dtype=Any),
    first: wp.int32,
):
    """Write coarse = P^T fine; launched over (3, coarse nodes)."""
    tid_c, node = wp.tid()
    c = tid_c + first
    u = node % c_u
    v = c_u + node // c_u % c_v
    w = c_u + c_v + node // c_u // c_v
    total = coarse.dtype(0.0)
    for q in range(27):
        fu = centre[u] + q % 3 - 1
        fv = centre[v] + q // 3 % 3 - 1
        fw = centre[w] + q // 9 - 1
        value = weight(u, centre, side, fu) * weight(v, centre, side, fv) * weight(w, centre, side, fw)
        if value != coarse.dtype(0.0):
            i = fu + n_u * (fv + n_v * fw)
            total = total + value * free[c * n + i] * fine[fine_pad + c * (n + fine_pad) + i]
    coarse[pad + c * (n_coarse + pad) + node] = total


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
    """Add P coarse to fine; launched over (3, n).

    ``below`` is the last coarse node at or before each fine one of a direction, ``above`` the share of the next.
    """
    tid_c, i = wp.tid()
    c = tid_c + first
    u = i % n_u
    v = n_u + i // n_u % n_v
    w = n_u + n_v + i // n_u // n_v
    one = fine.dtype(1.0)
    total = fine.dtype(0.0)
    for q in range(8):
        du = q & 1
        dv = (q >> 1) & 1
        dw = q >> 2
        value = wp.where(du > 0, above[u], one - above[u]) * wp.where(dv > 0, above[v], one - above[v])
        value = value * wp.where(dw > 0, above[w], one - above[w])
        if value != fine.dtype(0.0):
            at = below[u] + du + c_u * (below[v] + dv + c_v * (below[w] + dw))
            total = total + value * coarse[pad + c * (n_coarse + pad) + at]
    to = fine_pad + c * (n + fine_pad) + i
    fine[to] = fine[to] + free[c * n + i] * total
