// A solid patch on a GPU: the passes along v and w in one launch, what is between them in registers.

#include "span_sum.h"

// Neighbours along u that a group writes at once, and tiles of them along v, which read the same control points.
#define TILE 32
#define TILE_ROWS 8
typedef JOIN(real, 4) real4_;
typedef JOIN(real, 8) real8_;

// Four numbers, TILE apart.
inline real4_ places(__global const real *p)
{
    return (real4_)(p[0], p[TILE], p[2 * TILE], p[3 * TILE]);
}

// Sums along v of the plane that begins at `from`, at four places.
inline real4_ along_v(__global const real *from, int inner, int degree, real8_ v)
{
    real4_ total = v.s0 * places(from) + v.s1 * places(from + inner);
    if (degree > 1)
        total += v.s2 * places(from + 2 * inner);
    if (degree > 2)
        total += v.s3 * places(from + 3 * inner);
    if (degree > 3)
        total += v.s4 * places(from + 4 * inner);
    if (degree > 4)
        total += v.s5 * places(from + 5 * inner);
    return total;
}

// Goes along w; one copy a degree, so that only the sums of its span are kept and added, the oldest first.
inline void along_w(int degree, __global const real *source, int layer, int inner, int degree_v, real8_ v,
                    __global const int *span, __global const real *values, int n_all, int begin, int end,
                    real origin, __global real *to, int plane, int left)
{
    real4_ r0 = 0, r1 = 0, r2 = 0, r3 = 0, r4 = 0, r5 = 0;
    int newest = -1;
    for (int k = begin; k < end; k++, to += plane) {
        int last = span[k];
        if (last < newest) // parameters that run back: anew
            newest = -1;
        for (newest = max(newest, last - degree - 1); newest < last;) {
            newest++;
            real4_ total = along_v(source + (size_t)newest * layer, inner, degree_v, v);
            r0 = r1;
            r1 = degree == 1 ? total : r2;
            r2 = degree == 2 ? total : r3;
            r3 = degree == 3 ? total : r4;
            r4 = degree == 4 ? total : r5;
            r5 = total;
        }
        real4_ node = values[k] * r0 + values[n_all + k] * r1;
        if (degree > 1)
            node += values[2 * n_all + k] * r2;
        if (degree > 2)
            node += values[3 * n_all + k] * r3;
        if (degree > 3)
            node += values[4 * n_all + k] * r4;
        if (degree > 4)
            node += values[5 * n_all + k] * r5;
        node += origin;
        stream_one(node.s0, to);
        if (left > TILE)
            stream_one(node.s1, to + TILE);
        if (left > 2 * TILE)
            stream_one(node.s2, to + 2 * TILE);
        if (left > 3 * TILE)
            stream_one(node.s3, to + 3 * TILE);
    }
}

// v and w axes on a GPU: source (n_channels, n_w, n_v, inner) -> target (n_channels, out_w, out_v, inner).
//
// Launched over (n_channels * parts, bands * chunks * TILE_ROWS * TILE): a part is `part` planes, a band TILE_ROWS rows, a
// chunk 4 * TILE of `inner`. A work item goes along w at four places of its chunk, TILE apart; chunks begin where the
// memory's blocks do. What lies beyond a row is read and not used, up to 3 * TILE numbers behind the last of `source`. The
// first three channels are places from (x0, y0, z0).
GROUP(TILE * TILE_ROWS) __kernel
void contract_columns(__global const real *restrict source, int n_v, int n_w, int inner,
                      __global const int *restrict span, __global const real *restrict values, int degree_v, int out_v,
                      int degree_w, int out_w, int part, real x0, real y0, real z0, __global real *restrict target)
{
    int n_uv = inner + out_v, n_all = n_uv + out_w; // parameters; those of v are behind those of u, those of w behind them
    int item = get_global_id(0), group = get_global_id(1), n_parts = (out_w + part - 1) / part;
    int n_chunks = (inner + TILE - 1 + 4 * TILE - 1) / (4 * TILE), tile = item / TILE;
    int j = tile / (TILE_ROWS * n_chunks) * TILE_ROWS + tile % TILE_ROWS;
    if (j >= out_v)
        return;
    int channel = group / n_parts, k = group % n_parts * part, end = min(k + part, out_w);
    size_t row = (((size_t)channel * out_w + k) * out_v + j) * inner;
    int i = tile / TILE_ROWS % n_chunks * (4 * TILE) + item % TILE - (int)(row % TILE);
    int count = 4;
    if (i < 0) // before the row: its next three
        i += TILE, count = 3;
    if (i >= inner)
        return;
    source += ((size_t)channel * n_w * n_v + span[inner + j] - degree_v) * inner + i;
    target += row + i;
    int left = min(inner - i, count * TILE);
    real origin = origin_of(channel, x0, y0, z0);
    __global const real *values_v = values + inner + j;
    real8_ v = 0;
    v.s0 = values_v[0], v.s1 = values_v[n_all], v.s2 = degree_v > 1 ? values_v[2 * n_all] : 0;
    v.s3 = degree_v > 2 ? values_v[3 * n_all] : 0, v.s4 = degree_v > 3 ? values_v[4 * n_all] : 0;
    v.s5 = degree_v > 4 ? values_v[5 * n_all] : 0;
    span += n_uv, values += n_uv;
#define ALONG_W(p) \
    along_w(p, source, n_v * inner, inner, degree_v, v, span, values, n_all, k, end, origin, target, out_v * inner, left);
    switch (degree_w) {
    case 1: ALONG_W(1) break;
    case 2: ALONG_W(2) break;
    case 3: ALONG_W(3) break;
    case 4: ALONG_W(4) break;
    case 5: ALONG_W(5) break;
    }
}
