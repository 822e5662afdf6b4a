// Types of every OpenCL kernel, put before each program by the OpenCL device.
//
// real   float or double, given as -D real=...
// LANES  elements a work item handles along the fastest dimension: 1 on a GPU, 8 on a CPU, where PoCL does not
//        vectorise across work items by itself. A kernel written in `realv` says so with vec_type_hint(realv), and is
//        launched over the fastest dimension divided by LANES.
//
// Buffers are padded by LANES elements, so that `load` may read past the last row; `store` writes only what is asked.

#ifdef cl_khr_fp64
#pragma OPENCL EXTENSION cl_khr_fp64 : enable
#endif

#define JOIN_(a, b) a##b
#define JOIN(a, b) JOIN_(a, b)
#if LANES == 1
typedef real realv;
#define load(p, offset) ((p)[offset])
#define store_all(v, p, offset) ((p)[offset] = (v))
#else
typedef JOIN(real, LANES) realv;
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
    union { realv v; real lane[LANES]; } parts;
    parts.v = v;
    for (int lane = 0; lane < count; lane++)
        p[offset + lane] = parts.lane[lane];
}
