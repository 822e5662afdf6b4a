"""What holds a boundary node: the zero level of sampled distances, or a surface that it walks on.

``volume`` samples one level or more, one after another; a node is held by one or, on the curve where two meet, by both.
``to_index`` is the row-major 3x4 map from coordinates to the index (i, j, k).

``pieces`` (18, n_pieces) are the corners of triangles of smooth parts and the unit normals there, and segments of
curves as triangles whose second and third corner are one, with their directions instead of normals. ``around_start``
(n_pieces + 1) and ``around`` list the pieces of the same part or curve that touch one. The OpenCL twin of this is
``hold.h``.
"""

from typing import Any

import warp as wp

from gpubspline.kernels.energy import inverse_length

FREE = wp.constant(wp.float64(1e6))
LEAST_SLOPE = wp.constant(wp.float64(0.04))
NEWTON_STEPS = wp.constant(3)
MOST_STEPS = wp.constant(256)


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

    The slack is from ``other`` then. The normal is the curve's direction, or with slack that of ``one``.
    """
    none = type(slack)(0.0)
    q, normal = held(volume, one, n_i, n_j, n_k, to_index, p, wp.where(other < 0, slack, none))
    if other >= 0:
        across = normal
        for _turn in range(2):
            r, across = held(volume, other, n_i, n_j, n_k, to_index, q, slack)
            q, normal = held(volume, one, n_i, n_j, n_k, to_index, r, none)
        if slack == none:
            along = wp.cross(normal, across)
            normal = inverse_length(along) * along
    return q, normal


@wp.func
def piece_corner(pieces: wp.array(dtype=Any), n_pieces: wp.int32, t: wp.int32, corner: wp.int32):
    first = 3 * corner * n_pieces + t
    return wp.vector(pieces[first], pieces[first + n_pieces], pieces[first + 2 * n_pieces])


@wp.func
def share_of(part: Any, whole: Any):
    """What a part is of a whole that is not negative.

    0 to 1, whatever rounding makes of the whole where it is next to nothing.
    """
    none = type(whole)(0.0)
    return wp.where(whole > none, wp.clamp(part / whole, none, type(whole)(1.0)), none)


@wp.func
def on_segment(p: Any, a: Any, b: Any):
    """Point of the segment from a to b that is nearest to p."""
    e = b - a
    return a + share_of(wp.dot(p - a, e), wp.dot(e, e)) * e


@wp.func
def apart(a: Any, b: Any):
    return wp.dot(a - b, a - b)


@wp.func
def on_piece(p: Any, pieces: wp.array(dtype=Any), n_pieces: wp.int32, t: wp.int32, is_curve: wp.int32):
    """Point of piece t, of a curve or of a part, that is nearest to p."""
    none = type(p[0])(0.0)
    a = piece_corner(pieces, n_pieces, t, 0)
    b = piece_corner(pieces, n_pieces, t, 1)
    q = on_segment(p, a, b)
    if is_curve == 0:
        c = piece_corner(pieces, n_pieces, t, 2)
        n = wp.cross(b - a, c - a)
        square = wp.dot(n, n)
        first = wp.dot(wp.cross(b - a, p - a), n)
        second = wp.dot(wp.cross(c - b, p - b), n)
        third = wp.dot(wp.cross(a - c, p - c), n)
        if square > none and first >= none and second >= none and third >= none:
            q = p + (-wp.dot(p - a, n) / square) * n
        else:
            r = on_segment(p, b, c)
            s = on_segment(p, c, a)
            if apart(p, r) < apart(p, q):
                q = r
            if apart(p, s) < apart(p, q):
                q = s
    return q


@wp.func
def lifted(q: Any, pieces: wp.array(dtype=Any), n_pieces: wp.int32, t: wp.int32, is_curve: wp.int32):
    """The point q of a piece lifted on to the quadratic surface, or curve, that its normals, or directions, say.

    That is half way to the mean of its projections on to the tangents at the corners. Then the normal, or direction,
    there. Source: Boubekeur and Alexa 2008 (Phong tessellation); their factor is 3/4, a half is exact for quadrics.
    """
    none = type(q[0])(0.0)
    one = type(q[0])(1.0)
    half = type(q[0])(0.5)
    a = piece_corner(pieces, n_pieces, t, 0)
    b = piece_corner(pieces, n_pieces, t, 1)
    c = piece_corner(pieces, n_pieces, t, 2)
    ab = b - a
    ac = c - a
    aq = q - a
    aa = wp.dot(ab, ab)
    bb = wp.dot(ac, ac)
    cross = wp.dot(ab, ac)
    share_b = none
    share_c = none
    if is_curve == 0:
        all = aa * bb - cross * cross
        share_b = share_of(bb * wp.dot(ab, aq) - cross * wp.dot(ac, aq), all)
        share_c = wp.min(share_of(aa * wp.dot(ac, aq) - cross * wp.dot(ab, aq), all), one - share_b)
    else:
        share_b = share_of(wp.dot(aq, ab), aa)
    share_a = one - share_b - share_c
    na = piece_corner(pieces, n_pieces, t, 3)
    nb = piece_corner(pieces, n_pieces, t, 4)
    nc = piece_corner(pieces, n_pieces, t, 5)
    sum = share_a * na + share_b * nb + share_c * nc
    ha = share_a * wp.dot(aq, na)
    hb = share_b * wp.dot(q - b, nb)
    hc = share_c * wp.dot(q - c, nc)
    r = q
    if is_curve == 0:
        r = q - half * (ha * na + hb * nb + hc * nc)
    else:
        r = half * (q + share_a * a + share_b * b + ha * na + hb * nb)
    return r, inverse_length(sum) * sum


@wp.func
def walked(
    p: Any,
    pieces: wp.array(dtype=Any),
    n_pieces: wp.int32,
    around_start: wp.array(dtype=wp.int32),
    around: wp.array(dtype=wp.int32),
    is_curve: wp.int32,
    piece: wp.int32,
):
    """Walk from piece to touching piece as long as that leads nearer to p: the point there, and the piece."""
    q = on_piece(p, pieces, n_pieces, piece, is_curve)
    least = apart(p, q)
    at = piece
    step = wp.int32(0)
    while step < MOST_STEPS:
        origin = at
        for s in range(around_start[origin], around_start[origin + 1]):
            near = on_piece(p, pieces, n_pieces, around[s], is_curve)
            distance = apart(p, near)
            if distance < least:
                least = distance
                q = near
                at = around[s]
        step = step + 1
        if at == origin:
            step = MOST_STEPS
    return q, at
