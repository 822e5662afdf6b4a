// Matrices of structured grids: each node's 3 x 3 blocks with itself and its 26 neighbours, for the multigrid.
//
// Entry q = 9 o + 3 row + column of node i, o = (du + 1) + 3 (dv + 1) + 9 (dw + 1), lies at ((i / 8) 243 + q) 8 + i % 8:
// eight nodes together, read as one stream. Vectors are three planes, x, y, z, each with `pad` zeros before and after,
// which planes share, so that the neighbours of nodes at the ends are in reach: their entries are 0.

#define ENTRIES 243
#define TILE(i) (((size_t)(i) >> 3) * ENTRIES * 8 + ((i) & 7))

// Adds what the elements give their nodes (3, 8, m) for a displacement of 1 along `column` of the nodes of one parity in
// u, v, w (bits 1, 2, 4), of which each element has one.
__kernel void add_forces(__global const real *forces, int n_u, int n_v, int n_w, int parity, int column,
                         __global const real *free, __global real *stencil)
{
    int n = n_u * n_v * n_w, i = get_global_id(0), m = (n_u - 1) * (n_v - 1) * (n_w - 1);
    if (i >= n)
        return;
    int u = i % n_u, v = i / n_u % n_v, w = i / n_u / n_v;
    for (int corner = 0; corner < 8; corner++) {
        int eu = u - (corner & 1), ev = v - (corner >> 1 & 1), ew = w - (corner >> 2);
        if (eu < 0 || ev < 0 || ew < 0 || eu >= n_u - 1 || ev >= n_v - 1 || ew >= n_w - 1)
            continue;
        int du = eu + ((eu ^ parity) & 1) - u, dv = ev + ((ev ^ parity >> 1) & 1) - v, dw = ew + ((ew ^ parity >> 2) & 1) - w;
        int other = i + du + n_u * (dv + n_v * dw), o = (du + 1) + 3 * (dv + 1) + 9 * (dw + 1);
        int vertex = (corner & 4) + ((corner & 2) ? 3 - (corner & 1) : (corner & 1));
        for (int row = 0; row < 3; row++) {
            size_t at = (size_t)(8 * row + vertex) * m + (ew * (n_v - 1) + ev) * (n_u - 1) + eu;
            real both = free[(size_t)row * n + i] * free[(size_t)column * n + other];
            stencil[TILE(i) + 8 * (9 * o + 3 * row + column)] += both * forces[at];
        }
    }
}

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

// A step of Richardson's iteration: out = keep x + step B (b - S x), B the inverse (6, n) of the nodes' own blocks. Where
// `still` is 1, x is 0.
__kernel __attribute__((vec_type_hint(realv)))
void smooth(__global const real *stencil, __global const real *inverse, __global const real *b, __global const real *x,
            int still, real keep, real step, int n_u, int n_v, int n, int pad, __global real *out)
{
    size_t pitch = n + pad;
    FOR_LANES(i, n) {
        realv y[3] = {0, 0, 0}, z[3];
        if (!still)
            product(i, stencil, x + pad, n_u, n_v, pitch, y);
        for (int c = 0; c < 3; c++)
            y[c] = load(b, pad + c * pitch + i) - y[c];
        realv yz = load(inverse, 3 * (size_t)n + i), xz = load(inverse, 4 * (size_t)n + i);
        realv xy = load(inverse, 5 * (size_t)n + i);
        z[0] = load(inverse, i) * y[0] + xy * y[1] + xz * y[2];
        z[1] = xy * y[0] + load(inverse, n + i) * y[1] + yz * y[2];
        z[2] = xz * y[0] + yz * y[1] + load(inverse, 2 * (size_t)n + i) * y[2];
        for (int c = 0; c < 3; c++) {
            size_t at = pad + c * pitch + i;
            store(still ? step * z[c] : keep * load(x, at) + step * z[c], out, at, n - i);
        }
    }
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

// coarse = P^T fine; launched over (3, coarse nodes).
__kernel void restrict_vector(__global const real *fine, int n_u, int n_v, int n, int fine_pad, int c_u, int c_v,
                              int n_coarse, int pad, __global const int *centre, __global const real *side,
                              __global const real *free, __global real *coarse)
{
    int I = get_global_id(0), c = get_global_id(1);
    if (I >= n_coarse)
        return;
    int u = I % c_u, v = c_u + I / c_u % c_v, w = c_u + c_v + I / c_u / c_v;
    real sum = 0;
    for (int q = 0; q < 27; q++) {
        int fu = centre[u] + q % 3 - 1, fv = centre[v] + q / 3 % 3 - 1, fw = centre[w] + q / 9 - 1;
        real value = weight(u, centre, side, fu) * weight(v, centre, side, fv) * weight(w, centre, side, fw);
        if (value != 0) {
            int i = fu + n_u * (fv + n_v * fw);
            sum += value * free[(size_t)c * n + i] * fine[fine_pad + c * (size_t)(n + fine_pad) + i];
        }
    }
    coarse[pad + c * (size_t)(n_coarse + pad) + I] = sum;
}

// fine += P coarse; `below` is the last coarse node at or before each fine one of a direction, `above` the share of the
// next; launched over (3, n).
__kernel void prolong(__global const real *coarse, int c_u, int c_v, int n_coarse, int pad, __global const int *below,
                      __global const real *above, __global const real *free, int n_u, int n_v, int n, int fine_pad,
                      __global real *fine)
{
    int i = get_global_id(0), c = get_global_id(1);
    if (i >= n)
        return;
    int u = i % n_u, v = n_u + i / n_u % n_v, w = n_u + n_v + i / n_u / n_v;
    real sum = 0;
    coarse += pad + c * (size_t)(n_coarse + pad);
    for (int q = 0; q < 8; q++) {
        int du = q & 1, dv = q >> 1 & 1, dw = q >> 2;
        real value = (du ? above[u] : 1 - above[u]) * (dv ? above[v] : 1 - above[v]) * (dw ? above[w] : 1 - above[w]);
        if (value != 0)
            sum += value * coarse[below[u] + du + c_u * (below[v] + dv + c_v * (below[w] + dw))];
    }
    fine[fine_pad + c * (size_t)(n + fine_pad) + i] += free[(size_t)c * n + i] * sum;
}
