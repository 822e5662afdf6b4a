// WIDE
// Linear elasticity of a structured mesh of hex8: K u by rows of elements, without connectivity, matrix or gather.
//
// The mathematics, 2 x 2 x 2 Gauss points and names are those of elasticity.h. Nodes are n_u x n_v x n_w, u fastest, so
// that the vertices a of a run of elements along u lie side by side in the planes. Derivatives are 12 a component: 4
// along u, 4 along v, 4 along w.
//
// A GPU takes each element alone: what elements give their nodes goes into `shares` (n_w, n_v, 4, 3, 2, n_u): of each row
// of nodes what comes from elements on its 4 sides, a component after the other, from the right and from the left of
// each node. No two elements write the same number, and what none writes must be 0. The force on a node is the sum of
// its 8, always in this order.
//
// A CPU takes `size` x `size` rows of elements at a time, a brick, and sums in its caches what they give their nodes:
// `bricks` (bricks along w, along v, 3, size + 1, size + 1, n_u). The force on a node is the sum of its 1, 2 or 4. Rows
// of a brick are short and many lie side by side, more than a processor fetches by itself: it is told which come next.

// Nothing here must round alike on both backends, as meshes must: products and sums may be fused.
#pragma OPENCL FP_CONTRACT ON

#define NEAR 0.21132486540518711775 // (1 - 1 / sqrt 3) / 2, the nearer Gauss point
#define FAR 0.78867513459481288225
#define WEIGHT 0.125

// Values at four corners (0, 0), (1, 0), (0, 1), (1, 1) to the four Gauss points in the same order; its own transpose.
inline void bilinear(realv a, realv b, realv c, realv d, realv *out)
{
    realv s = b - a, t = d - c;
    realv p = a + (realv)NEAR * s, q = a + (realv)FAR * s, r = c + (realv)NEAR * t, o = c + (realv)FAR * t;
    realv u = r - p, v = o - q;
    out[0] = p + (realv)NEAR * u;
    out[1] = q + (realv)NEAR * v;
    out[2] = p + (realv)FAR * u;
    out[3] = q + (realv)FAR * v;
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

// The transpose of `along`: what the vertices get, u fastest.
inline void vertices(const realv *d, realv *out)
{
    realv u[4], v[4], w[4];
    bilinear(d[0], d[1], d[2], d[3], u);
    bilinear(d[4], d[5], d[6], d[7], v);
    bilinear(d[8], d[9], d[10], d[11], w);
    out[0] = -u[0] - v[0] - w[0];
    out[1] = u[0] - v[1] - w[1];
    out[2] = v[0] - u[1] - w[2];
    out[3] = u[1] + v[1] - w[3];
    out[4] = w[0] - u[2] - v[2];
    out[5] = u[2] - v[3] + w[1];
    out[6] = v[2] - u[3] + w[2];
    out[7] = u[3] + v[3] + w[3];
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

// Forces against the derivatives (36) of elements whose vertices 0 are the nodes from `at` on; moduli of one Gauss point
// are `step` from those of the next.
inline void forces_of(realv *f, __global const real *points, __global const real *displacement, size_t at, int n_u,
                      int n_uv, int n, __global const real *lam, __global const real *mu, size_t step)
{
    realv x[36], h[36];
    for (int c = 0; c < 3; c++) {
        along(x + 12 * c, points + (size_t)c * n, at, n_u, n_uv);
        along(h + 12 * c, displacement + (size_t)c * n, at, n_u, n_uv);
    }
    for (int q = 0; q < 36; q++)
        f[q] = 0;
    for (int g = 0; g < 8; g++)
        add_forces(x, h, f, g, load(lam, g * step), load(mu, g * step));
}

// Shares of the nodes' forces; launched over (n_w - 1, n_v - 1, n_u - 1) elements.
__kernel __attribute__((vec_type_hint(realv)))
void shares(__global const real *points, __global const real *displacement, int n_u, int n_v, int n_w,
            __global const real *lam, __global const real *mu, __global real *out) ALONE
{
    size_t row = get_global_id(1), layer = get_global_id(2), side = 6 * (size_t)n_u;
    int n_uv = n_u * n_v, n = n_uv * n_w, n_e = (n_u - 1) * (n_v - 1) * (n_w - 1);
    FOR_LANES(i, n_u - 1) {
        realv f[36], v[8];
        size_t place = (layer * (n_v - 1) + row) * (n_u - 1) + i;
        size_t at = layer * n_uv + row * n_u + i;
        forces_of(f, points, displacement, at, n_u, n_uv, n, lam + place, mu + place, n_e);
        for (int c = 0; c < 3; c++) {
            vertices(f + 12 * c, v);
            for (int a = 0; a < 8; a++) {
                size_t node_row = (layer + a / 4) * n_v + row + (a / 2) % 2;
                size_t to = (4 * node_row + a / 2) * side + (2 * c + a % 2) * n_u + i + a % 2;
                store(v[a], out, to, n_u - 1 - i);
            }
        }
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

// Asks for the nodes two rows on of the layer above, and for the moduli of the next row.
inline void fetch_rows(size_t at, __global const real *points, __global const real *displacement, int n_u, int n_uv,
                       int n, __global const real *lam, __global const real *mu, size_t step)
{
    for (int c = 0; c < 3; c++) {
        fetch(points, (size_t)c * n + at + n_uv + 2 * n_u, 1);
        fetch(displacement, (size_t)c * n + at + n_uv + 2 * n_u, 1);
    }
    for (int g = 0; g < 8; g++) {
        fetch(lam, g * step + n_u - 1, 1);
        fetch(mu, g * step + n_u - 1, 1);
    }
}

// Sums of bricks of `size` x `size` rows; launched over (bricks along w, along v, n_u - 1): the first work item of a brick
// takes it all.
__kernel __attribute__((vec_type_hint(realv)))
void bricks(__global const real *points, __global const real *displacement, int n_u, int n_v, int n_w,
            __global const real *lam, __global const real *mu, int size, __global real *out) ALONE
{
    int n_uv = n_u * n_v, n = n_uv * n_w, n_e = (n_u - 1) * (n_v - 1) * (n_w - 1);
    int row = get_global_id(1) * size, layer = get_global_id(2) * size;
    int rows = min(size, n_v - 1 - row), layers = min(size, n_w - 1 - layer);
    size_t deep = (size_t)(size + 1) * n_u, component = (size + 1) * deep;
    out += (get_global_id(2) * get_global_size(1) + get_global_id(1)) * 3 * component;
    if (get_global_id(0))
        return;
    for (size_t i = 0; i < 3 * component; i += LANES)
        store((realv)0, out, i, 3 * component - i);
    for (int k = 0; k < layers; k++)
        for (int j = 0; j < rows; j++)
            for (int i = 0; i < n_u - 1; i += LANES) {
                realv f[36], v[24];
                size_t place = ((size_t)(layer + k) * (n_v - 1) + row + j) * (n_u - 1) + i;
                size_t at = (size_t)(layer + k) * n_uv + (row + j) * n_u + i;
                fetch_rows(at, points, displacement, n_u, n_uv, n, lam + place, mu + place, n_e);
                forces_of(f, points, displacement, at, n_u, n_uv, n, lam + place, mu + place, n_e);
                for (int c = 0; c < 3; c++)
                    vertices(f + 12 * c, v + 8 * c);
                for (int side = 0; side < 2; side++) // the left vertices of all first: the right ones wait for them
                    for (int c = 0; c < 3; c++)
                        for (int a = side; a < 8; a += 2) {
                            size_t to = c * component + (k + a / 4) * deep + (j + (a / 2) % 2) * n_u + i + side;
                            store(load(out, to) + v[8 * c + a], out, to, n_u - 1 - i);
                        }
            }
}

// Forces (3, n) from the bricks, 0 where `free` (3, n) is 0; launched over (n_w, n_v, n_u) nodes.
__kernel __attribute__((vec_type_hint(realv)))
void sum_bricks(__global const real *values, __global const real *free, int n_u, int n_v, int n_w, int size,
                __global real *out)
{
    int row = get_global_id(1), layer = get_global_id(2), along_v = (n_v - 2) / size + 1, along_w = (n_w - 2) / size + 1;
    int first_v = max(row - 1, 0) / size, last_v = min(row / size, along_v - 1);
    int first_w = max(layer - 1, 0) / size, last_w = min(layer / size, along_w - 1);
    size_t deep = (size_t)(size + 1) * n_u, component = (size + 1) * deep, n = (size_t)n_u * n_v * n_w;
    FOR_LANES(i, n_u) {
        for (int c = 0; c < 3; c++) {
            realv sum = 0;
            for (int q = first_w; q <= last_w; q++)
                for (int p = first_v; p <= last_v; p++) {
                    size_t brick = (size_t)q * along_v + p;
                    sum += load(values, (3 * brick + c) * component + (layer - q * size) * deep + (row - p * size) * n_u + i);
                }
            size_t at = c * n + ((size_t)layer * n_v + row) * n_u + i;
            store(sum * load(free, at), out, at, n_u - i);
        }
    }
}
