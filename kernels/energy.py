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
def edge_pull(d: Any, target: Any, weight: Any):
    """Gradient of weight (ln l^2 - target)^2 by the edge."""
    i = inverse_length(d)
    return (type(weight)(4.0) * weight * off_target(d, target) * i) * (i * d)


@wp.func
def shortfall(u: Any, v: Any, w: Any, goal: Any):
    return wp.max(goal - wp.dot(u, wp.cross(v, w)), type(goal)(0.0))


@wp.func
def lacks(u: Any, v: Any, w: Any, goal: Any, power: wp.int32):
    """max(0, goal - SJ)^power of a corner with unit edges."""
    square = shortfall(u, v, w, goal) * shortfall(u, v, w, goal)
    return wp.where(power == 2, square, square * square)


@wp.func
def falls(short: Any, power: wp.int32):
    """Derivative of ``short``^power, power 2 or 4, by what it falls short of."""
    return wp.where(power == 2, type(short)(-2.0) * short, type(short)(-4.0) * short * short * short)


@wp.func
def pull(u: Any, v: Any, w: Any, length: Any, goal: Any, power: wp.int32):
    """Derivative of ``lacks`` by the edge u, whose inverse length is given."""
    vw = wp.cross(v, w)
    slope = falls(shortfall(u, v, w, goal), power)
    return (slope * length) * (vw - wp.dot(u, vw) * u)


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
    d = p1 - p0
    iu0 = inverse_length(d)
    u0 = iu0 * d
    total = total + weight * off_target(d, lu) * off_target(d, lu)
    gu0 = edge_pull(d, lu, weight)
    d = p2 - p3
    iu1 = inverse_length(d)
    u1 = iu1 * d
    total = total + weight * off_target(d, lu) * off_target(d, lu)
    gu1 = edge_pull(d, lu, weight)
    d = p5 - p4
    iu2 = inverse_length(d)
    u2 = iu2 * d
    total = total + weight * off_target(d, lu) * off_target(d, lu)
    gu2 = edge_pull(d, lu, weight)
    d = p6 - p7
    iu3 = inverse_length(d)
    u3 = iu3 * d
    total = total + weight * off_target(d, lu) * off_target(d, lu)
    gu3 = edge_pull(d, lu, weight)
    d = p3 - p0
    iv0 = inverse_length(d)
    v0 = iv0 * d
    total = total + weight * off_target(d, lv) * off_target(d, lv)
    gv0 = edge_pull(d, lv, weight)
    d = p2 - p1
    iv1 = inverse_length(d)
    v1 = iv1 * d
    total = total + weight * off_target(d, lv) * off_target(d, lv)
    gv1 = edge_pull(d, lv, weight)
    d = p7 - p4
    iv2 = inverse_length(d)
    v2 = iv2 * d
    total = total + weight * off_target(d, lv) * off_target(d, lv)
    gv2 = edge_pull(d, lv, weight)
    d = p6 - p5
    iv3 = inverse_length(d)
    v3 = iv3 * d
    total = total + weight * off_target(d, lv) * off_target(d, lv)
    gv3 = edge_pull(d, lv, weight)
    d = p4 - p0
    iw0 = inverse_length(d)
    w0 = iw0 * d
    total = total + weight * off_target(d, lw) * off_target(d, lw)
    gw0 = edge_pull(d, lw, weight)
    d = p5 - p1
    iw1 = inverse_length(d)
    w1 = iw1 * d
    total = total + weight * off_target(d, lw) * off_target(d, lw)
    gw1 = edge_pull(d, lw, weight)
    d = p6 - p2
    iw2 = inverse_length(d)
    w2 = iw2 * d
    total = total + weight * off_target(d, lw) * off_target(d, lw)
    gw2 = edge_pull(d, lw, weight)
    d = p7 - p3
    iw3 = inverse_length(d)
    w3 = iw3 * d
    total = total + weight * off_target(d, lw) * off_target(d, lw)
    gw3 = edge_pull(d, lw, weight)
    total = total + lacks(u0, v0, w0, goal, power)
    gu0 = gu0 + pull(u0, v0, w0, iu0, goal, power)
    gv0 = gv0 + pull(v0, w0, u0, iv0, goal, power)
    gw0 = gw0 + pull(w0, u0, v0, iw0, goal, power)
    total = total + lacks(u0, v1, w1, goal, power)
    gu0 = gu0 + pull(u0, v1, w1, iu0, goal, power)
    gv1 = gv1 + pull(v1, w1, u0, iv1, goal, power)
    gw1 = gw1 + pull(w1, u0, v1, iw1, goal, power)
    total = total + lacks(u1, v1, w2, goal, power)
    gu1 = gu1 + pull(u1, v1, w2, iu1, goal, power)
    gv1 = gv1 + pull(v1, w2, u1, iv1, goal, power)
    gw2 = gw2 + pull(w2, u1, v1, iw2, goal, power)
    total = total + lacks(u1, v0, w3, goal, power)
    gu1 = gu1 + pull(u1, v0, w3, iu1, goal, power)
    gv0 = gv0 + pull(v0, w3, u1, iv0, goal, power)
    gw3 = gw3 + pull(w3, u1, v0, iw3, goal, power)
    total = total + lacks(u2, v2, w0, goal, power)
    gu2 = gu2 + pull(u2, v2, w0, iu2, goal, power)
    gv2 = gv2 + pull(v2, w0, u2, iv2, goal, power)
    gw0 = gw0 + pull(w0, u2, v2, iw0, goal, power)
    total = total + lacks(u2, v3, w1, goal, power)
    gu2 = gu2 + pull(u2, v3, w1, iu2, goal, power)
    gv3 = gv3 + pull(v3, w1, u2, iv3, goal, power)
    gw1 = gw1 + pull(w1, u2, v3, iw1, goal, power)
    total = total + lacks(u3, v3, w2, goal, power)
    gu3 = gu3 + pull(u3, v3, w2, iu3, goal, power)
    gv3 = gv3 + pull(v3, w2, u3, iv3, goal, power)
    gw2 = gw2 + pull(w2, u3, v3, iw2, goal, power)
    total = total + lacks(u3, v2, w3, goal, power)
    gu3 = gu3 + pull(u3, v2, w3, iu3, goal, power)
    gv2 = gv2 + pull(v2, w3, u3, iv2, goal, power)
    gw3 = gw3 + pull(w3, u3, v2, iw3, goal, power)
    energy[e] = total
    give(-gu0 - gv0 - gw0, gradient, 8, m, 0, e)
    give(gu0 - gv1 - gw1, gradient, 8, m, 1, e)
    give(gu1 + gv1 - gw2, gradient, 8, m, 2, e)
    give(-gu1 + gv0 - gw3, gradient, 8, m, 3, e)
    give(-gu2 - gv2 + gw0, gradient, 8, m, 4, e)
    give(gu2 - gv3 + gw1, gradient, 8, m, 5, e)
    give(gu3 + gv3 + gw2, gradient, 8, m, 6, e)
    give(-gu3 + gv2 + gw3, gradient, 8, m, 7, e)


@wp.func
def flat_pull(a: Any, b: Any, normal: Any, goal: Any, power: wp.int32, inverse: Any):
    """Derivative by the edge a of a quad, whose inverse length is given, of what its corner with b lacks.

    For b before a, the normal is to be turned over.
    """
    short = shortfall(normal, a, b, goal)
    jacobian = wp.dot(normal, wp.cross(a, b))
    return (falls(short, power) * inverse) * (wp.cross(b, normal) - jacobian * a)


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
    d0 = p1 - p0
    d1 = p2 - p1
    d2 = p3 - p2
    d3 = p0 - p3
    total = weight * (off_target(d0, lu) * off_target(d0, lu) + off_target(d1, lv) * off_target(d1, lv))
    total = total + weight * (off_target(d2, lu) * off_target(d2, lu) + off_target(d3, lv) * off_target(d3, lv))
    g0 = edge_pull(d0, lu, weight)
    g1 = edge_pull(d1, lv, weight)
    g2 = edge_pull(d2, lu, weight)
    g3 = edge_pull(d3, lv, weight)
    i0 = inverse_length(d0)
    i1 = inverse_length(d1)
    i2 = inverse_length(d2)
    i3 = inverse_length(d3)
    e0 = i0 * d0
    e1 = i1 * d1
    e2 = i2 * d2
    e3 = i3 * d3
    d = p2 - p0
    f = p3 - p1
    df = wp.cross(d, f)
    over = inverse_length(df)
    normal = over * df
    total = total + lacks(normal, e0, e1, goal, power) + lacks(normal, e1, e2, goal, power)
    total = total + lacks(normal, e2, e3, goal, power) + lacks(normal, e3, e0, goal, power)
    g0 = g0 + flat_pull(e0, e1, normal, goal, power, i0) + flat_pull(e0, e3, -normal, goal, power, i0)
    g1 = g1 + flat_pull(e1, e2, normal, goal, power, i1) + flat_pull(e1, e0, -normal, goal, power, i1)
    g2 = g2 + flat_pull(e2, e3, normal, goal, power, i2) + flat_pull(e2, e1, -normal, goal, power, i2)
    g3 = g3 + flat_pull(e3, e0, normal, goal, power, i3) + flat_pull(e3, e2, -normal, goal, power, i3)
    gn = falls(shortfall(normal, e0, e1, goal), power) * wp.cross(e0, e1)
    gn = gn + falls(shortfall(normal, e1, e2, goal), power) * wp.cross(e1, e2)
    gn = gn + falls(shortfall(normal, e2, e3, goal), power) * wp.cross(e2, e3)
    gn = gn + falls(shortfall(normal, e3, e0, goal), power) * wp.cross(e3, e0)
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
    if slack[i] > none:  # a step back from the end of the slack is free
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
