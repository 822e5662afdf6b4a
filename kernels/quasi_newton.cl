// Limited-memory BFGS whose two loops run on the products of its vectors: the rows of a basis (rows, n).
// Source: Chen, Wang and Zhou 2014, "Large-scale L-BFGS using MapReduce".

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
