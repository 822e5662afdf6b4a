// WIDE
// What the arithmetic of a device gives: products and sums of numbers that stay in registers, fused where it can.

#pragma OPENCL FP_CONTRACT ON

// 8 times `rounds` steps y = a y + b of each element, 2 operations each; the 8 do not wait for each other.
__kernel __attribute__((vec_type_hint(realv)))
void multiply_add(__global const real *start, real a, real b, int rounds, int n, __global real *out)
{
    FOR_LANES(i, n) {
        realv y0 = load(start, i), y1 = y0 + 1, y2 = y0 + 2, y3 = y0 + 3, y4 = y0 + 4, y5 = y0 + 5, y6 = y0 + 6, y7 = y0 + 7;
        for (int round = 0; round < rounds; round++) {
            y0 = a * y0 + b;
            y1 = a * y1 + b;
            y2 = a * y2 + b;
            y3 = a * y3 + b;
            y4 = a * y4 + b;
            y5 = a * y5 + b;
            y6 = a * y6 + b;
            y7 = a * y7 + b;
        }
        store(((y0 + y1) + (y2 + y3)) + ((y4 + y5) + (y6 + y7)), out, i, n - i);
    }
}
