// A solid patch on a GPU: the passes along v and w in one launch, what is between them in registers.

#define MAX_DEGREE 5

// Neighbours along u that a group writes at once, and tiles of them along v, which read the same control points.
#define TILE 32
#define TILE_ROWS 8
typedef JOIN(real, 4) real4_;

inline real4_ places(__global const real *p, int o1, int o2, int o3)
{
    return (real4_)(p[0], p[o1], p[o2], p[o3]);
}

// v and w axes on a GPU: source (n_channels, n_w, n_v, inner) -> target (n_channels, out_w, out_v, inner).
//
// Launched over (n_channels * parts, bands * chunks * TILE_ROWS * TILE): a part is `part` planes, a band TILE_ROWS rows, a
// chunk 4 * TILE of `inner`. A work item goes along w at four places of its chunk, TILE apart; chunks begin where the
// memory's blocks do. Sums along v stay in registers, the oldest first, 0 beyond those of a span.
__kernel void contract_columns(__global const real *source, int n_v, int n_w, int inner, __global const int *span_v,
                               __global const real *values_v, int degree_v, int out_v, __global const int *span_w,
                               __global const real *values_w, int degree_w, int out_w, int part,
                               __global real *target)
{
    int item = get_global_id(0), group = get_global_id(1), n_parts = (out_w + part - 1) / part;
    int n_chunks = (inner + TILE - 1 + 4 * TILE - 1) / (4 * TILE), tile = item / TILE;
    int j = tile / (TILE_ROWS * n_chunks) * TILE_ROWS + tile % TILE_ROWS;
    if (j >= out_v)
        return;
    int channel = group / n_parts, k = group % n_parts * part, end = min(k + part, out_w);
    size_t row = (((size_t)channel * out_w + k) * out_v + j) * inner;
    int begin = tile / TILE_ROWS % n_chunks * (4 * TILE) + item % TILE - (int)(row % TILE);
    if (begin >= inner)
        return;
    int i = max(begin, 0), o1 = clamp(begin + TILE, 0, inner - 1) - i;
    int o2 = clamp(begin + 2 * TILE, 0, inner - 1) - i, o3 = clamp(begin + 3 * TILE, 0, inner - 1) - i;
    source += ((size_t)channel * n_w * n_v + span_v[j] - degree_v) * inner + i;
    target += row + i;
    real v[MAX_DEGREE + 1];
    for (int b = 0; b <= MAX_DEGREE; b++)
        v[b] = b <= degree_v ? values_v[min(b, degree_v) * out_v + j] : 0;
    real4_ none = 0, r0 = none, r1 = none, r2 = none, r3 = none, r4 = none, r5 = none;
    int newest = -1;
    for (; k < end; k++, target += (size_t)out_v * inner) {
        int last = span_w[k];
        if (last < newest) // parameters that run back: anew
            newest = -1;
        for (newest = max(newest, last - degree_w - 1); newest < last;) {
            newest++;
            __global const real *row = source + (size_t)newest * n_v * inner;
            real4_ total = v[0] * places(row, o1, o2, o3);
            for (int b = 1; b <= degree_v; b++)
                total += v[b] * places(row + (size_t)b * inner, o1, o2, o3);
            r0 = r1;
            r1 = degree_w == 1 ? total : r2;
            r2 = degree_w == 2 ? total : r3;
            r3 = degree_w == 3 ? total : r4;
            r4 = degree_w == 4 ? total : r5;
            r5 = degree_w == 5 ? total : none;
        }
        __global const real *w = values_w + k;
        real4_ node = w[0] * r0 + w[out_w] * r1 + w[min(degree_w, 2) * out_w] * r2 + w[min(degree_w, 3) * out_w] * r3 +
                      w[min(degree_w, 4) * out_w] * r4 + w[min(degree_w, 5) * out_w] * r5;
        target[0] = node.s0, target[o1] = node.s1, target[o2] = node.s2, target[o3] = node.s3;
    }
}
