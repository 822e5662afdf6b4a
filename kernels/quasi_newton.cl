// Limited-memory BFGS whose two loops run on the products of its vectors: the rows of a basis (rows, n).
// Source: Chen, Wang and Zhou 2014, "Large-scale L-BFGS using MapReduce".

#define RUN 64 // elements that a part takes together

// The row `row` of the basis becomes x - y, times `scale` (n) or, where `inverse` is 1, over it.
__kernel __attribute__((vec_type_hint(realv)))
void set_difference(__global const real *x, __global const real *y, __global const real *scale, int inverse, int n, int row,
                    __global real *basis)
{
    basis += (size_t)row * n;
    FOR_LANES(i, n) {
        realv change = load(x, i) - load(y, i), s = load(scale, i);
        store(inverse ? change / s : change * s, basis, i, n - i);
    }
}

// Sums (rows, parts) of every row times the row `by` over every parts-th run of elements: the same in any order of work.
__kernel void row_products(__global const real *basis, int rows, int by, int n, int parts,
                           __global real *out)
{
    int part = get_global_id(0), row = get_global_id(1);
    if (part >= parts)
        return;
    __global const real *x = basis + (size_t)by * n, *y = basis + (size_t)row * n;
    real sum = 0;
    for (size_t begin = (size_t)part * RUN; begin < n; begin += (size_t)parts * RUN) {
        realv run = 0;
        int end = min((int)(n - begin), RUN), i = 0;
        for (; i + LANES <= end; i += LANES)
            run += load(x, begin + i) * load(y, begin + i);
        union { realv v; real lane[LANES]; } sums = {run};
        for (int lane = 0; lane < LANES; lane++)
            sum += sums.lane[lane];
        for (; i < end; i++)
            sum += x[begin + i] * y[begin + i];
    }
    out[(size_t)row * parts + part] = sum;
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
