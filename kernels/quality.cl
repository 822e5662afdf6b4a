// Scaled Jacobian of quads and hexes (eqs 3.4 and 3.5 of the paper): at each corner the determinant of the unit edge
// vectors, for the element the least of its corners. A corner with an edge of no length counts 0.
// Source: Knupp 2000; quads in space as the Verdict library defines them, against the normal at the centre.
//
// Every kernel works on LANES elements at once: lane l of a vector belongs to element i + l or first + l.

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

inline realv inverse_length(point a)
{
    realv squared = dot3(a, a);
    return squared > (realv)0 ? rsqrt(squared) : (realv)0;
}

inline point times(realv s, point a)
{
    point b = {s * a.x, s * a.y, s * a.z};
    return b;
}

inline point unit(point a)
{
    return times(inverse_length(a), a);
}

inline point difference(point a, point b)
{
    point c = {a.x - b.x, a.y - b.y, a.z - b.z};
    return c;
}

inline point unit_edge(point from, point to)
{
    return unit(difference(to, from));
}

inline realv det3(point a, point b, point c)
{
    return dot3(a, cross3(b, c));
}

// An edge and one over its length: a determinant is worked out while roots are, and divided by lengths after it.
typedef struct { point along; realv inverse; } edge;

inline edge edge_of(point from, point to)
{
    point along = difference(to, from);
    edge e = {along, inverse_length(along)};
    return e;
}

inline realv corner_of(edge u, edge v, edge w)
{
    return u.inverse * dot3(u.along, times(v.inverse * w.inverse, cross3(v.along, w.along)));
}

// Corners 0 to 3 run round one face, 4 to 7 over them.
inline void hex_corners(const point *p, realv *corner)
{
    edge u0 = edge_of(p[0], p[1]), u1 = edge_of(p[3], p[2]), u2 = edge_of(p[4], p[5]), u3 = edge_of(p[7], p[6]);
    edge v0 = edge_of(p[0], p[3]), v1 = edge_of(p[1], p[2]), v2 = edge_of(p[4], p[7]), v3 = edge_of(p[5], p[6]);
    edge w0 = edge_of(p[0], p[4]), w1 = edge_of(p[1], p[5]), w2 = edge_of(p[2], p[6]), w3 = edge_of(p[3], p[7]);
    corner[0] = corner_of(u0, v0, w0);
    corner[1] = corner_of(u0, v1, w1);
    corner[2] = corner_of(u1, v1, w2);
    corner[3] = corner_of(u1, v0, w3);
    corner[4] = corner_of(u2, v2, w0);
    corner[5] = corner_of(u2, v3, w1);
    corner[6] = corner_of(u3, v3, w2);
    corner[7] = corner_of(u3, v2, w3);
}

inline void quad_corners(const point *p, realv *corner)
{
    point e0 = unit_edge(p[0], p[1]), e1 = unit_edge(p[1], p[2]), e2 = unit_edge(p[2], p[3]), e3 = unit_edge(p[3], p[0]);
    point along = difference(difference(p[1], p[0]), difference(p[3], p[2]));
    point across = difference(difference(p[2], p[1]), difference(p[0], p[3]));
    point normal = unit(cross3(along, across));
    corner[0] = det3(normal, e3, e0);
    corner[1] = det3(normal, e0, e1);
    corner[2] = det3(normal, e1, e2);
    corner[3] = det3(normal, e2, e3);
}

// No number where a node is none: then a corner of the edges at corner 0 is, or at corner 6, which have all nodes of a hex,
// and all of a quad, by its normal.
inline realv least(const realv *corner, int n_corners)
{
    realv low = corner[0];
    for (int c = 1; c < n_corners; c++)
        low = smaller(corner[c], low); // stays none where the first is
    return n_corners == 8 ? low + (corner[6] - corner[6]) : low;
}

// Node `corner` of the cells first ... first + LANES - 1; lanes beyond the last cell repeat it. Nodes are x, y, z and a
// number that is not read.
inline point gather_each(__global const real *nodes, __global const int *cells, int n_corners, int n_cells, int first,
                         int corner)
{
    union { realv v; real lane[LANES]; } px, py, pz;
    for (int lane = 0; lane < LANES; lane++) {
        JOIN(real, 4) node = vload4(cells[(size_t)min(first + lane, n_cells - 1) * n_corners + corner], nodes);
        px.lane[lane] = node.x;
        py.lane[lane] = node.y;
        pz.lane[lane] = node.z;
    }
    point p = {px.v, py.v, pz.v};
    return p;
}

#if LANES == 1
#define corner_of(first, corner, n_corners) gather_each(nodes, cells, n_corners, n_cells, first, corner)
#else
#define NODE(lane) vload4(cell[lane * n_corners], nodes)

// The same in a third of the time: one load a node, and eight nodes turned into lanes within the halves of vectors.
inline point gather(__global const real *nodes, __global const int *cells, int n_corners, int first, int corner)
{
    __global const int *cell = cells + (size_t)first * n_corners + corner;
    realv a = (realv)(NODE(0), NODE(4)), b = (realv)(NODE(1), NODE(5));
    realv c = (realv)(NODE(2), NODE(6)), d = (realv)(NODE(3), NODE(7));
    realv xy_ab = (realv)(a.s0, b.s0, a.s1, b.s1, a.s4, b.s4, a.s5, b.s5);
    realv xy_cd = (realv)(c.s0, d.s0, c.s1, d.s1, c.s4, d.s4, c.s5, d.s5);
    realv z_ab = (realv)(a.s2, b.s2, a.s3, b.s3, a.s6, b.s6, a.s7, b.s7);
    realv z_cd = (realv)(c.s2, d.s2, c.s3, d.s3, c.s6, d.s6, c.s7, d.s7);
    point p = {(realv)(xy_ab.s01, xy_cd.s01, xy_ab.s45, xy_cd.s45), (realv)(xy_ab.s23, xy_cd.s23, xy_ab.s67, xy_cd.s67),
               (realv)(z_ab.s01, z_cd.s01, z_ab.s45, z_cd.s45)};
    return p;
}
#define corner_of(first, corner, n_corners) \
    (first + LANES <= n_cells ? gather(nodes, cells, n_corners, first, corner) \
                              : gather_each(nodes, cells, n_corners, n_cells, first, corner))
#endif

inline point row(__global const real *x, __global const real *y, __global const real *z, size_t node)
{
    point p = {load(x, node), load(y, node), load(z, node)};
    return p;
}

#define TWO_NODES(a, b) (realv)(px.s##a, py.s##a, pz.s##a, 0, px.s##b, py.s##b, pz.s##b, 0)

// nodes: (n_nodes, 4), the fourth is 0.
__kernel __attribute__((vec_type_hint(realv)))
void interleave(__global const real *x, __global const real *y, __global const real *z, int n_nodes,
                __global real *nodes)
{
    FOR_LANES(first, n_nodes) {
        realv px = load(x, first), py = load(y, first), pz = load(z, first);
#if LANES == 1
        vstore4((JOIN(real, 4))(px, py, pz, 0), first, nodes);
#else
        realv two[4] = {TWO_NODES(0, 1), TWO_NODES(2, 3), TWO_NODES(4, 5), TWO_NODES(6, 7)};
        for (int pair = 0; pair < 4; pair++)
            stream(two[pair], nodes, 4 * (size_t)first + 8 * pair, 4 * (n_nodes - first) - 8 * pair);
#endif
    }
}

__kernel __attribute__((vec_type_hint(realv)))
void hex_scaled_jacobian(__global const real *nodes, __global const int *cells, int n_cells,
                         __global real *out)
{
    FOR_LANES(first, n_cells) {
        point p[8];
        realv corner[8];
        for (int c = 0; c < 8; c++)
            p[c] = corner_of(first, c, 8);
        hex_corners(p, corner);
        store(least(corner, 8), out, first, n_cells - first);
    }
}

__kernel __attribute__((vec_type_hint(realv)))
void quad_scaled_jacobian(__global const real *nodes, __global const int *cells, int n_cells,
                          __global real *out)
{
    FOR_LANES(first, n_cells) {
        point p[4];
        realv corner[4];
        for (int c = 0; c < 4; c++)
            p[c] = corner_of(first, c, 4);
        quad_corners(p, corner);
        store(least(corner, 4), out, first, n_cells - first);
    }
}

// out: (8, n_cells) planes
__kernel __attribute__((vec_type_hint(realv)))
void hex_corner_jacobian(__global const real *nodes, __global const int *cells, int n_cells,
                         __global real *out)
{
    FOR_LANES(first, n_cells) {
        point p[8];
        realv corner[8];
        for (int c = 0; c < 8; c++)
            p[c] = corner_of(first, c, 8);
        hex_corners(p, corner);
        for (int c = 0; c < 8; c++)
            store(corner[c], out, (size_t)c * n_cells + first, n_cells - first);
    }
}

// out: (4, n_cells) planes
__kernel __attribute__((vec_type_hint(realv)))
void quad_corner_jacobian(__global const real *nodes, __global const int *cells, int n_cells,
                          __global real *out)
{
    FOR_LANES(first, n_cells) {
        point p[4];
        realv corner[4];
        for (int c = 0; c < 4; c++)
            p[c] = corner_of(first, c, 4);
        quad_corners(p, corner);
        for (int c = 0; c < 4; c++)
            store(corner[c], out, (size_t)c * n_cells + first, n_cells - first);
    }
}

// Nodes n_u x n_v, u fastest; launched over (n_v - 1, n_u - 1) cells.
__kernel __attribute__((vec_type_hint(realv)))
void quad_scaled_jacobian_structured(__global const real *x, __global const real *y, __global const real *z, int n_u,
                                     int n_v, __global real *out)
{
    size_t j = get_global_id(1);
    out += j * (n_u - 1);
    FOR_LANES(i, n_u - 1) {
        size_t a = j * n_u + i, b = a + n_u;
        point p[4] = {row(x, y, z, a), row(x, y, z, a + 1), row(x, y, z, b + 1), row(x, y, z, b)};
        realv corner[4];
        quad_corners(p, corner);
        store(least(corner, 4), out, i, n_u - 1 - i);
    }
}
