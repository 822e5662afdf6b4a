// What nodes have of what elements gave: sums in a fixed order, and the inverse of their own 3 x 3 stiffness.

// Sum over the elements of each node: values (components, k m) at the slots a m + e, `start` (n + 1) where the slots of a
// node begin. What is not free (1 or 0 in `free`, components x n) gets 0.
__kernel void gather(__global const real *values, int components, int count, __global const int *start,
                     __global const int *slots, __global const real *free, int n, __global real *out)
{
    int i = get_global_id(0);
    if (i >= n)
        return;
    int begin = start[i], end = start[i + 1];
    for (int c = 0; c < components; c++) {
        real sum = 0;
        for (int s = begin; s < end; s++)
            sum += values[(size_t)c * count + slots[s]];
        out[(size_t)c * n + i] = sum * free[(size_t)c * n + i];
    }
}

// Inverse (6, n) of symmetric 3 x 3 blocks (6, n): xx, yy, zz, yz, xz, xy. Rows and columns that are not free become 0.
__kernel void invert_blocks(__global const real *blocks, __global const real *free, int n, __global real *out)
{
    int i = get_global_id(0);
    if (i >= n)
        return;
    real f = free[i], g = free[n + i], h = free[2 * (size_t)n + i];
    real a = f > 0 ? blocks[i] : 1, b = g > 0 ? blocks[n + i] : 1, c = h > 0 ? blocks[2 * (size_t)n + i] : 1;
    real d = g * h * blocks[3 * (size_t)n + i], e = f * h * blocks[4 * (size_t)n + i];
    real o = f * g * blocks[5 * (size_t)n + i];
    real p = b * c - d * d, q = d * e - o * c, r = o * d - b * e;
    real inverse = 1 / (a * p + o * q + e * r);
    out[i] = f * p * inverse;
    out[n + i] = g * (a * c - e * e) * inverse;
    out[2 * (size_t)n + i] = h * (a * b - o * o) * inverse;
    out[3 * (size_t)n + i] = g * h * (o * e - a * d) * inverse;
    out[4 * (size_t)n + i] = f * h * r * inverse;
    out[5 * (size_t)n + i] = f * g * q * inverse;
}
