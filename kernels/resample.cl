// Trilinear sampling of a volume at points in patient millimetres, or of a lattice. A volume has less than 2^31 samples.

// Indices along one axis: the lower of the two samples round each point, and the share of the upper one.
inline intv lower_sample(realv t, int size, realv *share)
{
    t = fmin(fmax(t, (realv)0), (realv)(size - 1)); // not clamp: what lies in the padding may be no number
    intv low = min(to_intv(t), (intv)max(size - 2, 0));
    *share = t - to_realv(low);
    return low;
}

inline realv beyond(realv t, int size)
{
    return fmax((realv)(real)-0.5 - t, t - (size - (real)0.5));
}

// The samples at `corner` + offset of each lane.
inline realv gather(__global const real *volume, intv corner, int offset)
{
    union { realv v; real lane[LANES]; } samples;
    union { intv v; int lane[LANES]; } at = {corner + offset};
    for (int lane = 0; lane < LANES; lane++)
        samples.lane[lane] = volume[at.lane[lane]];
    return samples.v;
}

inline realv interpolated(__global const real *volume, int n_i, int n_j, int n_k, realv ti, realv tj, realv tk)
{
    int step_i = n_i > 1, step_j = n_j > 1 ? n_i : 0, step_k = n_k > 1 ? n_i * n_j : 0;
    realv share_i, share_j, share_k, value[2];
    intv corner = lower_sample(ti, n_i, &share_i) + n_i * lower_sample(tj, n_j, &share_j)
                + n_i * n_j * lower_sample(tk, n_k, &share_k);
    for (int k = 0; k < 2; k++) {
        int base = k * step_k;
        realv low = mix(gather(volume, corner, base), gather(volume, corner, base + step_i), share_i);
        realv high = mix(gather(volume, corner, base + step_j), gather(volume, corner, base + step_j + step_i), share_i);
        value[k] = mix(low, high, share_j);
    }
    return mix(value[0], value[1], share_k);
}

// to_index: row-major 3x4 map from millimetres to the index (i, j, k). Up to half a voxel beyond the outermost centres the
// border voxel's value goes on; farther out it does so where `clamp_outside` is 1, and is `outside` where it is 0.
__kernel __attribute__((vec_type_hint(realv)))
void trilinear(__global const real *volume, int n_i, int n_j, int n_k, __global const real *to_index,
               __global const real *x, __global const real *y, __global const real *z, real outside, int clamp_outside,
               int n_points, __global real *out)
{
    __global const real *m = to_index;
    FOR_LANES(p, n_points) {
        realv px = load(x, p), py = load(y, p), pz = load(z, p);
        realv ti = m[0] * px + m[1] * py + m[2] * pz + m[3];
        realv tj = m[4] * px + m[5] * py + m[6] * pz + m[7];
        realv tk = m[8] * px + m[9] * py + m[10] * pz + m[11];
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

// The same of a distance at the samples (m_k, m_j, m_i) of a lattice, launched over its rows and m_i: the border's value goes
// on outside, but no less than the distance from the planes of the outermost voxel centres, `gap` (3) apart along each
// axis. to_index maps indices of the lattice to those of the volume.
__kernel __attribute__((vec_type_hint(realv)))
void lattice(__global const real *volume, int n_i, int n_j, int n_k, __global const real *to_index,
             __global const real *gap, int m_i, int m_j, __global real *out)
{
    __global const real *m = to_index;
    int row = get_global_id(1), j = row % m_j, k = row / m_j;
    real bi = m[1] * j + m[2] * k + m[3], bj = m[5] * j + m[6] * k + m[7], bk = m[9] * j + m[10] * k + m[11];
    union { intv v; int lane[LANES]; } up;
    for (int lane = 0; lane < LANES; lane++)
        up.lane[lane] = lane;
    FOR_LANES(i, m_i) {
        realv at = to_realv(up.v + i), ti = m[0] * at + bi, tj = m[4] * at + bj, tk = m[8] * at + bk;
        realv off = fmax(fmax(out_of(ti, n_i, gap[0]), out_of(tj, n_j, gap[1])), out_of(tk, n_k, gap[2]));
        store(fmax(interpolated(volume, n_i, n_j, n_k, ti, tj, tk), off), out, (size_t)row * m_i + i, m_i - i);
    }
}
