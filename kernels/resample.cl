// Trilinear sampling of a volume at points in patient millimetres, or of bricks of a lattice. A volume has less than 2^31 samples.

// Indices along one axis: the lower of the two samples round each point, and the share of the upper one.
inline intv lower_sample(realv t, int size, realv *share)
{
    t = smaller(larger(t, (realv)0), (realv)(size - 1)); // not clamp: what lies in the padding may be no number
    intv low = min(to_intv(t), (intv)max(size - 2, 0));
    *share = t - to_realv(low);
    return low;
}

inline realv beyond(realv t, int size)
{
    return fmax((realv)(real)-0.5 - t, t - (size - (real)0.5));
}

// A place in the grid of samples: the lowest of the eight round it, and the shares of the upper ones.
typedef struct { intv corner; realv i, j, k; } place;

inline place find_place(int n_i, int n_j, int n_k, realv ti, realv tj, realv tk)
{
    place at;
    at.corner = lower_sample(ti, n_i, &at.i) + n_i * lower_sample(tj, n_j, &at.j) + n_i * n_j * lower_sample(tk, n_k, &at.k);
    return at;
}

// Two samples for each lane.
#if LANES == 1
typedef JOIN(real, 2) realpairs;
#else
typedef JOIN(real, 16) realpairs;
#endif

// The mean of two neighbours along i, read as one.
inline realv along_i(__global const real *volume, intv corner, int n_i, realv share)
{
    union { realpairs v; JOIN(real, 2) pair[LANES]; } samples;
    union { intv v; int lane[LANES]; } at = {corner};
    for (int lane = 0; lane < LANES; lane++)
        samples.pair[lane] = vload2(0, volume + at.lane[lane]);
    return mix(samples.v.even, n_i > 1 ? samples.v.odd : samples.v.even, share);
}

inline realv interpolated(__global const real *volume, int n_i, int n_j, int n_k, realv ti, realv tj, realv tk)
{
    int step_j = n_j > 1 ? n_i : 0, step_k = n_k > 1 ? n_i * n_j : 0;
    place at = find_place(n_i, n_j, n_k, ti, tj, tk);
    realv value[2];
    for (int k = 0; k < 2; k++, at.corner += step_k) {
        realv low = along_i(volume, at.corner, n_i, at.i), high = along_i(volume, at.corner + step_j, n_i, at.i);
        value[k] = mix(low, high, at.j);
    }
    return mix(value[0], value[1], at.k);
}

// Vectors of points whose samples are asked for before they are read: waiting for them is most of the time.
#define AHEAD 8

inline void fetch_samples(int n_i, int n_j, int n_k, __global const real *volume, realv ti, realv tj, realv tk)
{
    union { intv v; int lane[LANES]; } at = {find_place(n_i, n_j, n_k, ti, tj, tk).corner};
    for (int lane = 0; lane < LANES; lane++) {
        size_t low = at.lane[lane], high = low + n_i * n_j;
        fetch(volume, low, 1);
        fetch(volume, low + n_i, 1);
        fetch(volume, high, 1);
        fetch(volume, high + n_i, 1);
    }
}

// One of three indices of points p, p + 1, ...
inline realv index_of(__global const real *to_index, __global const real *x, __global const real *y,
                      __global const real *z, int p)
{
    return to_index[0] * load(x, p) + to_index[1] * load(y, p) + to_index[2] * load(z, p) + to_index[3];
}

// to_index: row-major 3x4 map from millimetres to the index (i, j, k). Up to half a voxel beyond the outermost centres the
// border voxel's value goes on; farther out it does so where `clamp_outside` is 1, and is `outside` where it is 0. On a GPU
// a work item takes `run` points, TILE apart.
#define TILE 256
#if LANES == 1
#define FOR_POINTS(p)                                                                        \
    int end = min(((int)get_global_id(0) / TILE + 1) * TILE * run, n_points);                \
    for (int p = get_global_id(0) / TILE * TILE * run + get_global_id(0) % TILE; p < end; p += TILE)
#else
#define FOR_POINTS(p) FOR_LANES(p, n_points)
#endif
__kernel __attribute__((vec_type_hint(realv)))
void trilinear(__global const real *volume, int n_i, int n_j, int n_k, __global const real *to_index,
               __global const real *x, __global const real *y, __global const real *z, real outside, int clamp_outside,
               int run, int n_points, __global real *out)
{
#define INDEX(row, p) index_of(to_index + 4 * row, x, y, z, p)
    FOR_POINTS(p) {
#if LANES > 1
        int later = min(p + AHEAD * LANES, n_points);
        fetch_samples(n_i, n_j, n_k, volume, INDEX(0, later), INDEX(1, later), INDEX(2, later));
#endif
        realv ti = INDEX(0, p), tj = INDEX(1, p), tk = INDEX(2, p);
        realv result = interpolated(volume, n_i, n_j, n_k, ti, tj, tk);
        if (!clamp_outside) {
            realv off = fmax(fmax(beyond(ti, n_i), beyond(tj, n_j)), beyond(tk, n_k));
            result = off > (realv)0 ? (realv)outside : result;
        }
        store(result, out, p, n_points - p);
    }
}

// How far index t lies outside the outermost centres, `gap` apart, negative inside.
inline realv out_of(realv t, int size, real gap)
{
    return gap * fmax(-t, t - (real)(size - 1));
}

// The same of a distance at the samples of bricks of a lattice, launched over their rows and `edge`: the border's value goes
// on outside, but no less than the distance from the planes of the outermost voxel centres, `gap` (3) apart along each
// axis. to_index maps indices of the lattice to those of the volume; `corners` (bricks, 3) are the indices i, j, k of the
// first sample of each.
__kernel __attribute__((vec_type_hint(realv)))
void bricks(__global const real *volume, int n_i, int n_j, int n_k, __global const real *to_index,
            __global const real *gap, __global const int *corners, int edge, __global real *out)
{
    __global const real *m = to_index;
    int row = get_global_id(1);
    __global const int *corner = corners + 3 * (row / (edge * edge));
    int j = row % edge + corner[1], k = row / edge % edge + corner[2];
    real bi = m[1] * j + m[2] * k + m[3], bj = m[5] * j + m[6] * k + m[7], bk = m[9] * j + m[10] * k + m[11];
    union { intv v; int lane[LANES]; } up;
    for (int lane = 0; lane < LANES; lane++)
        up.lane[lane] = lane + corner[0];
    FOR_LANES(i, edge) {
        realv at = to_realv(up.v + i), ti = m[0] * at + bi, tj = m[4] * at + bj, tk = m[8] * at + bk;
        realv off = fmax(fmax(out_of(ti, n_i, gap[0]), out_of(tj, n_j, gap[1])), out_of(tk, n_k, gap[2]));
        store(fmax(interpolated(volume, n_i, n_j, n_k, ti, tj, tk), off), out, (size_t)row * edge + i, edge - i);
    }
}
