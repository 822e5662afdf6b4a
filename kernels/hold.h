// What holds a boundary node: the zero level of sampled distances, or a surface of triangles and curves that it walks on.
//
// `volume` samples one level or more, one after another; a node is held by one or, on the curve where two meet, by both.
// `to_index` is the row-major 3x4 map from coordinates to the index (i, j, k).
// `pieces` (18, n_pieces) are the corners of triangles of smooth parts and the unit normals there, and segments of curves as
// triangles whose second and third corner are one, with their directions instead of normals. `around_start` (n_pieces + 1)
// and `around` list the pieces of the same part or curve that touch one.

#define FREE ((real)1e6)
#define TINY ((real)1e-20)
#define NEWTON_STEPS 3
#define MOST_STEPS 256

typedef struct { real x, y, z; } point;

// The level at p and its gradient.
inline real level_at(__global const real *volume, int n_i, int n_j, int n_k, __global const real *m, point p, point *g)
{
    real ti = m[0] * p.x + m[1] * p.y + m[2] * p.z + m[3];
    real tj = m[4] * p.x + m[5] * p.y + m[6] * p.z + m[7];
    real tk = m[8] * p.x + m[9] * p.y + m[10] * p.z + m[11];
    ti = fmin(fmax(ti, (real)0), (real)(n_i - 1));
    tj = fmin(fmax(tj, (real)0), (real)(n_j - 1));
    tk = fmin(fmax(tk, (real)0), (real)(n_k - 1));
    int i = min((int)ti, n_i - 2), j = min((int)tj, n_j - 2), k = min((int)tk, n_k - 2);
    real a = ti - i, b = tj - j, c = tk - k;
    __global const real *near = volume + ((size_t)k * n_j + j) * n_i + i, *far = near + (size_t)n_i * n_j;
    real d00 = near[1] - near[0], d10 = near[n_i + 1] - near[n_i];
    real d01 = far[1] - far[0], d11 = far[n_i + 1] - far[n_i];
    real e00 = near[0] + a * d00, e10 = near[n_i] + a * d10, e01 = far[0] + a * d01, e11 = far[n_i] + a * d11;
    real f0 = e00 + b * (e10 - e00), f1 = e01 + b * (e11 - e01);
    real gi = (1 - c) * (d00 + b * (d10 - d00)) + c * (d01 + b * (d11 - d01));
    real gj = (1 - c) * (e10 - e00) + c * (e11 - e01), gk = f1 - f0;
    g->x = m[0] * gi + m[4] * gj + m[8] * gk;
    g->y = m[1] * gi + m[5] * gj + m[9] * gk;
    g->z = m[2] * gi + m[6] * gj + m[10] * gk;
    return f0 + c * (f1 - f0);
}

// Brings p within `slack` of the zero level; `normal` points out of what is allowed, and is 0 inside of it.
inline point held(__global const real *volume, int n_i, int n_j, int n_k, __global const real *m, point p, real slack,
                  point *normal)
{
    point g = {0, 0, 0};
    real side = 0;
    for (int step = 0; step < NEWTON_STEPS; step++) {
        real phi = level_at(volume, n_i, n_j, n_k, m, p, &g);
        real off = phi - fmin(fmax(phi, -slack), slack);
        if (off != 0)
            side = off > 0 ? 1 : -1;
        real share = off / fmax(g.x * g.x + g.y * g.y + g.z * g.z, (real)0.04);
        p.x -= share * g.x;
        p.y -= share * g.y;
        p.z -= share * g.z;
    }
    if (slack == 0)
        side = 1;
    real scale = side * rsqrt(fmax(g.x * g.x + g.y * g.y + g.z * g.z, TINY));
    normal->x = scale * g.x;
    normal->y = scale * g.y;
    normal->z = scale * g.z;
    return p;
}

// The same on the level `one`, and where `other` is not negative on both levels: the slack is from `other` then, and `normal`
// the curve's direction, or with slack that of `one`.
inline point held_on(__global const real *volume, int n_i, int n_j, int n_k, __global const real *m, int one, int other,
                     point p, real slack, point *normal)
{
    size_t size = (size_t)n_i * n_j * n_k;
    p = held(volume + one * size, n_i, n_j, n_k, m, p, other < 0 ? slack : 0, normal);
    if (other < 0)
        return p;
    point a, b;
    for (int turn = 0; turn < 2; turn++) {
        p = held(volume + other * size, n_i, n_j, n_k, m, p, slack, &b);
        p = held(volume + one * size, n_i, n_j, n_k, m, p, 0, &a);
    }
    if (slack > 0) {
        *normal = a;
        return p;
    }
    point along = {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
    real scale = rsqrt(fmax(along.x * along.x + along.y * along.y + along.z * along.z, TINY));
    normal->x = scale * along.x;
    normal->y = scale * along.y;
    normal->z = scale * along.z;
    return p;
}

inline point minus(point a, point b)
{
    point c = {a.x - b.x, a.y - b.y, a.z - b.z};
    return c;
}

inline real inner(point a, point b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

inline point outer(point a, point b)
{
    point c = {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
    return c;
}

inline point along(point p, real share, point d)
{
    point q = {p.x + share * d.x, p.y + share * d.y, p.z + share * d.z};
    return q;
}

inline point to_unit(point d)
{
    point none = {0, 0, 0};
    return along(none, rsqrt(fmax(inner(d, d), TINY)), d);
}

inline point piece_corner(__global const real *pieces, int n_pieces, int t, int corner)
{
    __global const real *c = pieces + 3 * (size_t)corner * n_pieces + t;
    point p = {c[0], c[n_pieces], c[2 * (size_t)n_pieces]};
    return p;
}

// What a part is of a whole that is not negative: 0 to 1, whatever rounding makes of the whole where it is next to nothing.
inline real share_of(real part, real whole)
{
    return whole > 0 ? clamp(part / whole, (real)0, (real)1) : 0;
}

// Point of the segment from a to b that is nearest to p.
inline point on_segment(point p, point a, point b)
{
    point e = minus(b, a);
    return along(a, share_of(inner(minus(p, a), e), inner(e, e)), e);
}

inline real apart(point a, point b)
{
    point d = minus(a, b);
    return inner(d, d);
}

// Point of piece t, of a curve or of a part, that is nearest to p.
inline point on_piece(point p, __global const real *pieces, int n_pieces, int t, int is_curve)
{
    point a = piece_corner(pieces, n_pieces, t, 0), b = piece_corner(pieces, n_pieces, t, 1);
    point q = on_segment(p, a, b);
    if (is_curve)
        return q;
    point c = piece_corner(pieces, n_pieces, t, 2);
    point n = outer(minus(b, a), minus(c, a)), pa = minus(p, a), pb = minus(p, b), pc = minus(p, c);
    real square = inner(n, n);
    if (square > 0 && inner(outer(minus(b, a), pa), n) >= 0 && inner(outer(minus(c, b), pb), n) >= 0
        && inner(outer(minus(a, c), pc), n) >= 0)
        return along(p, -inner(pa, n) / square, n);
    point r = on_segment(p, b, c), s = on_segment(p, c, a);
    if (apart(p, r) < apart(p, q))
        q = r;
    return apart(p, s) < apart(p, q) ? s : q;
}

// The point q of a piece lifted on to the quadratic surface, or curve, that its normals, or directions, say: half way to the
// mean of its projections on to the tangents at the corners. `normal` is the one there, or the direction.
// Source: Boubekeur and Alexa 2008 (Phong tessellation); their factor is 3/4, a half is exact for quadrics.
inline point lifted(point q, __global const real *pieces, int n_pieces, int t, int is_curve, point *normal)
{
    point a = piece_corner(pieces, n_pieces, t, 0), b = piece_corner(pieces, n_pieces, t, 1);
    point c = piece_corner(pieces, n_pieces, t, 2), ab = minus(b, a), ac = minus(c, a), aq = minus(q, a);
    real aa = inner(ab, ab), bb = inner(ac, ac), cross = inner(ab, ac), share_b, share_c = 0;
    if (is_curve) {
        share_b = share_of(inner(aq, ab), aa);
    } else {
        real all = aa * bb - cross * cross;
        share_b = share_of(bb * inner(ab, aq) - cross * inner(ac, aq), all);
        share_c = fmin(share_of(aa * inner(ac, aq) - cross * inner(ab, aq), all), 1 - share_b);
    }
    real share_a = 1 - share_b - share_c;
    point na = piece_corner(pieces, n_pieces, t, 3), nb = piece_corner(pieces, n_pieces, t, 4);
    point nc = piece_corner(pieces, n_pieces, t, 5), none = {0, 0, 0};
    point sum = along(along(along(none, share_a, na), share_b, nb), share_c, nc);
    *normal = to_unit(sum);
    real ha = share_a * inner(aq, na), hb = share_b * inner(minus(q, b), nb), hc = share_c * inner(minus(q, c), nc);
    if (!is_curve)
        return along(along(along(q, -ha / 2, na), -hb / 2, nb), -hc / 2, nc);
    point mean = along(along(along(along(none, share_a, a), share_b, b), ha, na), hb, nb);
    return along(q, (real)0.5, minus(mean, q));
}

// Walks from piece to touching piece as long as that leads nearer to p; gives the point of the piece there.
inline point walked(point p, __global const real *pieces, int n_pieces, __global const int *around_start,
                    __global const int *around, int is_curve, int *piece)
{
    point q = on_piece(p, pieces, n_pieces, *piece, is_curve);
    real least = apart(p, q);
    for (int step = 0; step < MOST_STEPS; step++) {
        int from = *piece;
        for (int s = around_start[from], end = around_start[from + 1]; s < end; s++) {
            point r = on_piece(p, pieces, n_pieces, around[s], is_curve);
            real distance = apart(p, r);
            if (distance < least) {
                least = distance;
                q = r;
                *piece = around[s];
            }
        }
        if (*piece == from)
            break;
    }
    return q;
}
