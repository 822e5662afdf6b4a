"""What hexes and quads lack in scaled Jacobian and in even edges, and the gradient of it by their nodes.

Coordinates are planes (3, n). ``nodes`` is (k, m): plane a holds the number of vertex a of each element, of k = 8 or
4, in VTK's order. ``start`` (n + 1) and ``slots`` say where the elements of each node are: slot a m + e for vertex a
of element e.
"""

from typing import Any

import warp as wp

TINY = wp.constant(wp.float64(1e-20))


@wp.func
def at_node(x: wp.array(dtype=Any), n: wp.int32, node: wp.int32):
    return wp.vector(x[node], x[n + node], x[2 * n + node])


@wp.func
def vertex(x: wp.array(dtype=Any), n: wp.int32, nodes: wp.array(dtype=wp.int32), m: wp.int32, e: wp.int32, a: wp.int32):
    return at_node(x, n, nodes[a * m + e])


@wp.func
def inverse_length(d: Any):
    squared = wp.max(wp.dot(d, d), type(d[0])(TINY))
    return type(d[0])(1.0) / wp.sqrt(squared)


@wp.func
def off_target(d: Any, target: Any):
    return wp.log(wp.max(wp.dot(d, d), type(target)(TINY))) - target


@wp.func
def edge(start: Any, end: Any, target: Any, weight: Any, energy: Any):
    """Unit vector and inverse length of an edge; energy with weight (ln l^2 - target)^2, and the gradient of that."""
    d = end - start
    inverse = inverse_length(d)
    unit = inverse * d
    off = off_target(d, target)
    return unit, inverse, energy + weight * off * off, (type(weight)(4.0) * weight * off * inverse) * unit


@wp.func
def falls(short: Any, power: wp.int32):
    """Derivative of ``short``^power, power 2 or 4, by what it falls short of."""
    return wp.where(power == 2, type(short)(-2.0) * short, type(short)(-4.0) * short * short * short)


@wp.func
def corner(
    u: Any,
    v: Any,
    w: Any,
    iu: Any,
    iv: Any,
    iw: Any,
    goal: Any,
    power: wp.int32,
    energy: Any,
    gu: Any,
    gv: Any,
    gw: Any,
):
    """Energy and gradients by the edges, with max(0, goal - SJ)^power of a corner of unit edges and its derivatives."""
    vw = wp.cross(v, w)
    jacobian = wp.dot(u, vw)
    short = wp.max(goal - jacobian, type(goal)(0.0))
    square = short * short
    slope = falls(short, power)
    return (
        energy + wp.where(power == 2, square, square * square),
        gu + (slope * iu) * (vw - jacobian * u),
        gv + (slope * iv) * (wp.cross(w, u) - jacobian * v),
        gw + (slope * iw) * (wp.cross(u, v) - jacobian * w),
    )


@wp.func
def give(g: Any, gradient: wp.array(dtype=Any), k: wp.int32, m: wp.int32, a: wp.int32, e: wp.int32):
    gradient[a * m + e] = g[0]
    gradient[(k + a) * m + e] = g[1]
    gradient[(2 * k + a) * m + e] = g[2]


@wp.kernel(enable_backward=False, module="unique")
def hex_energy(
    x: wp.array(dtype=Any),
    n: wp.int32,
    nodes: wp.array(dtype=wp.int32),
    m: wp.int32,
    log_lengths: wp.array(dtype=Any),
    goal: Any,
    power: wp.int32,
    weight: Any,
    energy: wp.array(dtype=Any),
    gradient: wp.array(dtype=Any),
    first: wp.int32,
):
    """Energy (m) of each hex and its gradient (3, 8, m) by its vertices.

    max(0, goal - SJ)^power summed over the corners, power 2 or 4, and weight (ln l^2 - log_lengths)^2 over the edges,
    log_lengths (3, m) for those along u, v and w.
    """
    e = wp.tid() + first
    p0 = vertex(x, n, nodes, m, e, 0)
    p1 = vertex(x, n, nodes, m, e, 1)
    p2 = vertex(x, n, nodes, m, e, 2)
    p3 = vertex(x, n, nodes, m, e, 3)
    p4 = vertex(x, n, nodes, m, e, 4)
    p5 = vertex(x, n, nodes, m, e, 5)
    p6 = vertex(x, n, nodes, m, e, 6)
    p7 = vertex(x, n, nodes, m, e, 7)
    lu = log_lengths[e]
    lv = log_lengths[m + e]
    lw = log_lengths[2 * m + e]
    total = energy.dtype(0.0)
    u0, iu0, total, gu0 = edge(p0, p1, lu, weight, total)
    u1, iu1, total, gu1 = edge(p3, p2, lu, weight, total)
    u2, iu2, total, gu2 = edge(p4, p5, lu, weight, total)
    u3, iu3, total, gu3 = edge(p7, p6, lu, weight, total)
    v0, iv0, total, gv0 = edge(p0, p3, lv, weight, total)
    v1, iv1, total, gv1 = edge(p1, p2, lv, weight, total)
    v2, iv2, total, gv2 = edge(p4, p7, lv, weight, total)
    v3, iv3, total, gv3 = edge(p5, p6, lv, weight, total)
    w0, iw0, total, gw0 = edge(p0, p4, lw, weight, total)
    w1, iw1, total, gw1 = edge(p1, p5, lw, weight, total)
    w2, iw2, total, gw2 = edge(p2, p6, lw, weight, total)
    w3, iw3, total, gw3 = edge(p3, p7, lw, weight, total)
    total, gu0, gv0, gw0 = corner(u0, v0, w0, iu0, iv0, iw0, goal, power, total, gu0, gv0, gw0)
    total, gu0, gv1, gw1 = corner(u0, v1, w1, iu0, iv1, iw1, goal, power, total, gu0, gv1, gw1)
    total, gu1, gv1, gw2 = corner(u1, v1, w2, iu1, iv1, iw2, goal, power, total, gu1, gv1, gw2)
    total, gu1, gv0, gw3 = corner(u1, v0, w3, iu1, iv0, iw3, goal, power, total, gu1, gv0, gw3)
    total, gu2, gv2, gw0 = corner(u2, v2, w0, iu2, iv2, iw0, goal, power, total, gu2, gv2, gw0)
    total, gu2, gv3, gw1 = corner(u2, v3, w1, iu2, iv3, iw1, goal, power, total, gu2, gv3, gw1)
    total, gu3, gv3, gw2 = corner(u3, v3, w2, iu3, iv3, iw2, goal, power, total, gu3, gv3, gw2)
    total, gu3, gv2, gw3 = corner(u3, v2, w3, iu3, iv2, iw3, goal, power, total, gu3, gv2, gw3)
    energy[e] = total
    give(-gu0 - gv0 - gw0, gradient, 8, m, 0, e)
    give(gu0 - gv1 - gw1, gradient, 8, m, 1, e)
    give(gu1 + gv1 - gw2, gradient, 8, m, 2, e)
    give(-gu1 + gv0 - gw3, gradient, 8, m, 3, e)
    give(-gu2 - gv2 + gw0, gradient, 8, m, 4, e)
    give(gu2 - gv3 + gw1, gradient, 8, m, 5, e)
    give(gu3 + gv3 + gw2, gradient, 8, m, 6, e)
    give(-gu3 + gv2 + gw3, gradient, 8, m, 7, e)


@wp.kernel(enable_backward=False, module="unique")
def quad_energy(
    x: wp.array(dtype=Any),
    n: wp.int32,
    nodes: wp.array(dtype=wp.int32),
    m: wp.int32,
    log_lengths: wp.array(dtype=Any),
    goal: Any,
    power: wp.int32,
    weight: Any,
    energy: wp.array(dtype=Any),
    gradient: wp.array(dtype=Any),
    first: wp.int32,
):
    """The same of quads in space, whose corners are measured against the normal at the centre.

    log_lengths (2, m), gradient (3, 4, m).
    """
    e = wp.tid() + first
    p0 = vertex(x, n, nodes, m, e, 0)
    p1 = vertex(x, n, nodes, m, e, 1)
    p2 = vertex(x, n, nodes, m, e, 2)
    p3 = vertex(x, n, nodes, m, e, 3)
    lu = log_lengths[e]
    lv = log_lengths[m + e]
    total = energy.dtype(0.0)
    e0, i0, total, g0 = edge(p0, p1, lu, weight, total)
    e1, i1, total, g1 = edge(p1, p2, lv, weight, total)
    e2, i2, total, g2 = edge(p2, p3, lu, weight, total)
    e3, i3, total, g3 = edge(p3, p0, lv, weight, total)
    d = p2 - p0
    f = p3 - p1
    df = wp.cross(d, f)
    over = inverse_length(df)
    normal = over * df
    one = energy.dtype(1.0)
    gn = energy.dtype(0.0) * normal
    total, gn, g0, g1 = corner(normal, e0, e1, one, i0, i1, goal, power, total, gn, g0, g1)
    total, gn, g1, g2 = corner(normal, e1, e2, one, i1, i2, goal, power, total, gn, g1, g2)
    total, gn, g2, g3 = corner(normal, e2, e3, one, i2, i3, goal, power, total, gn, g2, g3)
    total, gn, g3, g0 = corner(normal, e3, e0, one, i3, i0, goal, power, total, gn, g3, g0)
    gn = over * (gn - wp.dot(gn, normal) * normal)
    gd = wp.cross(f, gn)
    gf = wp.cross(gn, d)
    energy[e] = total
    give(g3 - g0 - gd, gradient, 4, m, 0, e)
    give(g0 - g1 - gf, gradient, 4, m, 1, e)
    give(g1 - g2 + gd, gradient, 4, m, 2, e)
    give(g2 - g3 + gf, gradient, 4, m, 3, e)


@wp.kernel(enable_backward=False, module="unique")
def node_gradient(
    values: wp.array(dtype=Any),
    k: wp.int32,
    m: wp.int32,
    start: wp.array(dtype=wp.int32),
    slots: wp.array(dtype=wp.int32),
    normal: wp.array(dtype=Any),
    slack: wp.array(dtype=Any),
    levels: wp.array(dtype=wp.int32),
    n: wp.int32,
    out: wp.array(dtype=Any),
    first: wp.int32,
):
    """Gradient (3, n) by node: what its elements gave in sum, less what would push it off the level or the curve."""
    i = wp.tid() + first
    none = out.dtype(0.0)
    gx = out.dtype(0.0)
    gy = out.dtype(0.0)
    gz = out.dtype(0.0)
    for s in range(start[i], start[i + 1]):
        at = slots[s]
        gx = gx + values[at]
        gy = gy + values[k * m + at]
        gz = gz + values[2 * k * m + at]
    nx = normal[i]
    ny = normal[n + i]
    nz = normal[2 * n + i]
    off = gx * nx + gy * ny + gz * nz
    if slack[i] > none and levels[n + i] < 0:  # a step back from the end of the slack is free
        off = wp.min(off, none)
    moves = wp.where(slack[i] < none, none, out.dtype(1.0))
    kept = moves
    if (
        levels[n + i] >= 0 and slack[i] == none
    ):  # the normal is the curve's direction: nothing but what goes along it is left
        off = -off
        kept = none
    out[i] = kept * gx - moves * off * nx
    out[n + i] = kept * gy - moves * off * ny
    out[2 * n + i] = kept * gz - moves * off * nz
