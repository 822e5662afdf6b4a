// WIDE
// A solid patch on a CPU: all passes in one launch, band by band, what is between them in a core's cache.

#include "span_sum.h"

#if LANES > 1 // as on every CPU

// Numbers of a plane that stay in a core's first cache while some spans are made of them.
#define CHUNK 768

// Rows of control points that are contracted together and share weights, and the places of a ring of such rows, which
// holds those of a span too.
#define BLOCK 8
#define N_ROWS 16
#define MOST_PLANES 16 // of the ring behind it

// u axis of `count` rows of a plane, at most BLOCK, to their places in a ring. The spans of LANES parameters lie in one
// vector of control points where `near` says so, else in as many as it takes. `next` are the rows that the next call wants.
inline void contract_lines(int count, __global const real *from, __global const real *next, int n_u,
                           __global const int *span, __global const real *values, int n_all, int degree, int n_out, bool near,
                           __global real *const *to)
{
    for (int i = 0; i < n_out; i += LANES) {
        if (i < n_u)
            fetch(next, i * BLOCK, LANES * BLOCK);
        maskv given = to_maskv(LANE_NUMBERS < n_out - i);
        intv first = load_int(span, i) - degree;
        uint wait = (1 << min(LANES, n_out - i)) - 1; // lanes
        for (bool again = false; wait; again = true) {
            int start = span[i + ctz(wait)] - degree;
            intv at = first - start;
            maskv inside = to_maskv(at >= 0 && at < LANES - degree);
#define PICKED(a) pick(window, at + a)
#define WEIGHTS(a, p) (a <= p ? select((realv)0, load(values, (size_t)a * n_all + i), given) : 0)
#define LINES(p)                                                                      \
    realv w0 = WEIGHTS(0, p), w1 = WEIGHTS(1, p), w2 = WEIGHTS(2, p);                 \
    realv w3 = WEIGHTS(3, p), w4 = WEIGHTS(4, p), w5 = WEIGHTS(5, p);                 \
    for (int r = 0; r < count; r++) {                                                 \
        realv window = load(from, r * n_u + start), sum = SUM_##p(w, PICKED);         \
        store_all(again ? select(load(to[r], i), sum, inside) : sum, to[r], i);       \
    }
            FOR_DEGREE(LINES)
            if (near)
                break;
            for (int lane = 0; lane < LANES; lane++) {
                int place = span[i + lane] - degree - start;
                if (place >= 0 && place < LANES - degree)
                    wait &= ~(1 << lane);
            }
        }
    }
}

// Whether the spans of each LANES parameters lie in one vector that begins with the first.
inline bool spans_are_near(__global const int *span, int degree, int n_out)
{
    bool near = true;
    for (int i = 0; i < n_out; i++) {
        int place = span[i] - span[i / LANES * LANES];
        near = near && place >= 0 && place < LANES - degree;
    }
    return near;
}

// The sum of degree + 1 rows of `count` numbers, from `at` on in each, by the weights of one parameter, and an origin.
inline void sum_rows(int degree, __global real *const *rows, size_t at, __global const real *values, int n_all,
                     int count, real origin, __global real *to, bool large)
{
    real w0 = WEIGHT(0), w1 = WEIGHT(1), w2 = WEIGHT(2), w3 = WEIGHT(3), w4 = WEIGHT(4), w5 = WEIGHT(5);
    __global const real *r0 = rows[0] + at, *r1 = rows[1] + at, *r2 = rows[2] + at;
    __global const real *r3 = rows[3] + at, *r4 = rows[4] + at, *r5 = rows[5] + at;
    int i = 0;
#define ROW(a) load(r##a, i)
#define KEPT(p)                               \
    for (; i + LANES <= count; i += LANES)    \
        store_all(SUM_##p(w, ROW) + origin, to, i);
#define PAST(p)                               \
    store(SUM_##p(w, ROW) + origin, to, i, count); \
    i = -((size_t)to / sizeof(real)) % LANES;      \
    for (; i + LANES <= count; i += LANES)         \
        stream_all(SUM_##p(w, ROW) + origin, to, i);
#define REST(p) store(SUM_##p(w, ROW) + origin, to, i, count - i);
    if (large)
        FOR_DEGREE(PAST)
    else
        FOR_DEGREE(KEPT)
    if (i < count)
        FOR_DEGREE(REST)
}

// Where `places` rows or planes of a ring lie, `size` apart, and those of a block or span that begins at the last of them.
inline void lay_ring(int places, size_t size, __global real *ring, __global real **at)
{
    for (int a = 0; a < places + BLOCK; a++)
        at[a] = ring + a % places * size;
}

#endif

// All axes of a solid on a CPU: control (n_channels, n_w, n_v, n_u) -> target (n_channels, out_w, out_v, out_u).
//
// Launched over (items, 1, out_u); of an item only the first along u works. It makes a band of `band` rows of `part`
// planes of one channel. Rows of control points that are contracted along u, and planes that are contracted along v too,
// wait for the next pass in rings, which stay in its core's cache. The ring of `n_planes` holds a few beside those of a
// span: what the first cache has taken of them then makes all parameters of some spans. `scratch` and `vectors` are one
// memory, `item_size` an item. The first three channels are places from (x0, y0, z0).
ALONE __kernel __attribute__((vec_type_hint(realv)))
void contract_solid(__global const real *control, int n_channels, int n_u, int n_v, int n_w,
                    __global const int *span, __global const real *values, int degree_u, int out_u, int degree_v,
                    int out_v, int degree_w, int out_w, int band, int part, int n_planes, int item_size,
                    real x0, real y0, real z0, __global real *scratch, __global real *vectors, __global real *target)
{
#if LANES > 1
    if (get_global_id(0) > 0)
        return;
    int item = get_global_id(2), n_bands = (out_v + band - 1) / band, n_parts = (out_w + part - 1) / part;
    int first_j = item % n_bands * band, end_j = min(first_j + band, out_v);
    int first_k = item / n_bands % n_parts * part, end_k = min(first_k + part, out_w);
    size_t channel = item / (n_bands * n_parts);
    real origin = origin_of(channel, x0, y0, z0), none = -0.0; // adding it leaves every number as it is
    int n_all = out_u + out_v + out_w;
    __global const int *span_v = span + out_u, *span_w = span_v + out_v;
    __global const real *values_v = values + out_u, *values_w = values_v + out_v;
    control += channel * n_w * n_v * n_u;
    target += (channel * out_w * out_v + first_j) * out_u;
    bool large = (size_t)n_channels * out_u * out_v * out_w * sizeof(real) > LARGE;
    int count = (end_j - first_j) * out_u;
    int row_size = (out_u + LANES - 1) / LANES * LANES, plane_size = (band * out_u + 2 * LANES - 1) / LANES * LANES;
    __global real *rows = vectors + (size_t)item * item_size;
    __global real *planes = rows + N_ROWS * row_size;
    __global real *in_rows[N_ROWS + BLOCK], *in_planes[MOST_PLANES + BLOCK];
    lay_ring(N_ROWS, row_size, rows, in_rows);
    lay_ring(n_planes, plane_size, planes, in_planes);
    int first_row = n_v, end_row = 0; // of control points that the band needs
    for (int j = first_j; j < end_j; j++) {
        first_row = min(first_row, span_v[j] - degree_v);
        end_row = max(end_row, span_v[j] + 1);
    }
    bool near = spans_are_near(span, degree_u, out_u);
    for (int k = first_k, end, plane = 0; k < end_k; k = end) {
        if (k > first_k && span_w[k] < span_w[k - 1]) // parameters that run back: the ring begins anew
            plane = 0;
        int first = span_w[k] - degree_w;
        for (end = k + 1; end < end_k && span_w[end] >= span_w[end - 1] && span_w[end] < first + n_planes;)
            end++;
        for (plane = max(plane, first); plane <= span_w[end - 1]; plane++) {
            for (int j = first_j, row = 0; j < end_j; j++) {
                if (j > first_j && span_v[j] < span_v[j - 1])
                    row = 0;
                for (row = max(row, span_v[j] - degree_v); row <= span_v[j]; row += BLOCK) {
                    size_t at = (size_t)plane * n_v + row;
                    size_t next = row + BLOCK < end_row ? at + BLOCK : (size_t)(plane + 1) * n_v + first_row;
                    contract_lines(min(BLOCK, end_row - row), control + at * n_u, control + next * n_u, n_u, span, values,
                                   n_all, degree_u, out_u, near, in_rows + (uint)row % N_ROWS);
                }
                __global real *const *from = in_rows + (uint)(span_v[j] - degree_v) % N_ROWS;
                __global real *to = in_planes[plane % n_planes] + (j - first_j) * out_u;
                sum_rows(degree_v, from, 0, values_v + j, n_all, row_size, none, to, false);
            }
        }
        for (int done = 0; done < count; done += CHUNK) {
            for (int at = k; at < end; at++) {
                __global real *const *from = in_planes + (span_w[at] - degree_w) % n_planes;
                __global real *to = target + (size_t)at * out_v * out_u + done;
                sum_rows(degree_w, from, done, values_w + at, n_all, min(count - done, CHUNK), origin, to, large);
            }
        }
    }
#endif
}
