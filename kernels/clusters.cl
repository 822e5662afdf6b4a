// WIDE
// Linear elasticity of hex8 without structure on a CPU: K u by clusters of elements that its caches hold.
//
// A cluster is `size` elements side by side in space, one after another in the table, the last of them fewer. It has nodes
// of its own, copies `of` the mesh's, from starts[cluster] on: there it finds places and displacements near each other, and
// sums what its elements give. The force on a node is the sum of its copies'. `cells` (8, m) are numbers of copies, vertices as
// in trilinear.h.

#include "trilinear.h"

#define AHEAD 256 // what is read at random is fetched so far before it is needed

#if LANES == 1
#define lanes_of(plane, at) (plane)[*(at)]
#else
#define FOUR(plane, at) (plane)[(at)[0]], (plane)[(at)[1]], (plane)[(at)[2]], (plane)[(at)[3]]
#define EIGHT(plane, at) FOUR(plane, at), FOUR(plane, (at) + 4)
#if LANES == 8 // lane by lane into a register: vectors put together in memory wait for it
#define lanes_of(plane, at) (realv)(EIGHT(plane, at))
#else
#define lanes_of(plane, at) (realv)(EIGHT(plane, at), EIGHT(plane, (at) + 8))
#endif
#endif

// Derivatives (36) of three planes of `count` copies.
inline void along(realv *d, __global const real *planes, int count, __global const int *cells, int m)
{
    for (int c = 0; c < 3; c++) {
        __global const real *plane = planes + (size_t)c * count;
        realv v[8];
        for (int a = 0; a < 8; a++)
            v[a] = lanes_of(plane, cells + (size_t)a * m);
        derivatives(v, d + 12 * c);
    }
}

// Forces (3, count) on the copies of nodes from the places (3, count) of these and the displacement (3, n) of the nodes,
// of which `moved` (3, count) gets copies. Launched over (clusters, size): the first work item of a cluster takes it all.
// m is a multiple of LANES.
__kernel __attribute__((vec_type_hint(realv)))
void cluster_forces(__global const real *places, __global const real *displacement, int n, __global const int *of,
                    __global const int *starts, int count, __global const int *cells, int m, __global const real *lam,
                    __global const real *mu, int size, __global real *moved, __global real *out) ALONE
{
    int cluster = get_global_id(1), begin = starts[cluster], end = starts[cluster + 1];
    if (get_global_id(0))
        return;
    for (int i = begin; i < end; i++) {
        int node = of[i];
        for (int c = 0; c < 3; c++) {
            fetch(places, (size_t)c * count + i + AHEAD, 1);
            moved[(size_t)c * count + i] = displacement[(size_t)c * n + node];
            out[(size_t)c * count + i] = 0;
        }
    }
    for (int e = cluster * size; e < min(cluster * size + size, m); e += LANES) {
        realv x[36], h[36], f[36];
        union { realv v[24]; real lane[24][LANES]; } given;
        for (int g = 0; g < 8; g++) {
            fetch(lam, (size_t)g * m + e + 4 * LANES, 1);
            fetch(mu, (size_t)g * m + e + 4 * LANES, 1);
            fetch_int(cells, (size_t)g * m + e + 8 * LANES);
        }
        along(x, places, count, cells + e, m);
        along(h, moved, count, cells + e, m);
        stressed(x, h, f, lam + e, mu + e, m);
        for (int c = 0; c < 3; c++)
            vertices(f + 12 * c, given.v + 8 * c);
        for (int a = 0; a < 8; a++)
            for (int lane = 0; lane < LANES; lane++) {
                __global real *to = out + cells[(size_t)a * m + e + lane];
                for (int c = 0; c < 3; c++)
                    to[(size_t)c * count] += given.lane[8 * c + a][lane];
            }
    }
}

// Forces (3, n) from those on copies (3, count), 0 where `free` (3, n) is 0; the copies of a node are slots[start[node] ...].
__kernel void sum_copies(__global const real *values, int count, __global const int *start, __global const int *slots,
                         __global const real *free, int n, __global real *out)
{
    int node = get_global_id(0);
    if (node >= n)
        return;
    real x = 0, y = 0, z = 0;
    for (int s = start[node], end = start[node + 1]; s < end; s++) {
        __global const real *value = values + slots[s];
        x += value[0];
        y += value[count];
        z += value[2 * (size_t)count];
    }
    out[node] = x * free[node];
    out[(size_t)n + node] = y * free[(size_t)n + node];
    out[2 * (size_t)n + node] = z * free[2 * (size_t)n + node];
}
