// Scaled Jacobian of structured hexes on a GPU: what cells along w and two rows of them share is worked out once.

#define TILE 32     // cells along u whose nodes a group reads at once
#define TILE_ROWS 4 // such tiles along v, of two cells each, which read the same nodes
#define SHORTEST ((real)1e-37) // squared, of an edge
typedef JOIN(real, 3) vec3;

inline vec3 node(__global const real *x, __global const real *y, __global const real *z, int at)
{
    return (vec3)(x[at], y[at], z[at]);
}

// Written out: what a vendor's own does is not known to fuse its products and sums.
inline real dot3(vec3 a, vec3 b)
{
    return a.x * b.x + (a.y * b.y + a.z * b.z);
}

inline vec3 cross3(vec3 a, vec3 b)
{
    return (vec3)(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}

// 1 / length, and of an edge without length a number.
inline real inverse_length(vec3 edge)
{
    return root_of_inverse(edge.x * edge.x + (edge.y * edge.y + (edge.z * edge.z + SHORTEST)));
}

inline vec3 unit_between(vec3 a, vec3 b)
{
    return (b - a) * inverse_length(b - a);
}

// Cross products at the nodes (0, 0), (1, 0), (0, 1), (1, 1) of a face with edges u, v along u and a, b along v.
#define NORMALS(n0, n1, n2, n3, u, v, a, b) \
    n0 = cross3(u, a), n1 = cross3(u, b), n2 = cross3(v, a), n3 = cross3(v, b)

inline real least_of_edge(vec3 edge, real inverse, vec3 before, vec3 behind)
{
    return fmin(dot3(edge, before), dot3(edge, behind)) * inverse;
}

// No number where one is none.
inline real least_of_four(real a, real b, real c, real d)
{
    real total = (a + b) + (c + d);
    return fmin(fmin(a, b), fmin(c, d)) + (total - total);
}

// Nodes n_u x n_v x n_w, u fastest; launched over (parts, bands * chunks * TILE_ROWS * TILE).
//
// A part is `part` cells along w, a band TILE_ROWS pairs of cells along v, a chunk TILE cells along u. A work item goes
// along w with two cells, one behind the other along v: edges that they share are worked out once, and so are the cross
// products of the faces between cells and those that follow. Six nodes, u fastest, are a to f here, and g, h, p to s in the
// next plane.
GROUP(TILE * TILE_ROWS) __kernel
void hex_scaled_jacobian(__global const real *restrict x, __global const real *restrict y,
                         __global const real *restrict z, int n_u, int n_v, int n_w, int part,
                         __global real *restrict out)
{
    int item = get_global_id(0), n_chunks = (n_u - 1 + TILE - 1) / TILE, tile = item / TILE;
    int i = tile / TILE_ROWS % n_chunks * TILE + item % TILE;
    int j = 2 * (tile / (TILE_ROWS * n_chunks) * TILE_ROWS + tile % TILE_ROWS);
    if (i >= n_u - 1 || j >= n_v - 1)
        return;
    int k = get_global_id(1) * part, end = min(k + part, n_w - 1);
    int on = j + 2 < n_v ? n_u : 0; // to the nodes of the second cell, where there is one
    int at = (k * n_v + j) * n_u + i, to = (k * (n_v - 1) + j) * (n_u - 1) + i;
    int layer = n_u * n_v, cells = (n_u - 1) * (n_v - 1);
    vec3 a = node(x, y, z, at), b = node(x, y, z, at + 1), c = node(x, y, z, at + n_u), d = node(x, y, z, at + n_u + 1);
    vec3 e = node(x, y, z, at + n_u + on), f = node(x, y, z, at + n_u + on + 1), u = unit_between(c, d);
    vec3 m0, m1, m2, m3, m4, m5, m6, m7, n0, n1, n2, n3, n4, n5, n6, n7;
    NORMALS(m0, m1, m2, m3, unit_between(a, b), u, unit_between(a, c), unit_between(b, d));
    NORMALS(m4, m5, m6, m7, u, unit_between(e, f), unit_between(c, e), unit_between(d, f));
    for (; k < end; k++, to += cells) {
        at += layer;
        vec3 g = node(x, y, z, at), h = node(x, y, z, at + 1);
        vec3 p = node(x, y, z, at + n_u), q = node(x, y, z, at + n_u + 1);
        vec3 r = node(x, y, z, at + n_u + on), s = node(x, y, z, at + n_u + on + 1);
        u = unit_between(p, q);
        NORMALS(n0, n1, n2, n3, unit_between(g, h), u, unit_between(g, p), unit_between(h, q));
        NORMALS(n4, n5, n6, n7, u, unit_between(r, s), unit_between(p, r), unit_between(q, s));
        vec3 edge_c = p - c, edge_d = q - d;
        real inverse_c = inverse_length(edge_c), inverse_d = inverse_length(edge_d);
        out[to] = least_of_four(least_of_edge(g - a, inverse_length(g - a), m0, n0),
                                least_of_edge(h - b, inverse_length(h - b), m1, n1),
                                least_of_edge(edge_c, inverse_c, m2, n2), least_of_edge(edge_d, inverse_d, m3, n3));
        real behind = least_of_four(least_of_edge(edge_c, inverse_c, m4, n4), least_of_edge(edge_d, inverse_d, m5, n5),
                                    least_of_edge(r - e, inverse_length(r - e), m6, n6),
                                    least_of_edge(s - f, inverse_length(s - f), m7, n7));
        if (on)
            out[to + n_u - 1] = behind;
        a = g, b = h, c = p, d = q, e = r, f = s;
        m0 = n0, m1 = n1, m2 = n2, m3 = n3, m4 = n4, m5 = n5, m6 = n6, m7 = n7;
    }
}
