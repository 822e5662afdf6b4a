// WIDE
// Tensor-product B-spline evaluation (eqs 3.1 and 3.2 of the paper).
//
// Sums factorise: a grid is evaluated one axis at a time, each pass contracting one axis of the control array with that
// axis' basis. Arrays are component planes, u fastest. Of a node's cost only the last pass counts: it writes every node
// once and reads degree + 1 control planes that stay in cache. The three passes of a solid are one launch on a CPU,
// `bands`; its last two are one on a GPU, `columns`.

#include "span_sum.h"

// u axis: source (n_rows, n_control) -> target (n_rows, n_out), of n_all parameters of all directions; launched over
// (n_rows / block, n_out), each work item taking `block` rows, which share their weights.
__kernel void contract_rows(__global const real *source, int n_rows, int block, int n_control,
                            __global const int *span, __global const real *values, int n_all, int degree, int n_out,
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

// v axis of a surface: source (outer, n_control, inner) -> target (outer, n_out, inner); launched over
// (outer, n_out / block, inner), each work item taking its part of `block` planes, whose sources it finds in its cache.
// The first three of outer are places from (x0, y0, z0).
__kernel __attribute__((vec_type_hint(realv)))
void contract(__global const real *source, int n_control, int inner, __global const int *span,
              __global const real *values, int degree, int n_out, int block, real x0, real y0, real z0,
              __global real *target)
{
    size_t outer = get_global_id(2);
    real origin = origin_of(outer, x0, y0, z0);
    int first = get_global_id(1) * block, end = min(first + block, n_out);
    int n_all = inner + n_out;
    span += inner, values += inner + first; // behind what is of u
    bool large = get_global_size(2) * n_out * inner * sizeof(real) > LARGE;
    for (int out = first; out < end; out++, values++) {
        __global const real *from = source + (outer * n_control + span[out] - degree) * inner;
        __global real *to = target + (outer * n_out + out) * inner;
        real w0 = WEIGHT(0), w1 = WEIGHT(1), w2 = WEIGHT(2), w3 = WEIGHT(3), w4 = WEIGHT(4), w5 = WEIGHT(5);
#define PLANE(a) load(from, i + (size_t)a * inner)
#define CACHED(p) FOR_LANES(i, inner) store(SUM_##p(w, PLANE) + origin, to, i, inner - i);
#define STREAMED(p) FOR_LANES(i, inner) stream(SUM_##p(w, PLANE) + origin, to, i, inner - i);
        if (large)
            FOR_DEGREE(STREAMED)
        else
            FOR_DEGREE(CACHED)
    }
}

// Scattered points: control (n_channels, n_w, n_v, n_u) planes, whose first three are places from (x0, y0, z0), out
// (n_channels, n) planes.
__kernel void evaluate_points(__global const real *control, int n_channels, int n_u, int n_v, int n_w, int degree_u,
                              int degree_v, int degree_w, __global const int *span, __global const real *values, int n,
                              real x0, real y0, real z0, __global real *out)
{
    int i = get_global_id(0);
    if (i >= n)
        return;
    size_t channel = get_global_id(1);
    span += i, values += i;
    control += ((channel * n_w + span[2 * n] - degree_w) * n_v + span[n] - degree_v) * n_u + span[0] - degree_u;
    real sum = 0;
    for (int c = 0; c <= degree_w; c++) {
        real sum_v = 0;
        for (int b = 0; b <= degree_v; b++) {
            __global const real *from = control + ((size_t)c * n_v + b) * n_u;
            real sum_u = 0;
            for (int a = 0; a <= degree_u; a++)
                sum_u += values[(size_t)3 * a * n] * from[a];
            sum_v += values[(size_t)(3 * b + 1) * n] * sum_u;
        }
        sum += values[(size_t)(3 * c + 2) * n] * sum_v;
    }
    out[channel * n + i] = sum + origin_of(channel, x0, y0, z0);
}

// NURBS: divides each of n_channels planes of n values, the first three places from (x0, y0, z0), by the weight plane that
// follows them.
__kernel void divide_by_weight(__global real *planes, int n_channels, int n, real x0, real y0, real z0)
{
    int i = get_global_id(0);
    if (i >= n)
        return;
    real inverse = 1 / planes[(size_t)n_channels * n + i];
    for (int channel = 0; channel < n_channels; channel++) {
        __global real *value = planes + (size_t)channel * n + i;
        *value = *value * inverse + origin_of(channel, x0, y0, z0);
    }
}
