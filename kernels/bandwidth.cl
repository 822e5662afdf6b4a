// What the memory of a device gives: writing alone, two reads to a write (the triad of McCalpin's STREAM), and gathers.
// Results are written past the caches, as a kernel does that knows its result to be far larger. A work item of a GPU takes
// several numbers, `items` apart.

__kernel __attribute__((vec_type_hint(realv)))
void fill(__global real *out, real value, int n, int items)
{
    FOR_LANES(i, n) stream((realv)value, out, i, n - i);
}

__kernel __attribute__((vec_type_hint(realv)))
void triad(__global const real *a, __global const real *b, real factor, int n, int items, __global real *out)
{
    FOR_LANES(i, n) stream(load(a, i) + factor * load(b, i), out, i, n - i);
}

__kernel void gather(__global const real *source, __global const int *index, int n, int items, __global real *out)
{
    for (int i = get_global_id(0); i < n; i += items)
        out[i] = source[index[i]];
}
