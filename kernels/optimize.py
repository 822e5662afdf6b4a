"""Better hexes by moving nodes.

Nodes that slide on a level set, and moves of single nodes that raise the worst corner round them; the energy that they
descend is in ``energy``.

Coordinates are planes (3, n). ``nodes`` is (8, m): plane a holds the number of vertex a of each element, in VTK's
order. ``start`` (n + 1) and ``slots`` say where the elements of each node are: slot a m + e for vertex a of element e.
``slack`` (n) says how far a node may be from the zero level: FREE or more lets it go anywhere, below 0 it stays.
``volume`` samples one level or more, one after another; ``levels`` (2, n) says which one holds each node, and the
second one of a node on the curve where two meet, else -1. ``to_index`` is the row-major 3x4 map from coordinates to
the index (i, j, k).
"""

from typing import Any

import warp as wp

from gpubspline.kernels.energy import at_node, inverse_length, vertex

FREE = wp.constant(wp.float64(1e6))
LEAST_SLOPE = wp.constant(wp.float64(0.04))
DIAGONAL = wp.constant(wp.float64(0.57735027))
NEWTON_STEPS = wp.constant(3)


@wp.kernel(enable_backward=False, module="unique")
def move(
    x: wp.array(dtype=Any),
    d: wp.array(dtype=Any),
    n: wp.int32,
    a: Any,
    cap: Any,
    size: wp.array(dtype=Any),
    out: wp.array(dtype=Any),
    first: wp.int32,
):
    """X + a d, no node farther than ``cap`` times its ``size`` (n)."""
    i = wp.tid() + first
    step = a * at_node(d, n, i)
    length = wp.sqrt(wp.dot(step, step))
    most = cap * size[i]
    step = wp.where(length > most, most / length, type(cap)(1.0)) * step
    out[i] = x[i] + step[0]
    out[n + i] = x[n + i] + step[1]
    out[2 * n + i] = x[2 * n + i] + step[2]


@wp.func
def level_at(
    volume: wp.array(dtype=Any),
    level: wp.int32,
    n_i: wp.int32,
    n_j: wp.int32,
    n_k: wp.int32,
    to_index: wp.array(dtype=Any),
    p: Any,
):
    """The level at p, then its gradient."""
    none = type(p[0])(0.0)
    t_i = to_index[0] * p[0] + to_index[1] * p[1] + to_index[2] * p[2] + to_index[3]
    t_j = to_index[4] * p[0] + to_index[5] * p[1] + to_index[6] * p[2] + to_index[7]
    t_k = to_index[8] * p[0] + to_index[9] * p[1] + to_index[10] * p[2] + to_index[11]
    t_i = wp.min(wp.max(t_i, none), type(t_i)(n_i - 1))
    t_j = wp.min(wp.max(t_j, none), type(t_i)(n_j - 1))
    t_k = wp.min(wp.max(t_k, none), type(t_i)(n_k - 1))
    i = wp.min(wp.int32(t_i), n_i - 2)
    j = wp.min(wp.int32(t_j), n_j - 2)
    k = wp.min(wp.int32(t_k), n_k - 2)
    a = t_i - type(t_i)(i)
    b = t_j - type(t_i)(j)
    c = t_k - type(t_i)(k)
    row = wp.int64(n_i)
    near = ((wp.int64(level) * wp.int64(n_k) + wp.int64(k)) * wp.int64(n_j) + wp.int64(j)) * row + wp.int64(i)
    far = near + row * wp.int64(n_j)
    one = wp.int64(1)
    d00 = volume[near + one] - volume[near]
    d10 = volume[near + row + one] - volume[near + row]
    d01 = volume[far + one] - volume[far]
    d11 = volume[far + row + one] - volume[far + row]
    e00 = volume[near] + a * d00
    e10 = volume[near + row] + a * d10
    e01 = volume[far] + a * d01
    e11 = volume[far + row] + a * d11
    f0 = e00 + b * (e10 - e00)
    f1 = e01 + b * (e11 - e01)
    rest = type(t_i)(1.0) - c
    g_i = rest * (d00 + b * (d10 - d00)) + c * (d01 + b * (d11 - d01))
    g_j = rest * (e10 - e00) + c * (e11 - e01)
    g_k = f1 - f0
    gx = to_index[0] * g_i + to_index[4] * g_j + to_index[8] * g_k
    gy = to_index[1] * g_i + to_index[5] * g_j + to_index[9] * g_k
    gz = to_index[2] * g_i + to_index[6] * g_j + to_index[10] * g_k
    return f0 + c * (f1 - f0), wp.vector(gx, gy, gz)


@wp.func
def held(
    volume: wp.array(dtype=Any),
    level: wp.int32,
    n_i: wp.int32,
    n_j: wp.int32,
    n_k: wp.int32,
    to_index: wp.array(dtype=Any),
    p: Any,
    slack: Any,
):
    """P brought within ``slack`` of the zero level, and the normal out of what is allowed, 0 inside of it."""
    one = type(slack)(1.0)
    side = type(slack)(0.0)
    q = p
    g = type(slack)(0.0) * p
    for _step in range(NEWTON_STEPS):
        phi, slope = level_at(volume, level, n_i, n_j, n_k, to_index, q)
        g = slope
        off = phi - wp.min(wp.max(phi, -slack), slack)
        if off > type(slack)(0.0):
            side = one
        if off < type(slack)(0.0):
            side = -one
        q = q - (off / wp.max(wp.dot(g, g), type(slack)(LEAST_SLOPE))) * g
    if slack == type(slack)(0.0):
        side = one
    return q, (side * inverse_length(g)) * g


@wp.func
def held_on(
    volume: wp.array(dtype=Any),
    n_i: wp.int32,
    n_j: wp.int32,
    n_k: wp.int32,
    to_index: wp.array(dtype=Any),
    one: wp.int32,
    other: wp.int32,
    p: Any,
    slack: Any,
):
    """Hold p on the level ``one``, and where ``other`` is not negative on both.

    The normal is the curve's direction then, or with slack that of a level whose end is reached.
    """
    q, normal = held(volume, one, n_i, n_j, n_k, to_index, p, slack)
    if other >= 0:
        across = normal
        for _turn in range(2):
            r, across = held(volume, other, n_i, n_j, n_k, to_index, q, slack)
            q, normal = held(volume, one, n_i, n_j, n_k, to_index, r, slack)
        if slack > type(slack)(0.0):
            if wp.dot(normal, normal) == type(slack)(0.0):
                normal = across
        else:
            along = wp.cross(normal, across)
            normal = inverse_length(along) * along
    return q, normal


@wp.kernel(enable_backward=False, module="unique")
def slide(
    x: wp.array(dtype=Any),
    n: wp.int32,
    slack: wp.array(dtype=Any),
    levels: wp.array(dtype=wp.int32),
    volume: wp.array(dtype=Any),
    n_i: wp.int32,
    n_j: wp.int32,
    n_k: wp.int32,
    to_index: wp.array(dtype=Any),
    normal: wp.array(dtype=Any),
    first: wp.int32,
):
    """Brings nodes back to within their slack of the zero level, and gives the normals (3, n) there.

    They are 0 for nodes that are free.
    """
    i = wp.tid() + first
    none = x.dtype(0.0)
    out = wp.vector(none, none, none)
    if slack[i] >= none and slack[i] < x.dtype(FREE):
        p, out = held_on(volume, n_i, n_j, n_k, to_index, levels[i], levels[n + i], at_node(x, n, i), slack[i])
        x[i] = p[0]
        x[n + i] = p[1]
        x[2 * n + i] = p[2]
    normal[i] = out[0]
    normal[n + i] = out[1]
    normal[2 * n + i] = out[2]


@wp.func
def toward(p: Any, q: Any):
    return inverse_length(q - p) * (q - p)


@wp.func
def determinant(a: Any, b: Any, c: Any):
    return wp.dot(a, wp.cross(b, c))


@wp.func
def vtk_corner(bits: wp.int32):
    """Vertex with bits a + 2 b + 4 c at (a, b, c), and back."""
    return bits ^ ((bits >> 1) & 1)


@wp.func
def least_round(
    x: wp.array(dtype=Any),
    n: wp.int32,
    nodes: wp.array(dtype=wp.int32),
    m: wp.int32,
    slots: wp.array(dtype=wp.int32),
    begin: wp.int32,
    end: wp.int32,
    p: Any,
):
    """Least scaled Jacobian of the corners that a node at p would have a part in."""
    least = type(p[0])(2.0)
    for s in range(begin, end):
        e = slots[s] % m
        own = vtk_corner(slots[s] // m)
        sign = wp.where(((own ^ (own >> 1)) ^ (own >> 2)) & 1 == 1, type(p[0])(-1.0), type(p[0])(1.0))
        u = vertex(x, n, nodes, m, e, vtk_corner(own ^ 1))
        v = vertex(x, n, nodes, m, e, vtk_corner(own ^ 2))
        w = vertex(x, n, nodes, m, e, vtk_corner(own ^ 4))
        uv = vertex(x, n, nodes, m, e, vtk_corner(own ^ 3))
        uw = vertex(x, n, nodes, m, e, vtk_corner(own ^ 5))
        vw = vertex(x, n, nodes, m, e, vtk_corner(own ^ 6))
        pu = toward(p, u)
        pv = toward(p, v)
        pw = toward(p, w)
        least = wp.min(least, sign * determinant(pu, pv, pw))
        least = wp.min(least, sign * determinant(pu, toward(u, uv), toward(u, uw)))
        least = wp.min(least, sign * determinant(toward(v, uv), pv, toward(v, vw)))
        least = wp.min(least, sign * determinant(toward(w, uw), toward(w, vw), pw))
    return least


@wp.func
def ahead(way: wp.int32, step: Any):
    """One of 14 steps: six along the axes, eight along the diagonals."""
    none = type(step)(0.0)
    a = step * type(step)(DIAGONAL)
    bits = way - 6
    sign = wp.where((way & 1) == 1, -step, step)
    diagonal = wp.vector(
        wp.where((bits & 1) != 0, a, -a), wp.where((bits & 2) != 0, a, -a), wp.where((bits & 4) != 0, a, -a)
    )
    axis = way // 2
    straight = wp.vector(
        wp.where(axis == 0, sign, none), wp.where(axis == 1, sign, none), wp.where(axis == 2, sign, none)
    )
    return wp.where(way < 6, straight, diagonal)


@wp.kernel(enable_backward=False, module="unique")
def improve(
    x: wp.array(dtype=Any),
    n: wp.int32,
    nodes: wp.array(dtype=wp.int32),
    m: wp.int32,
    start: wp.array(dtype=wp.int32),
    slots: wp.array(dtype=wp.int32),
    slack: wp.array(dtype=Any),
    levels: wp.array(dtype=wp.int32),
    moved: wp.array(dtype=wp.int32),
    begin: wp.int32,
    count: wp.int32,
    floor: Any,
    step: Any,
    size: wp.array(dtype=Any),
    halvings: wp.int32,
    tries: wp.int32,
    volume: wp.array(dtype=Any),
    n_i: wp.int32,
    n_j: wp.int32,
    n_k: wp.int32,
    to_index: wp.array(dtype=Any),
    first: wp.int32,
):
    """Raise the least scaled Jacobian round each of the nodes ``moved`` (count), no two of which share an element.

    To ``floor`` if it can: the best of 14 directions, again from there, ``step`` times the node's ``size`` halved
    ``halvings`` times where none helps.
    """
    i = moved[begin + wp.tid() + first]
    loose = slack[i]
    if loose < x.dtype(0.0):
        return
    p = at_node(x, n, i)
    least = least_round(x, n, nodes, m, slots, start[i], start[i + 1], p)
    length = size[i] * step
    halved = wp.int32(0)
    for _turn in range(tries):
        if halved <= halvings and least < floor:
            best = p
            best_least = least
            for way in range(14):
                q = p + ahead(way, length)
                if loose < x.dtype(FREE):
                    q, _normal = held_on(volume, n_i, n_j, n_k, to_index, levels[i], levels[n + i], q, loose)
                value = least_round(x, n, nodes, m, slots, start[i], start[i + 1], q)
                if value > best_least:
                    best_least = value
                    best = q
            if best_least > least:
                least = best_least
                p = best
            else:
                length = length * x.dtype(0.5)
                halved = halved + 1
    x[i] = p[0]
    x[n + i] = p[1]
    x[2 * n + i] = p[2]
