// WIDE
// Linear elasticity of a structured mesh of hex8: K u by rows of elements, without connectivity, matrix or gather.
//
// The mathematics, 2 x 2 x 2 Gauss points and names are those of trilinear.h. Nodes are n_u x n_v x n_w, u fastest, so
// that the vertices a of a run of elements along u lie side by side in the planes.
//
// A GPU takes each element alone: what elements give their nodes goes into `shares` (n_w, n_v, 4, 3, 2, n_u): of each row
// of nodes what comes from elements on its 4 sides, a component after the other, from the right and from the left of
// each node. No two elements write the same number, and what none writes must be 0. The force on a node is the sum of
// its 8, always in this order.
//
// A CPU takes `size` x `size` rows of elements at a time, a brick, and sums in its caches what they give their nodes:
// `bricks` (bricks along w, along v, 3, size + 1, size + 1, n_u). The force on a node is the sum of its 1, 2 or 4. Rows
// of a brick are short and many lie side by side, more than a processor fetches by itself: it is told which come next.

#include "trilinear.h"

// Derivatives (12) of what a plane holds at the vertices of the elements from `at` on.
inline void along(realv *d, __global const real *plane, size_t at, int n_u, int n_uv)
{
    size_t to = at + n_u, up = at + n_uv, far = up + n_u;
    realv v[8] = {load(plane, at), load(plane, at + 1), load(plane, to), load(plane, to + 1),
                  load(plane, up), load(plane, up + 1), load(plane, far), load(plane, far + 1)};
    derivatives(v, d);
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
    stressed(x, h, f, lam, mu, step);
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
