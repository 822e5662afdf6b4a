// Matrices of structured grids: each node's 3 x 3 blocks with itself and its 26 neighbours, for the multigrid.
//
// Entry q = 9 o + 3 row + column of node i, o = (du + 1) + 3 (dv + 1) + 9 (dw + 1), lies at ((i / 8) 243 + q) 8 + i % 8:
// eight nodes together, read as one stream. Vectors are three planes, x, y, z, each with `pad` zeros before and after,
// which planes share, so that the neighbours of nodes at the ends are in reach: their entries are 0.

#define ENTRIES 243
#define TILE(i) (((size_t)(i) >> 3) * ENTRIES * 8 + ((i) & 7))

inline void product(int i, __global const real *stencil, __global const real *x, int n_u, int n_v, int pitch, realv *y)
{
    stencil += TILE(i);
    for (int dw = -1; dw <= 1; dw++)
        for (int dv = -1; dv <= 1; dv++) {
            __global const real *from = x + i + n_u * (dv + n_v * dw);
            for (int du = -1; du <= 1; du++, stencil += 72)
                for (int column = 0; column < 3; column++) {
                    realv value = load(from, column * (size_t)pitch + du);
                    for (int row = 0; row < 3; row++)
                        y[row] += load(stencil, 8 * (3 * row + column)) * value;
                }
        }
}

// r = b - S x
__kernel __attribute__((vec_type_hint(realv)))
void defect(__global const real *stencil, __global const real *b, __global const real *x, int n_u, int n_v, int n,
            int pad, __global real *r)
{
    int pitch = n + pad;
    FOR_LANES(i, n) {
        realv y[3] = {0, 0, 0};
        product(i, stencil, x + pad, n_u, n_v, pitch, y);
        for (int c = 0; c < 3; c++) {
            size_t at = pad + c * (size_t)pitch + i;
            store(load(b, at) - y[c], r, at, n - i);
        }
    }
}

// A step of Richardson's iteration at node i: out = keep x + step B (b - y), B the inverse (6, n) of the nodes' own blocks.
// Where `still` is not 0, x is 0.
inline void relaxed(int i, __global const real *inverse, __global const real *b, __global const real *x, const realv *y,
                    int still, real keep, real step, int n, int pad, __global real *out)
{
    size_t pitch = n + pad;
    realv z[3], r[3];
    for (int c = 0; c < 3; c++)
        r[c] = load(b, pad + c * pitch + i) - y[c];
    realv yz = load(inverse, 3 * (size_t)n + i), xz = load(inverse, 4 * (size_t)n + i);
    realv xy = load(inverse, 5 * (size_t)n + i);
    z[0] = load(inverse, i) * r[0] + xy * r[1] + xz * r[2];
    z[1] = xy * r[0] + load(inverse, n + i) * r[1] + yz * r[2];
    z[2] = xz * r[0] + yz * r[1] + load(inverse, 2 * (size_t)n + i) * r[2];
    for (int c = 0; c < 3; c++) {
        size_t at = pad + c * pitch + i;
        store(still ? step * z[c] : keep * load(x, at) + step * z[c], out, at, n - i);
    }
}

// That step with y = S x.
__kernel __attribute__((vec_type_hint(realv)))
void smooth(__global const real *stencil, __global const real *inverse, __global const real *b, __global const real *x,
            int still, real keep, real step, int n_u, int n_v, int n, int pad, __global real *out)
{
    FOR_LANES(i, n) {
        realv y[3] = {0, 0, 0};
        if (!still)
            product(i, stencil, x + pad, n_u, n_v, n + pad, y);
        relaxed(i, inverse, b, x, y, still, keep, step, n, pad, out);
    }
}

// That step with a y (3, n) that is known.
__kernel __attribute__((vec_type_hint(realv)))
void relax(__global const real *known, __global const real *inverse, __global const real *b, __global const real *x,
           int still, real keep, real step, int n, __global real *out)
{
    FOR_LANES(i, n) {
        realv y[3] = {0, 0, 0};
        for (int c = 0; c < 3 && !still; c++)
            y[c] = load(known, c * (size_t)n + i);
        relaxed(i, inverse, b, x, y, still, keep, step, n, 0, out);
    }
}

// Sets the entries of one column for the neighbours whose place is `at_u`, `at_v`, `at_w` modulo 3, of which each node has
// one: y is the product with a vector that is 1 there and 0 elsewhere. Launched over (n_w, n_v, n_u).
__kernel void set_column(__global const real *y, int n_u, int n_v, int n, int pad, int at_u, int at_v, int at_w, int column,
                         __global real *stencil)
{
    int u = get_global_id(0), v = get_global_id(1), w = get_global_id(2), i = u + n_u * (v + n_v * w);
    if (u >= n_u)
        return;
    int o = (at_u - u % 3 + 4) % 3 + 3 * ((at_v - v % 3 + 4) % 3) + 9 * ((at_w - w % 3 + 4) % 3);
    for (int row = 0; row < 3; row++)
        stencil[TILE(i) + 8 * (9 * o + 3 * row + column)] = y[pad + row * (size_t)(n + pad) + i];
}

// Blocks (6, n) of the nodes with themselves: xx, yy, zz, yz, xz, xy.
__kernel void own_blocks(__global const real *stencil, int n, __global real *blocks)
{
    int i = get_global_id(0);
    if (i >= n)
        return;
    stencil += TILE(i) + 8 * 117;
    blocks[i] = stencil[0];
    blocks[n + i] = stencil[32];
    blocks[2 * (size_t)n + i] = stencil[64];
    blocks[3 * (size_t)n + i] = stencil[40];
    blocks[4 * (size_t)n + i] = stencil[16];
    blocks[5 * (size_t)n + i] = stencil[8];
}

// Coarse grids take some of the nodes of each direction. Node J of a direction lies at `centre[J]`; its function is
// `side[2 J]` one node before and `side[2 J + 1]` one node after, 0 or 1/2. Directions follow each other.
inline real weight(int J, __global const int *centre, __global const real *side, int at)
{
    int away = at - centre[J];
    return away == 0 ? (real)1 : away == -1 ? side[2 * J] : away == 1 ? side[2 * J + 1] : (real)0;
}

// S of a grid that is coarser along one axis only, with `count` nodes there, P^T S P; launched over (27, its nodes). What
// `centre` and `side` say of that axis begins at `begin`.
__kernel void coarsen(__global const real *stencil, int n_u, int n_v, int n_w, int axis, int count, int begin,
                      __global const int *centre, __global const real *side, __global real *coarse)
{
    int c_u = axis == 0 ? count : n_u, c_v = axis == 1 ? count : n_v, c_w = axis == 2 ? count : n_w;
    int I = get_global_id(0), o = get_global_id(1);
    if (I >= c_u * c_v * c_w)
        return;
    int u = I % c_u, v = I / c_u % c_v, w = I / c_u / c_v, step = axis == 0 ? u : axis == 1 ? v : w;
    int stride = axis == 0 ? 1 : axis == 1 ? n_u : n_u * n_v, power = axis == 0 ? 1 : axis == 1 ? 3 : 9;
    int start = (axis == 0 ? 0 : u) + n_u * ((axis == 1 ? 0 : v) + n_v * (axis == 2 ? 0 : w));
    int shift = o / power % 3 - 1, other = step + shift;
    real sum[9] = {0, 0, 0, 0, 0, 0, 0, 0, 0};
    for (int row = -1; row <= 1 && other >= 0 && other < count; row++) {
        int at = centre[begin + step] + row;
        real share = weight(begin + step, centre, side, at);
        if (share == 0)
            continue;
        __global const real *entries = stencil + TILE(start + at * stride);
        for (int q = -1; q <= 1; q++) {
            real value = share * weight(begin + other, centre, side, at + q);
            if (value != 0)
                for (int entry = 0; entry < 9; entry++)
                    sum[entry] += value * entries[8 * (9 * (o + (q - shift) * power) + entry)];
        }
    }
    for (int entry = 0; entry < 9; entry++)
        coarse[TILE(I) + 8 * (9 * o + entry)] = sum[entry];
}

// coarse = P^T fine; launched over the coarse nodes (w, v, u).
__kernel void restrict_vector(__global const real *fine, int n_u, int n_v, int n, int fine_pad, int c_u, int c_v,
                              int n_coarse, int pad, __global const int *centre, __global const real *side,
                              __global real *coarse)
{
    int u = get_global_id(0), v = get_global_id(1), w = get_global_id(2), first_w = c_u + c_v + w, first_v = c_u + v;
    if (u >= c_u)
        return;
    size_t pitch = n + fine_pad;
    real before = side[2 * u], after = side[2 * u + 1], sum[3] = {0, 0, 0};
    for (int dw = -1; dw <= 1; dw++) {
        real of_w = weight(first_w, centre, side, centre[first_w] + dw);
        for (int dv = -1; dv <= 1; dv++) {
            real value = of_w * weight(first_v, centre, side, centre[first_v] + dv);
            if (value == 0)
                continue;
            int row = n_u * (centre[first_v] + dv + n_v * (centre[first_w] + dw)) + centre[u];
            for (int c = 0; c < 3; c++) {
                __global const real *from = fine + fine_pad + c * pitch + row;
                real along = from[0];
                if (before != 0)
                    along += before * from[-1];
                if (after != 0)
                    along += after * from[1];
                sum[c] += value * along;
            }
        }
    }
    for (int c = 0; c < 3; c++)
        coarse[pad + c * (size_t)(n_coarse + pad) + u + c_u * (v + c_v * w)] = sum[c];
}

// fine += P coarse; `below` is the last coarse node at or before each fine one of a direction, `above` the share of the
// next; launched over the fine nodes (w, v, u).
__kernel void prolong(__global const real *coarse, int c_u, int c_v, int n_coarse, int pad, __global const int *below,
                      __global const real *above, __global const real *free, int n_u, int n_v, int n, int fine_pad,
                      __global real *fine)
{
    int u = get_global_id(0), v = get_global_id(1), w = get_global_id(2), i = u + n_u * (v + n_v * w);
    if (u >= n_u)
        return;
    size_t pitch = n_coarse + pad;
    real share = above[u], sum[3] = {0, 0, 0};
    for (int q = 0; q < 4; q++) {
        int dv = q & 1, dw = q >> 1;
        real of_v = above[n_u + v], of_w = above[n_u + n_v + w], value = (dv ? of_v : 1 - of_v) * (dw ? of_w : 1 - of_w);
        if (value == 0)
            continue;
        int at = below[u] + c_u * (below[n_u + v] + dv + c_v * (below[n_u + n_v + w] + dw));
        for (int c = 0; c < 3; c++) {
            __global const real *from = coarse + pad + c * pitch + at;
            sum[c] += value * (from[0] + share * (from[1] - from[0]));
        }
    }
    for (int c = 0; c < 3; c++)
        fine[fine_pad + c * (size_t)(n + fine_pad) + i] += free[(size_t)c * n + i] * sum[c];
}
