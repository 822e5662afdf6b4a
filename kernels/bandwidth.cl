// What the memory of a device gives: writing alone, and two reads to a write (the triad of McCalpin's STREAM). Results are
// written past the caches, as a kernel does that knows its result to be far larger.

__kernel __attribute__((vec_type_hint(realv)))
void fill(__global real *out, real value, int n)
{
    FOR_LANES(i, n) stream((realv)value, out, i, n - i);
}

__kernel __attribute__((vec_type_hint(realv)))
void triad(__global const real *a, __global const real *b, real factor, int n, __global real *out)
{
    FOR_LANES(i, n) stream(load(a, i) + factor * load(b, i), out, i, n - i);
}
