// Linear elasticity of a structured mesh of hex8: K u by rows of elements, without connectivity, matrix or gather.
//
// The mathematics, 2 x 2 x 2 Gauss points and names are those of elasticity.cl. Nodes are n_u x n_v x n_w, u fastest, so
// that the vertices a of a run of elements along u lie side by side in the planes. Derivatives are 12 a component: 4
// along u, 4 along v, 4 along w.
//
// What elements give their nodes goes into `shares` (n_w, n_v, 4, 3, 2, n_u): of each row of nodes what comes from elements
// on its 4 sides, a component after the other, from the right and from the left of each node. No two elements write the
// same number, and what none writes must be 0. The force on a node is the sum of its 8, always in this order.

#define GAUSS 0.21132486540518711775 // (1 - 1 / sqrt 3) / 2
#define WEIGHT 0.125

// Values at four corners (0, 0), (1, 0), (0, 1), (1, 1) to the four Gauss points in the same order; its own transpose.
inline void bilinear(realv a, realv b, realv c, realv d, realv *out)
{
    realv s = (realv)GAUSS * (b - a), t = (realv)GAUSS * (d - c);
    realv p = a + s, q = b - s, r = c + t, o = d - t;
    realv u = (realv)GAUSS * (r - p), v = (realv)GAUSS * (o - q);
    out[0] = p + u;
    out[1] = q + v;
    out[2] = r - u;
    out[3] = o - v;
}

// Derivatives (12) of a trilinear function, 4 along each parameter at the Gauss points of the other two.
inline void along(realv *d, __global const real *plane, size_t at, int n_u, int n_uv)
{
    realv a = load(plane, at), b = load(plane, at + 1), c = load(plane, at + n_u + 1), e = load(plane, at + n_u);
    at += n_uv;
    realv p = load(plane, at), q = load(plane, at + 1), r = load(plane, at + n_u + 1), s = load(plane, at + n_u);
    bilinear(b - a, c - e, q - p, r - s, d);
    bilinear(e - a, c - b, s - p, r - q, d + 4);
    bilinear(p - a, q - b, s - e, r - c, d + 8);
}

// The transpose of `along`, of `count` lanes; `at` is where the component begins in the block of the nodes of vertex 0.
inline void store_vertices(const realv *d, size_t at, int n_u, int n_v, int count, __global real *out)
{
    realv u[4], v[4], w[4];
    bilinear(d[0], d[1], d[2], d[3], u);
    bilinear(d[4], d[5], d[6], d[7], v);
    bilinear(d[8], d[9], d[10], d[11], w);
    size_t b = at + 30 * (size_t)n_u; // the next row of nodes, and there the next 6 of its 24
    size_t e = at + (24 * (size_t)n_v + 12) * n_u, f = e + 30 * (size_t)n_u;
    store(-u[0] - v[0] - w[0], out, at, count);
    store(u[0] - v[1] - w[1], out, at + n_u + 1, count);
    store(v[0] - u[1] - w[2], out, b, count);
    store(u[1] + v[1] - w[3], out, b + n_u + 1, count);
    store(w[0] - u[2] - v[2], out, e, count);
    store(u[2] - v[3] + w[1], out, e + n_u + 1, count);
    store(v[2] - u[3] + w[2], out, f, count);
    store(u[3] + v[3] + w[3], out, f + n_u + 1, count);
}

inline realv dot3(realv a, realv b, realv c, realv x, realv y, realv z)
{
    return a * x + b * y + c * z;
}

// What the stress at Gauss point g gives against the derivatives, added to f.
inline void add_forces(const realv *x, const realv *h, realv *f, int g, realv lambda, realv mu)
{
    int i = g >> 2, j = (g >> 1) & 1, k = g & 1, u = j + 2 * k, v = 4 + i + 2 * k, w = 8 + i + 2 * j;
    realv xu = x[u], xv = x[v], xw = x[w], yu = x[12 + u], yv = x[12 + v], yw = x[12 + w];
    realv zu = x[24 + u], zv = x[24 + v], zw = x[24 + w];
    realv a0 = yv * zw - yw * zv, a1 = zv * xw - zw * xv, a2 = xv * yw - xw * yv; // rows of A
    realv b0 = yw * zu - yu * zw, b1 = zw * xu - zu * xw, b2 = xw * yu - xu * yw;
    realv c0 = yu * zv - yv * zu, c1 = zu * xv - zv * xu, c2 = xu * yv - xv * yu;
    realv factor = (realv)WEIGHT / dot3(xu, yu, zu, a0, a1, a2), shear = factor * mu, twice = shear + shear;
    realv hu = h[u], hv = h[v], hw = h[w];
    realv xx = dot3(hu, hv, hw, a0, b0, c0), xy = dot3(hu, hv, hw, a1, b1, c1), xz = dot3(hu, hv, hw, a2, b2, c2);
    hu = h[12 + u], hv = h[12 + v], hw = h[12 + w];
    realv yy = dot3(hu, hv, hw, a1, b1, c1), yz = dot3(hu, hv, hw, a2, b2, c2);
    xy += dot3(hu, hv, hw, a0, b0, c0);
    hu = h[24 + u], hv = h[24 + v], hw = h[24 + w];
    realv zz = dot3(hu, hv, hw, a2, b2, c2);
    xz += dot3(hu, hv, hw, a0, b0, c0);
    yz += dot3(hu, hv, hw, a1, b1, c1);
    realv pressure = factor * lambda * (xx + yy + zz);
    xx = pressure + twice * xx, yy = pressure + twice * yy, zz = pressure + twice * zz;
    yz *= shear, xz *= shear, xy *= shear;
    f[u] += dot3(xx, xy, xz, a0, a1, a2);
    f[v] += dot3(xx, xy, xz, b0, b1, b2);
    f[w] += dot3(xx, xy, xz, c0, c1, c2);
    f[12 + u] += dot3(xy, yy, yz, a0, a1, a2);
    f[12 + v] += dot3(xy, yy, yz, b0, b1, b2);
    f[12 + w] += dot3(xy, yy, yz, c0, c1, c2);
    f[24 + u] += dot3(xz, yz, zz, a0, a1, a2);
    f[24 + v] += dot3(xz, yz, zz, b0, b1, b2);
    f[24 + w] += dot3(xz, yz, zz, c0, c1, c2);
}

// Shares of the nodes' forces; launched over (n_w - 1, n_v - 1, n_u - 1) elements.
__kernel __attribute__((vec_type_hint(realv)))
void shares(__global const real *points, __global const real *displacement, int n_u, int n_v, int n_w,
            __global const real *lam, __global const real *mu, __global real *out) ALONE
{
    size_t row = get_global_id(1), layer = get_global_id(2);
    int n_uv = n_u * n_v, n = n_uv * n_w, m = (n_u - 1) * (n_v - 1) * (n_w - 1);
    FOR_LANES(begin, n_u - 1) {
        int column = max(0, min(begin, n_u - 1 - LANES)); // the last vector of a row overlaps the one before it
        size_t at = layer * n_uv + row * n_u + column;
        size_t place = (layer * (n_v - 1) + row) * (n_u - 1) + column;
        size_t block = 24 * (layer * n_v + row) * n_u + column;
        realv x[36], h[36], f[36];
        for (int c = 0; c < 3; c++) {
            along(x + 12 * c, points + (size_t)c * n, at, n_u, n_uv);
            along(h + 12 * c, displacement + (size_t)c * n, at, n_u, n_uv);
        }
        for (int q = 0; q < 36; q++)
            f[q] = 0;
        for (int g = 0; g < 8; g++)
            add_forces(x, h, f, g, load(lam, place + (size_t)g * m), load(mu, place + (size_t)g * m));
        for (int c = 0; c < 3; c++)
            store_vertices(f + 12 * c, block + 2 * c * n_u, n_u, n_v, n_u - 1 - column, out);
    }
}

// Forces (3, n) from the shares, 0 where `free` (3, n) is 0; launched over (n_rows, n_u) nodes.
__kernel __attribute__((vec_type_hint(realv)))
void sum_shares(__global const real *values, __global const real *free, int n_u, int n_rows, __global real *out)
{
    size_t row = get_global_id(1), side = 6 * (size_t)n_u;
    FOR_LANES(i, n_u) {
        for (int c = 0; c < 3; c++) {
            __global const real *a = values + (24 * row + 2 * c) * n_u + i, *b = a + n_u;
            realv low = (load(a, 0) + load(b, 0)) + (load(a, side) + load(b, side));
            realv high = (load(a, 2 * side) + load(b, 2 * side)) + (load(a, 3 * side) + load(b, 3 * side));
            size_t at = ((size_t)c * n_rows + row) * n_u + i;
            store((low + high) * load(free, at), out, at, n_u - i);
        }
    }
}
