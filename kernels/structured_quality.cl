// WIDE
// Scaled Jacobian of structured hexes: that of quality.cl, with what neighbours along u share worked out once.
//
// Hexes side by side share a face of four nodes with two unit edges along v and two along w, and at each of its nodes the
// cross product of one of either: of a hex only the four edges along u are its own, and its eight determinants are their
// products with the cross products of the faces before and behind it.

typedef struct { realv x, y, z; } point;

inline realv dot3(point a, point b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

inline point cross3(point a, point b)
{
    point c = {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
    return c;
}

inline point edge(point from, point to)
{
    point a = {to.x - from.x, to.y - from.y, to.z - from.z};
    return a;
}

inline point times(realv s, point a)
{
    point b = {s * a.x, s * a.y, s * a.z};
    return b;
}

inline realv inverse_length(point a)
{
    realv squared = dot3(a, a);
    return squared > (realv)0 ? rsqrt(squared) : (realv)0;
}

inline point node(__global const real *x, __global const real *y, __global const real *z, size_t i)
{
    point p = {load(x, i), load(y, i), load(z, i)};
    return p;
}

// The cross products n0 to n3 of edges along v and w at the nodes (v, w) = (0, 0), (1, 0), (0, 1), (1, 1) of the face at i.
#define FACE(n, i)                                                                                        \
    {                                                                                                     \
        point a = node(x, y, z, i), b = node(x, y, z, (i) + n_u);                                         \
        point c = node(x, y, z, (i) + layer), d = node(x, y, z, (i) + layer + n_u);                       \
        point v0 = edge(a, b), v1 = edge(c, d), w0 = edge(a, c), w1 = edge(b, d);                         \
        realv p0 = inverse_length(v0), p1 = inverse_length(v1);                                           \
        realv q0 = inverse_length(w0), q1 = inverse_length(w1);                                           \
        n##0 = times(p0 * q0, cross3(v0, w0)), n##1 = times(p0 * q1, cross3(v0, w1));                     \
        n##2 = times(p1 * q0, cross3(v1, w0)), n##3 = times(p1 * q1, cross3(v1, w1));                     \
    }

// Lanes one further on, the last from the vector behind.
#if LANES == 16
#define AHEAD(a, b) (realv)(a.s123, a.s4567, a.s89abcdef, b.s0)
#elif LANES == 8
#define AHEAD(a, b) (realv)(a.s123, a.s4567, b.s0)
#else
#define AHEAD(a, b) b
#endif

inline realv least_of_edge(__global const real *x, __global const real *y, __global const real *z, size_t i,
                           point before, point behind)
{
    point u = edge(node(x, y, z, i), node(x, y, z, i + 1));
    return inverse_length(u) * smaller(dot3(u, before), dot3(u, behind));
}

#define LEAST(c, i)                                                                                              \
    {                                                                                                            \
        point behind = {AHEAD(n##c.x, m##c.x), AHEAD(n##c.y, m##c.y), AHEAD(n##c.z, m##c.z)};                    \
        realv value = least_of_edge(x, y, z, i, n##c, behind);                                                   \
        low = smaller(value, low), sum += value;                                                                 \
    }

// Nodes n_u x n_v x n_w, u fastest; launched over (n_w - 1, n_v - 1, n_u - 1) cells.
ALONE __kernel __attribute__((vec_type_hint(realv)))
void hex_scaled_jacobian(__global const real *x, __global const real *y, __global const real *z, int n_u, int n_v,
                         int n_w, __global real *out)
{
    size_t j = get_global_id(1), k = get_global_id(2), layer = (size_t)n_u * n_v, first = k * layer + j * n_u;
    out += (k * (n_v - 1) + j) * (n_u - 1);
    point n0, n1, n2, n3, m0, m1, m2, m3;
#if LANES > 1
    FACE(n, first + run_start(get_global_id(0), n_u - 1))
#endif
    FOR_LANES(i, n_u - 1) {
        size_t at = first + i;
#if LANES == 1
        FACE(n, at)
#endif
        size_t soon = at + layer + 2 * n_u;
        fetch(x, soon, LANES), fetch(y, soon, LANES), fetch(z, soon, LANES); // the row after the next of the layer behind
        FACE(m, first + min(i + LANES, n_u - 1))
        realv low = 2, sum = 0;
        LEAST(0, at)
        LEAST(1, at + n_u)
        LEAST(2, at + layer)
        LEAST(3, at + layer + n_u)
        store(low + (sum - sum), out, i, n_u - 1 - i); // no number where a node, and so its edge along u, is none
        n0 = m0, n1 = m1, n2 = m2, n3 = m3;
    }
}
