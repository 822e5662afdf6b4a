// Types of every OpenCL kernel, put before each program by the OpenCL device.
//
// real   float or double, given as -D real=..., of REAL_BYTES
// FUSED  defined for GPUs: a product and a sum may be one operation
// LANES  elements of the vector type realv: 1 on a GPU, 8 on a CPU, where PoCL does not vectorise across work items by
//        itself; in a file whose first line is WIDE 16 for the floats of AVX-512. A kernel written in realv says so with
//        vec_type_hint(realv) and walks the fastest dimension with FOR_LANES; the device then launches it over fewer
//        work items there.
//
// Buffers are padded by LANES elements, so that `load` may read past the last row; `store` writes only what is asked.

#ifdef cl_khr_fp64
#pragma OPENCL EXTENSION cl_khr_fp64 : enable
#endif

// The elements i, i + 1, ... i + LANES - 1 that this work item takes of n, in turn. On a GPU neighbours touch neighbouring
// memory; on a CPU each work item takes one run, so that what does not depend on i is read once for all of it.
#if LANES == 1
#define FOR_LANES(i, n) for (int i = get_global_id(0); (uint)i < (uint)(n); i += get_global_size(0)) // past 2^31 it ends
#else
#define FOR_LANES(i, n) for (int i = run_start(get_global_id(0), n); i < run_start(get_global_id(0) + 1, n); i += LANES)
inline int run_start(size_t item, int n)
{
    int vectors = (n + LANES - 1) / LANES, share = (vectors + get_global_size(0) - 1) / get_global_size(0);
    return min((int)item * share, vectors) * LANES;
}
#endif

// For a kernel whose work item on a CPU is long: a group of its own. PoCL makes a group of many else, keeps what each of
// them knows in arrays on the stack, and gives a group to one core.
#if LANES > 1
#define ALONE __attribute__((reqd_work_group_size(1, 1, 1)))
#else
#define ALONE
#endif

// For a kernel of a GPU whose tiles of work items make a group.
#define GROUP(n) __attribute__((reqd_work_group_size(n, 1, 1)))

// On a CPU no multiplication and addition are fused, as in Warp there: both round alike and give the same mesh to the last
// bit. A GPU's compiler may fuse them, as Warp's does.
#ifndef FUSED
#pragma OPENCL FP_CONTRACT OFF
#endif

#define JOIN_(a, b) a##b
#define JOIN(a, b) JOIN_(a, b)
#if LANES == 1
typedef real realv;
typedef int intv, maskv;
#define load(p, offset) ((p)[offset])
#define store_all(v, p, offset) ((p)[offset] = (v))
#define store_all_int store_all
#define to_intv(v) ((int)(v))
#define to_realv(v) ((real)(v))
#define as_intv(v) as_int(v)
#define as_realv(v) JOIN(as_, real)(v)
#else
typedef JOIN(real, LANES) realv;
typedef JOIN(int, LANES) intv;
#if REAL_BYTES == 4 // what comparing two of realv gives
typedef intv maskv;
#else
typedef JOIN(long, LANES) maskv;
#endif
#define to_intv(v) JOIN(convert_int, LANES)(v)
#define to_realv(v) JOIN(JOIN(convert_, real), LANES)(v)
#if REAL_BYTES == 4
#define to_maskv(v) (v)
#else
#define to_maskv(v) JOIN(convert_long, LANES)(v)
#endif
#define as_intv(v) JOIN(as_int, LANES)(v)
#define as_realv(v) JOIN(JOIN(as_, real), LANES)(v)
// A vector wherever it lies. vload16 and vstore16 say the same, but of two loads that overlap, like nodes and their
// neighbours, LLVM makes many of two numbers each, and of one store three, which loads that follow must wait for.
typedef realv loose __attribute__((aligned(REAL_BYTES)));
typedef intv loose_int __attribute__((aligned(4)));
#define load(p, offset) (*(__global const loose *)((p) + (offset)))
#define load_int(p, offset) (*(__global const loose_int *)((p) + (offset)))
#define store_all(v, p, offset) (*(__global loose *)((p) + (offset)) = (v))
#define store_all_int(v, p, offset) (*(__global loose_int *)((p) + (offset)) = (v))
#if LANES == 16
#define LANE_NUMBERS (intv)(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15)
#else
#define LANE_NUMBERS (intv)(0, 1, 2, 3, 4, 5, 6, 7)
#endif

// Lanes of a vector by their numbers, of which the lowest bits count: one instruction where the processor has it, which
// PoCL's shuffle is not.
inline realv pick(realv v, intv at)
{
#if REAL_BYTES == 4 && LANES == 16 && defined(__AVX512F__)
    return __builtin_ia32_permvarsf512(v, at);
#elif REAL_BYTES == 8 && LANES == 8 && defined(__AVX512F__)
    return __builtin_ia32_permvardf512(v, JOIN(convert_long, LANES)(at));
#elif REAL_BYTES == 4 && LANES == 8 && defined(__AVX2__)
    return __builtin_ia32_permvarsf256(v, at);
#else
    union { realv v; real lane[LANES]; } all = {v}, picked;
    union { intv v; int lane[LANES]; } numbers = {at};
    for (int lane = 0; lane < LANES; lane++)
        picked.lane[lane] = all.lane[numbers.lane[lane] & (LANES - 1)];
    return picked.v;
#endif
}
#endif

// The smaller and the larger of two, the second where the first is no number: an instruction, where fmin and fmax are four.
inline realv smaller(realv a, realv b)
{
    return a < b ? a : b;
}

inline realv larger(realv a, realv b)
{
    return a > b ? a : b;
}

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
        store_all_int(v, p, offset);
        return;
    }
    union { intv v; int lane[LANES]; } parts = {v};
    for (int lane = 0; lane < count; lane++)
        p[offset + lane] = parts.lane[lane];
}

// What a GPU of NVIDIA does in one instruction and OpenCL C does not say: 1 / sqrt of what is more than the smallest
// numbers, and writing past the caches.
#if defined(__NV_CL_C_VERSION) && REAL_BYTES == 4
inline real root_of_inverse(real squared)
{
    real root;
    asm("rsqrt.approx.ftz.f32 %0, %1;" : "=f"(root) : "f"(squared));
    return root;
}

inline void stream_one(real value, __global real *to)
{
    asm volatile("st.global.cs.f32 [%0], %1;" : : "l"((size_t)to), "f"(value));
}
#else
#define root_of_inverse rsqrt
#define stream_one(value, to) (*(to) = (value))
#endif

// Bytes from which a result is written past the caches.
#define LARGE (1 << 24)

// The same for a target far larger than the caches: where the address allows it, past them, which saves reading each
// line before it is overwritten.
#if LANES > 1 && defined(__has_builtin)
#if __has_builtin(__builtin_nontemporal_store)
// All lanes to a place that is aligned to them.
#define stream_all(v, p, offset) __builtin_nontemporal_store((realv)(v), (__global realv *)((p) + (offset)))
#define PAST_CACHES(type, v, p, offset, count)                                             \
    if ((count) >= LANES && ((size_t)((p) + (offset)) & (sizeof(type) - 1)) == 0) {        \
        __builtin_nontemporal_store(v, (__global type *)((p) + (offset)));                 \
        return;                                                                            \
    }
#endif
#endif
#ifndef PAST_CACHES
#define stream_all store_all
#define PAST_CACHES(type, v, p, offset, count)
#endif

// Begins to bring to the caches `count` elements that will be read soon.
inline void fetch(__global const real *p, size_t offset, int count)
{
#if LANES > 1 && defined(__has_builtin)
#if __has_builtin(__builtin_prefetch)
    for (int i = 0; i < count; i += 64 / sizeof(real))
        __builtin_prefetch(p + offset + i);
#endif
#endif
}

inline void fetch_int(__global const int *p, size_t offset)
{
#if LANES > 1 && defined(__has_builtin)
#if __has_builtin(__builtin_prefetch)
    __builtin_prefetch(p + offset);
#endif
#endif
}

inline void stream(realv v, __global real *p, size_t offset, int count)
{
    PAST_CACHES(realv, v, p, offset, count)
    store(v, p, offset, count);
}

inline void stream_int(intv v, __global int *p, size_t offset, int count)
{
    PAST_CACHES(intv, v, p, offset, count)
    store_int(v, p, offset, count);
}
