// Vectors of the iterative solvers: sums of multiples, products of vectors, 3 x 3 blocks times a vector.

#define RUN 64 // elements that a part takes together

// y = a x + b y
__kernel __attribute__((vec_type_hint(realv)))
void combine(__global const real *x, real a, real b, int n, __global real *y)
{
    FOR_LANES(i, n) store(a * load(x, i) + b * load(y, i), y, i, n - i);
}

// Sums (parts) of x times y (n) over every parts-th run of elements: the same in any order of work.
__kernel void product(__global const real *x, __global const real *y, int n, int parts, __global real *out)
{
    int part = get_global_id(0);
    if (part >= parts)
        return;
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
    out[part] = sum;
}

// out = B x for symmetric 3 x 3 blocks (6, n): xx, yy, zz, yz, xz, xy; x and out are (3, n).
__kernel __attribute__((vec_type_hint(realv)))
void blocks_times(__global const real *blocks, __global const real *x, int n, __global real *out)
{
    size_t second = n, third = 2 * second, fourth = 3 * second, fifth = 4 * second, sixth = 5 * second;
    FOR_LANES(i, n) {
        realv a = load(x, i), b = load(x, second + i), c = load(x, third + i);
        realv yz = load(blocks, fourth + i), xz = load(blocks, fifth + i), xy = load(blocks, sixth + i);
        store(load(blocks, i) * a + xy * b + xz * c, out, i, n - i);
        store(xy * a + load(blocks, second + i) * b + yz * c, out, second + i, n - i);
        store(xz * a + yz * b + load(blocks, third + i) * c, out, third + i, n - i);
    }
}
