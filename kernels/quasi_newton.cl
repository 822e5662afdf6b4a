// Limited-memory BFGS whose two loops run on the products of its vectors: the rows of a basis (rows, n).
// Source: Chen, Wang and Zhou 2014, "Large-scale L-BFGS using MapReduce".

// Takes in a step from x to x_new and the gradients g and g_new there: row `slot` of the basis becomes the step over `scale`
// (n), that `memory` further on the change of the gradient times `scale`, and row 2 `memory`, the last, g_new times `scale`.
__kernel __attribute__((vec_type_hint(realv)))
void remember(__global const real *x, __global const real *x_new, __global const real *g, __global const real *g_new,
              __global const real *scale, int slot, int memory, int n, __global real *basis)
{
    __global real *step = basis + (size_t)slot * n, *change = step + (size_t)memory * n;
    __global real *last = basis + 2 * (size_t)memory * n;
    FOR_LANES(i, n) {
        realv s = load(scale, i), after = load(g_new, i);
        store((load(x_new, i) - load(x, i)) / s, step, i, n - i);
        store((after - load(g, i)) * s, change, i, n - i);
        store(after * s, last, i, n - i);
    }
}

// Sums (3, 2 memory + 1, parts) of these three rows times every row, each part over a run of elements of its own. Work items
// beside each other share a run of the three, which stays in the cache.
__kernel void row_products(__global const real *basis, int slot, int memory, int n, int parts, __global real *out)
{
    int rows = 2 * memory + 1, item = get_global_id(0), row = item % rows, part = item / rows;
    if (part >= parts)
        return;
    __global const real *y = basis + (size_t)row * n, *a = basis + (size_t)slot * n, *b = a + (size_t)memory * n;
    __global const real *c = basis + 2 * (size_t)memory * n;
    int run = (n + parts - 1) / parts, begin = min(part * run, n), end = min(begin + run, n), i = begin;
    realv run_a = 0, run_b = 0, run_c = 0;
    for (; i + LANES <= end; i += LANES) {
        realv value = load(y, i);
        run_a += load(a, i) * value;
        run_b += load(b, i) * value;
        run_c += load(c, i) * value;
    }
    union { realv v; real lane[LANES]; } of_a = {run_a}, of_b = {run_b}, of_c = {run_c};
    real sum_a = 0, sum_b = 0, sum_c = 0;
    for (int lane = 0; lane < LANES; lane++) {
        sum_a += of_a.lane[lane];
        sum_b += of_b.lane[lane];
        sum_c += of_c.lane[lane];
    }
    for (; i < end; i++) {
        sum_a += a[i] * y[i];
        sum_b += b[i] * y[i];
        sum_c += c[i] * y[i];
    }
    size_t at = (size_t)row * parts + part, plane = (size_t)rows * parts;
    out[at] = sum_a;
    out[plane + at] = sum_b;
    out[2 * plane + at] = sum_c;
}

// out = `scale` (n) times the rows times their coefficients.
__kernel __attribute__((vec_type_hint(realv)))
void combine_rows(__global const real *basis, __global const real *coefficients, int rows, __global const real *scale,
                  int n, __global real *out)
{
    FOR_LANES(i, n) {
        realv sum = 0;
        for (int row = 0; row < rows; row++)
            sum += coefficients[row] * load(basis, (size_t)row * n + i);
        store(load(scale, i) * sum, out, i, n - i);
    }
}
