// Tensor-product B-spline evaluation (eqs 3.1 and 3.2 of the paper).
//
// Sums factorise: a grid is evaluated one axis at a time, each pass contracting one axis of the control array with that
// axis' basis. Arrays are component planes, u fastest. Of a node's cost only the last pass counts: it writes every node
// once and reads degree + 1 control planes that stay in cache.

#define MAX_DEGREE 5

// The sum over the degree + 1 functions of a span, written out for each degree: weights stay in registers then.
#define WEIGHT(a) (a <= degree ? values[(size_t)min(a, degree) * n_out] : 0)
#define SUM_1(w, term) (w##0 * term(0) + w##1 * term(1))
#define SUM_2(w, term) (SUM_1(w, term) + w##2 * term(2))
#define SUM_3(w, term) (SUM_2(w, term) + w##3 * term(3))
#define SUM_4(w, term) (SUM_3(w, term) + w##4 * term(4))
#define SUM_5(w, term) (SUM_4(w, term) + w##5 * term(5))

// Calls what is defined for each degree by its number.
#define FOR_DEGREE(call) \
    switch (degree) {    \
    case 1: call(1) break; \
    case 2: call(2) break; \
    case 3: call(3) break; \
    case 4: call(4) break; \
    case 5: call(5) break; \
    }

// u axis: source (n_rows, n_control) -> target (n_rows, n_out); launched over (n_rows / block, n_out), each work item
// taking `block` rows, which share their weights.
__kernel void contract_rows(__global const real *source, int n_rows, int block, int n_control,
                            __global const int *span, __global const real *values, int degree, int n_out,
                            __global real *target)
{
    int i = get_global_id(0);
    if (i >= n_out)
        return;
    size_t row = get_global_id(1) * block, end = min(row + block, (size_t)n_rows);
    source += row * n_control + span[i] - degree;
    target += row * n_out + i;
    values += i;
    real w0 = WEIGHT(0), w1 = WEIGHT(1), w2 = WEIGHT(2), w3 = WEIGHT(3), w4 = WEIGHT(4), w5 = WEIGHT(5);
#define CONTROL(a) source[a]
#define ROWS(p)                                                         \
    for (; row < end; row++, source += n_control, target += n_out) \
        *target = SUM_##p(w, CONTROL);
    FOR_DEGREE(ROWS)
}

// v or w axis: source (outer, n_control, inner) -> target (outer, n_out, inner); launched over
// (outer, n_out / block, inner), each work item taking its part of `block` planes, whose sources it finds in its cache.
__kernel __attribute__((vec_type_hint(realv)))
void contract(__global const real *source, int n_control, int inner, __global const int *span,
              __global const real *values, int degree, int n_out, int block, __global real *target)
{
    size_t outer = get_global_id(2);
    int first = get_global_id(1) * block, end = min(first + block, n_out);
    values += first;
    bool large = get_global_size(2) * n_out * inner * sizeof(real) > LARGE;
    for (int out = first; out < end; out++, values++) {
        __global const real *from = source + (outer * n_control + span[out] - degree) * inner;
        __global real *to = target + (outer * n_out + out) * inner;
        real w0 = WEIGHT(0), w1 = WEIGHT(1), w2 = WEIGHT(2), w3 = WEIGHT(3), w4 = WEIGHT(4), w5 = WEIGHT(5);
#define PLANE(a) load(from, i + (size_t)a * inner)
#define CACHED(p) FOR_LANES(i, inner) store(SUM_##p(w, PLANE), to, i, inner - i);
#define STREAMED(p) FOR_LANES(i, inner) stream(SUM_##p(w, PLANE), to, i, inner - i);
        if (large)
            FOR_DEGREE(STREAMED)
        else
            FOR_DEGREE(CACHED)
    }
}

// Calls what is defined for each lane by its number.
#if LANES == 8
#define FOR_EACH_LANE(call) call(0) call(1) call(2) call(3) call(4) call(5) call(6) call(7)

// LANES vectors a0, a1, ... transposed to vectors d0, d1, ...: pairs of lanes, then pairs of pairs, then halves.
#define LOW_1(a, b) (realv)(a.s0, b.s0, a.s1, b.s1, a.s4, b.s4, a.s5, b.s5)
#define HIGH_1(a, b) (realv)(a.s2, b.s2, a.s3, b.s3, a.s6, b.s6, a.s7, b.s7)
#define LOW_2(a, b) (realv)(a.s01, b.s01, a.s45, b.s45)
#define HIGH_2(a, b) (realv)(a.s23, b.s23, a.s67, b.s67)
#define PAIRS(to, from, i, j) realv to##i = LOW_1(from##i, from##j), to##j = HIGH_1(from##i, from##j);
#define FOURS(to, from, i, j) realv to##i = LOW_2(from##i, from##j), to##j = HIGH_2(from##i, from##j);
#define HALVES(to, from, i, j, low, high) \
    realv to##low = (realv)(from##i.lo, from##j.lo), to##high = (realv)(from##i.hi, from##j.hi);
#define TRANSPOSED(d, a)                                                            \
    PAIRS(b, a, 0, 1) PAIRS(b, a, 2, 3) PAIRS(b, a, 4, 5) PAIRS(b, a, 6, 7)         \
    FOURS(c, b, 0, 2) FOURS(c, b, 1, 3) FOURS(c, b, 4, 6) FOURS(c, b, 5, 7)         \
    HALVES(d, c, 0, 4, 0, 4) HALVES(d, c, 2, 6, 1, 5) HALVES(d, c, 1, 5, 2, 6) HALVES(d, c, 3, 7, 3, 7)
#else
#define FOR_EACH_LANE(call) call(0)
#define TRANSPOSED(d, a) realv d##0 = a##0;
#endif

// u axis of LANES rows at once: their control points are interleaved, so that a span is read without a gather.
inline void contract_lines(int n_control, __global const real *const *from, __global const int *span,
                           __global const real *values, int degree, int n_out, __global real *packed,
                           __global real *const *to)
{
#define ENDS(m)                             \
    __global const real *from##m = from[m]; \
    __global real *to##m = to[m];
    FOR_EACH_LANE(ENDS)
    for (int i = 0; i < n_control; i += LANES) {
#define LOADED(m) realv a##m = load(from##m, i);
#define PACK(m) store_all(d##m, packed, (i + m) * LANES);
        FOR_EACH_LANE(LOADED)
        TRANSPOSED(d, a)
        FOR_EACH_LANE(PACK)
    }
#define PACKED(a) load(packed, start + a * LANES)
#define SUMMED(m, p)                                             \
    realv a##m;                                                  \
    {                                                            \
        int at = min(i + m, n_out - 1), start = (span[at] - degree) * LANES; \
        __global const real *w = values + at;                    \
        real w0 = w[0], w1 = w[n_out], w2 = p > 1 ? w[2 * n_out] : 0, w3 = p > 2 ? w[3 * n_out] : 0; \
        real w4 = p > 3 ? w[4 * n_out] : 0, w5 = p > 4 ? w[5 * n_out] : 0; \
        a##m = SUM_##p(w, PACKED);                                  \
    }
#define UNPACK(m) store_all(d##m, to##m, i);
#define SUMMED_1(m) SUMMED(m, 1)
#define SUMMED_2(m) SUMMED(m, 2)
#define SUMMED_3(m) SUMMED(m, 3)
#define SUMMED_4(m) SUMMED(m, 4)
#define SUMMED_5(m) SUMMED(m, 5)
#define LINES(p)                                             \
    for (int i = 0; i < n_out; i += LANES) {                 \
        FOR_EACH_LANE(SUMMED_##p)                            \
        TRANSPOSED(d, a)                                     \
        FOR_EACH_LANE(UNPACK)                                \
    }
    FOR_DEGREE(LINES)
}

// The sum of degree + 1 rows of `count` numbers by the weights of one parameter.
inline void sum_rows(int degree, __global const real *const *rows, __global const real *values, int n_out, int count,
                     __global real *to, bool large)
{
    real w0 = WEIGHT(0), w1 = WEIGHT(1), w2 = WEIGHT(2), w3 = WEIGHT(3), w4 = WEIGHT(4), w5 = WEIGHT(5);
    __global const real *r0 = rows[0], *r1 = rows[1], *r2 = rows[2], *r3 = rows[3], *r4 = rows[4], *r5 = rows[5];
#define ROW(a) load(r##a, i)
#define KEPT(p)                               \
    for (int i = 0; i < count; i += LANES) \
        store(SUM_##p(w, ROW), to, i, count - i);
#define PAST(p)                                                        \
    {                                                                  \
        int i = 0, aligned = -((size_t)to / sizeof(real)) % LANES;     \
        store(SUM_##p(w, ROW), to, 0, count);                             \
        for (i = aligned; i < count; i += LANES)                       \
            stream(SUM_##p(w, ROW), to, i, count - i);                    \
    }
    if (large)
        FOR_DEGREE(PAST)
    else
        FOR_DEGREE(KEPT)
}

// The same for two parameters of one span: every row is read once for both.
inline void sum_rows_twice(int degree, __global const real *const *rows, __global const real *values, int n_out,
                           int count, __global real *to, size_t step)
{
    real w0 = WEIGHT(0), w1 = WEIGHT(1), w2 = WEIGHT(2), w3 = WEIGHT(3), w4 = WEIGHT(4), w5 = WEIGHT(5);
    values++;
    real x0 = WEIGHT(0), x1 = WEIGHT(1), x2 = WEIGHT(2), x3 = WEIGHT(3), x4 = WEIGHT(4), x5 = WEIGHT(5);
    __global const real *r0 = rows[0], *r1 = rows[1], *r2 = rows[2], *r3 = rows[3], *r4 = rows[4], *r5 = rows[5];
#define BOTH(p)                                                        \
    {                                                                  \
        int i = 0, aligned = -((size_t)to / sizeof(real)) % LANES;     \
        store(SUM_##p(w, ROW), to, 0, count);                          \
        store(SUM_##p(x, ROW), to, step, count);                       \
        for (i = aligned; i < count; i += LANES) {                     \
            stream(SUM_##p(w, ROW), to, i, count - i);                 \
            stream(SUM_##p(x, ROW), to, step + i, count - i);          \
        }                                                              \
    }
    FOR_DEGREE(BOTH)
}

// The degree + 1 rows of a span in a ring of so many places, `size` apart.
inline void find(int span, int degree, __global const real *ring, int places, size_t size, __global const real **rows)
{
    for (int a = 0; a <= MAX_DEGREE; a++)
        rows[a] = ring + (span - degree + min(a, degree)) % places * size;
}

// All axes of a solid on a CPU: control (n_channels, n_w, n_v, n_u) -> target (n_channels, out_w, out_v, out_u).
//
// Launched over (items, 1, out_u); of an item only the first along u works. It makes a band of `band` rows of `part`
// planes. Rows of control points that are contracted along u, and planes that are contracted along v too, wait for the
// next pass in rings, which stay in its core's cache. `scratch` and `vectors` are one memory, `item_size` an item.
ALONE __kernel __attribute__((vec_type_hint(realv)))
void contract_solid(__global const real *control, int n_channels, int n_u, int n_v, int n_w,
                    __global const int *span_u, __global const real *values_u, int degree_u, int out_u,
                    __global const int *span_v, __global const real *values_v, int degree_v, int out_v,
                    __global const int *span_w, __global const real *values_w, int degree_w, int out_w, int band,
                    int part, int item_size, __global real *scratch, __global real *vectors, __global real *target)
{
    if (get_global_id(0) > 0)
        return;
    int item = get_global_id(2), n_bands = (out_v + band - 1) / band;
    int first_j = item % n_bands * band, end_j = min(first_j + band, out_v);
    int first_k = item / n_bands * part, end_k = min(first_k + part, out_w);
    bool large = (size_t)n_channels * out_u * out_v * out_w * sizeof(real) > LARGE;
    int block = max(LANES / n_channels, 1), n_rows = degree_v + block, n_planes = degree_w + 1;
    int row_size = (out_u + LANES - 1) / LANES * LANES, plane_size = band * out_u + LANES;
    __global real *packed = scratch + (size_t)item * item_size;
    __global real *rows = vectors + (size_t)item * item_size + (n_u + LANES) * LANES;
    __global real *planes = rows + n_rows * n_channels * row_size;
    for (int k = first_k, plane = 0; k < end_k; k++) {
        if (k > first_k && span_w[k] < span_w[k - 1]) // parameters that run back: the ring begins anew
            plane = 0;
        for (plane = max(plane, span_w[k] - degree_w); plane <= span_w[k]; plane++) {
            for (int j = first_j, row = 0; j < end_j; j++) {
                if (j > first_j && span_v[j] < span_v[j - 1])
                    row = 0;
                for (row = max(row, span_v[j] - degree_v); row <= span_v[j]; row += block)
                    for (int line = 0; line < block * n_channels; line += LANES) {
                        __global const real *from[LANES];
                        __global real *to[LANES];
                        for (int m = 0; m < LANES; m++) {
                            int own = min(line + m, block * n_channels - 1), c = own % n_channels;
                            int at = row + own / n_channels;
                            from[m] = control + (((size_t)c * n_w + plane) * n_v + min(at, n_v - 1)) * n_u;
                            to[m] = rows + (at % n_rows * n_channels + c) * row_size;
                        }
                        contract_lines(n_u, from, span_u, values_u, degree_u, out_u, packed, to);
                    }
                for (int c = 0; c < n_channels; c++) {
                    __global const real *from[MAX_DEGREE + 1];
                    find(span_v[j], degree_v, rows + c * row_size, n_rows, n_channels * row_size, from);
                    __global real *to = planes + (plane % n_planes * n_channels + c) * plane_size;
                    sum_rows(degree_v, from, values_v + j, out_v, row_size, to + (j - first_j) * out_u, false);
                }
            }
        }
        int twice = large && k + 1 < end_k && span_w[k + 1] == span_w[k];
        for (int c = 0; c < n_channels; c++) {
            __global const real *from[MAX_DEGREE + 1];
            find(span_w[k], degree_w, planes + c * plane_size, n_planes, n_channels * plane_size, from);
            __global real *to = target + (((size_t)c * out_w + k) * out_v + first_j) * out_u;
            int count = (end_j - first_j) * out_u;
            if (twice)
                sum_rows_twice(degree_w, from, values_w + k, out_w, count, to, (size_t)out_v * out_u);
            else
                sum_rows(degree_w, from, values_w + k, out_w, count, to, large);
        }
        k += twice;
    }
}

// Scattered points: control (n_channels, n_w, n_v, n_u) planes, out (n_channels, n) planes.
__kernel void evaluate_points(__global const real *control, int n_channels, int n_u, int n_v, int n_w, int degree_u,
                              int degree_v, int degree_w, __global const int *span_u, __global const int *span_v,
                              __global const int *span_w, __global const real *values_u, __global const real *values_v,
                              __global const real *values_w, int n, __global real *out)
{
    int i = get_global_id(0);
    if (i >= n)
        return;
    size_t channel = get_global_id(1);
    __global const real *plane = control + channel * n_w * n_v * n_u;
    real sum = 0;
    for (int c = 0; c <= degree_w; c++) {
        real sum_v = 0;
        for (int b = 0; b <= degree_v; b++) {
            size_t row = (size_t)(span_w[i] - degree_w + c) * n_v + span_v[i] - degree_v + b;
            __global const real *from = plane + row * n_u + span_u[i] - degree_u;
            real sum_u = 0;
            for (int a = 0; a <= degree_u; a++)
                sum_u += values_u[(size_t)a * n + i] * from[a];
            sum_v += values_v[(size_t)b * n + i] * sum_u;
        }
        sum += values_w[(size_t)c * n + i] * sum_v;
    }
    out[channel * n + i] = sum;
}

// NURBS: divides each of n_channels planes of n values by the weight plane that follows them.
__kernel void divide_by_weight(__global real *planes, int n_channels, int n)
{
    int i = get_global_id(0);
    if (i >= n)
        return;
    real inverse = 1 / planes[(size_t)n_channels * n + i];
    for (int channel = 0; channel < n_channels; channel++)
        planes[(size_t)channel * n + i] *= inverse;
}
