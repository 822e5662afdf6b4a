"""Better elements by moving nodes.

Nodes that slide on what holds them, and moves of single nodes that raise the worst corner round them; the energy that
they descend is in ``energy``.

Coordinates are planes (3, n). Where there are pieces to walk on, x is (4, n): places on the flat pieces, and in the
last plane the piece that each node is on; y (3, n) is where the curved pieces have it. Elsewhere y is x. ``nodes`` is
(k, m): plane a holds the number of vertex a of each element, 4 or 8, in VTK's order. ``start`` (n + 1) and ``slots``
say where the elements of each node are: slot a m + e for vertex a of element e. ``slack`` (n) says how far a node may
be from the zero level: FREE or more lets it go anywhere, below 0 it stays. ``levels`` (2, n) says which level holds
each node, and the second one of a node on the curve where two meet, else -1; where there are pieces, that it is on a
curve. The rest is said in ``hold``.
"""

from typing import Any

import warp as wp

from gpubspline.kernels.energy import at_node, inverse_length, vertex
from gpubspline.kernels.hold import FREE, apart, held_on, lifted, walked

DIAGONAL = wp.constant(wp.float64(0.57735027))


@wp.kernel(enable_backward=False, module="unique")
def move(
    x: wp.array(dtype=Any),
    planes: wp.int32,
    d: wp.array(dtype=Any),
    n: wp.int32,
    a: Any,
    cap: Any,
    size: wp.array(dtype=Any),
    out: wp.array(dtype=Any),
    first: wp.int32,
):
    """X + a d, no node farther than ``cap`` times its ``size`` (n); planes of x beyond the third are copied."""
    i = wp.tid() + first
    step = a * at_node(d, n, i)
    length = wp.sqrt(wp.dot(step, step))
    most = cap * size[i]
    step = wp.where(length > most, most / length, type(cap)(1.0)) * step
    out[i] = x[i] + step[0]
    out[n + i] = x[n + i] + step[1]
    out[2 * n + i] = x[2 * n + i] + step[2]
    if planes > 3:
        out[3 * n + i] = x[3 * n + i]


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
    pieces: wp.array(dtype=Any),
    n_pieces: wp.int32,
    around_start: wp.array(dtype=wp.int32),
    around: wp.array(dtype=wp.int32),
    y: wp.array(dtype=Any),
    normal: wp.array(dtype=Any),
    first: wp.int32,
):
    """Brings nodes back to within their slack of what holds them, and gives the normals (3, n) there.

    They are 0 for nodes that are free; of a curve its direction.
    """
    i = wp.tid() + first
    none = x.dtype(0.0)
    out = wp.vector(none, none, none)
    p = at_node(x, n, i)
    q = p
    if slack[i] >= none and slack[i] < x.dtype(FREE):
        if n_pieces > 0:
            is_curve = wp.where(levels[n + i] >= 0, 1, 0)
            p, piece = walked(p, pieces, n_pieces, around_start, around, is_curve, wp.int32(x[3 * n + i]))
            q, out = lifted(p, pieces, n_pieces, piece, is_curve)
            x[3 * n + i] = x.dtype(piece)
        else:
            p, out = held_on(volume, n_i, n_j, n_k, to_index, levels[i], levels[n + i], p, slack[i])
        x[i] = p[0]
        x[n + i] = p[1]
        x[2 * n + i] = p[2]
    if n_pieces > 0:
        y[i] = q[0]
        y[n + i] = q[1]
        y[2 * n + i] = q[2]
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
    steep: Any,
):
    """Least scaled Jacobian of the corners of hexes that a node at p would have a part in.

    And of its own edges' length times ``steep``.
    """
    least = type(p[0])(2.0)
    short_squared = least * least / (steep * steep)
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
        short_squared = wp.min(short_squared, wp.min(apart(p, u), wp.min(apart(p, v), apart(p, w))))
        pu = toward(p, u)
        pv = toward(p, v)
        pw = toward(p, w)
        least = wp.min(least, sign * determinant(pu, pv, pw))
        least = wp.min(least, sign * determinant(pu, toward(u, uv), toward(u, uw)))
        least = wp.min(least, sign * determinant(toward(v, uv), pv, toward(v, vw)))
        least = wp.min(least, sign * determinant(toward(w, uw), toward(w, vw), pw))
    return wp.min(least, steep * wp.sqrt(short_squared))


@wp.func
def least_quad(
    x: wp.array(dtype=Any),
    n: wp.int32,
    nodes: wp.array(dtype=wp.int32),
    m: wp.int32,
    slots: wp.array(dtype=wp.int32),
    begin: wp.int32,
    end: wp.int32,
    p: Any,
):
    """The same of quads, all of whose corners it has a part in through the normal at the centre."""
    least = type(p[0])(2.0)
    for s in range(begin, end):
        e = slots[s] % m
        own = slots[s] // m
        q = vertex(x, n, nodes, m, e, (own + 1) & 3)
        r = vertex(x, n, nodes, m, e, (own + 2) & 3)
        t = vertex(x, n, nodes, m, e, (own + 3) & 3)
        across = wp.cross(r - p, t - q)
        normal = inverse_length(across) * across
        pq = toward(p, q)
        qr = toward(q, r)
        rt = toward(r, t)
        tp = toward(t, p)
        least = wp.min(least, wp.min(determinant(normal, tp, pq), determinant(normal, pq, qr)))
        least = wp.min(least, wp.min(determinant(normal, qr, rt), determinant(normal, rt, tp)))
    return least


@wp.func
def least_at(
    x: wp.array(dtype=Any),
    n: wp.int32,
    nodes: wp.array(dtype=wp.int32),
    k: wp.int32,
    m: wp.int32,
    slots: wp.array(dtype=wp.int32),
    begin: wp.int32,
    end: wp.int32,
    p: Any,
    steep: Any,
):
    least = type(p[0])(2.0)
    if k == 4:
        least = least_quad(x, n, nodes, m, slots, begin, end, p)
    else:
        least = least_round(x, n, nodes, m, slots, begin, end, p, steep)
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
    y: wp.array(dtype=Any),
    n: wp.int32,
    nodes: wp.array(dtype=wp.int32),
    k: wp.int32,
    m: wp.int32,
    start: wp.array(dtype=wp.int32),
    slots: wp.array(dtype=wp.int32),
    slack: wp.array(dtype=Any),
    levels: wp.array(dtype=wp.int32),
    moved: wp.array(dtype=wp.int32),
    begin: wp.int32,
    count: wp.int32,
    floor: Any,
    steep: Any,
    step: Any,
    size: wp.array(dtype=Any),
    halvings: wp.int32,
    tries: wp.int32,
    volume: wp.array(dtype=Any),
    n_i: wp.int32,
    n_j: wp.int32,
    n_k: wp.int32,
    to_index: wp.array(dtype=Any),
    pieces: wp.array(dtype=Any),
    n_pieces: wp.int32,
    around_start: wp.array(dtype=wp.int32),
    around: wp.array(dtype=wp.int32),
    first: wp.int32,
):
    """Raise the least scaled Jacobian round each of the nodes ``moved`` (count), no two of which share an element.

    To ``floor`` if it can: the best of 14 directions, again from there, ``step`` times the node's ``size`` halved
    ``halvings`` times where none helps. The length of a hex's edge at the node, times ``steep`` and over its ``size``,
    counts as a corner does.
    """
    i = moved[begin + wp.tid() + first]
    loose = slack[i]
    if loose < x.dtype(0.0):
        return
    is_curve = wp.where(levels[n + i] >= 0, 1, 0)
    walks = n_pieces > 0 and loose < x.dtype(FREE)
    piece = wp.int32(0)
    if walks:
        piece = wp.int32(x[3 * n + i])
    p = at_node(x, n, i)
    seen = at_node(y, n, i)
    per_length = steep / size[i]
    least = least_at(y, n, nodes, k, m, slots, start[i], start[i + 1], seen, per_length)
    length = size[i] * step
    halved = wp.int32(0)
    for _turn in range(tries):
        if halved <= halvings and least < floor:
            best = p
            best_seen = seen
            best_least = least
            best_piece = piece
            way = wp.int32(0)
            while way < 14:  # Warp would unroll a range of so few, and the registers would not do
                q = p + ahead(way, length)
                at = piece
                if walks:
                    q, at = walked(q, pieces, n_pieces, around_start, around, is_curve, piece)
                elif loose < x.dtype(FREE):
                    q, _normal = held_on(volume, n_i, n_j, n_k, to_index, levels[i], levels[n + i], q, loose)
                r = q
                if walks:
                    r, _normal = lifted(q, pieces, n_pieces, at, is_curve)
                value = least_at(y, n, nodes, k, m, slots, start[i], start[i + 1], r, per_length)
                if value > best_least:
                    best_least = value
                    best = q
                    best_seen = r
                    best_piece = at
                way = way + 1
            if best_least > least:
                least = best_least
                p = best
                seen = best_seen
                piece = best_piece
            else:
                length = length * x.dtype(0.5)
                halved = halved + 1
    x[i] = p[0]
    x[n + i] = p[1]
    x[2 * n + i] = p[2]
    y[i] = seen[0]
    y[n + i] = seen[1]
    y[2 * n + i] = seen[2]
    if walks:
        x[3 * n + i] = x.dtype(piece)
