// Types of every OpenCL kernel, put before each program by the OpenCL device.
//
// real   float or double, given as -D real=...
// LANES  elements of the vector type realv: 1 on a GPU, 8 on a CPU, where PoCL does not vectorise across work items by
//        itself. A kernel written in realv says so with vec_type_hint(realv) and walks the fastest dimension with
//        FOR_LANES; the device then launches it over fewer work items there.
//
// Buffers are padded by LANES elements, so that `load` may read past the last row; `store` writes only what is asked.

#ifdef cl_khr_fp64
#pragma OPENCL EXTENSION cl_khr_fp64 : enable
#endif

// The elements i, i + 1, ... i + LANES - 1 that this work item takes of n, in turn. On a GPU neighbours touch neighbouring
// memory; on a CPU each work item takes one run, so that what does not depend on i is read once for all of it.
#if LANES == 1
#define FOR_LANES(i, n) for (int i = get_global_id(0); i < (n); i += get_global_size(0))
#else
#define FOR_LANES(i, n) for (int i = run_start(get_global_id(0), n); i < run_start(get_global_id(0) + 1, n); i += LANES)
inline int run_start(size_t item, int n)
{
    int vectors = (n + LANES - 1) / LANES, share = (vectors + get_global_size(0) - 1) / get_global_size(0);
    return min((int)item * share, vectors) * LANES;
}
#endif

// No multiplication and addition are fused, as in Warp on a CPU: both round alike and give the same mesh to the last bit.
#pragma OPENCL FP_CONTRACT OFF

#define JOIN_(a, b) a##b
#define JOIN(a, b) JOIN_(a, b)
#if LANES == 1
typedef real realv;
typedef int intv;
#define load(p, offset) ((p)[offset])
#define store_all(v, p, offset) ((p)[offset] = (v))
#define to_intv(v) ((int)(v))
#define to_realv(v) ((real)(v))
#else
typedef JOIN(real, LANES) realv;
typedef JOIN(int, LANES) intv;
#define to_intv(v) JOIN(convert_int, LANES)(v)
#define to_realv(v) JOIN(JOIN(convert_, real), LANES)(v)
#define load(p, offset) JOIN(vload, LANES)(0, (p) + (offset))
#define store_all(v, p, offset) JOIN(vstore, LANES)(v, 0, (p) + (offset))
#endif

// Writes the first `count` lanes of v to p[offset ...].
inline void store(realv v, __global real *p, size_t offset, int count)
{
    if (count >= LANES) {
        store_all(v, p, offset);
        return;
    }
    union { realv v; real lane[LANES]; } parts = {v};
    for (int lane = 0; lane < count; lane++)
        p[offset + lane] = parts.lane[lane];
}

inline void store_int(intv v, __global int *p, size_t offset, int count)
{
    if (count >= LANES) {
        store_all(v, p, offset);
        return;
    }
    union { intv v; int lane[LANES]; } parts = {v};
    for (int lane = 0; lane < count; lane++)
        p[offset + lane] = parts.lane[lane];
}

// The same for a target far larger than the caches: where the address allows it, past them, which saves reading each
// line before it is overwritten.
inline void stream(realv v, __global real *p, size_t offset, int count)
{
#if LANES > 1 && defined(__has_builtin)
#if __has_builtin(__builtin_nontemporal_store)
    if (count >= LANES && ((size_t)(p + offset) & (sizeof(realv) - 1)) == 0) {
        __builtin_nontemporal_store(v, (__global realv *)(p + offset));
        return;
    }
#endif
#endif
    store(v, p, offset, count);
}
