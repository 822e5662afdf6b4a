// Trilinear sampling of a volume at points in patient millimetres.

// to_index: row-major 3x4 map from millimetres to the index (i, j, k). Up to half a voxel beyond the outermost centres the
// border voxel's value goes on; farther out it does so where `clamp_outside` is 1, and is `outside` where it is 0.
__kernel void trilinear(__global const real *volume, int n_i, int n_j, int n_k, __global const real *to_index,
                        __global const real *x, __global const real *y, __global const real *z, real outside,
                        int clamp_outside, int n_points, __global real *out)
{
    int p = get_global_id(0);
    if (p >= n_points)
        return;
    const int size[3] = {n_i, n_j, n_k};
    const size_t stride[3] = {1, n_i, (size_t)n_i * n_j};
    size_t origin = 0, step[3];
    real share[3];
    bool inside = true;
    for (int axis = 0; axis < 3; axis++) {
        __global const real *row = to_index + 4 * axis;
        real t = row[0] * x[p] + row[1] * y[p] + row[2] * z[p] + row[3];
        inside = inside && t >= (real)-0.5 && t <= size[axis] - (real)0.5;
        t = clamp(t, (real)0, (real)(size[axis] - 1));
        int low = min((int)t, max(size[axis] - 2, 0));
        share[axis] = t - low;
        step[axis] = size[axis] > 1 ? stride[axis] : 0;
        origin += low * stride[axis];
    }
    __global const real *v = volume + origin;
    real near = mix(mix(v[0], v[step[0]], share[0]), mix(v[step[1]], v[step[1] + step[0]], share[0]), share[1]);
    v += step[2];
    real far = mix(mix(v[0], v[step[0]], share[0]), mix(v[step[1]], v[step[1] + step[0]], share[0]), share[1]);
    out[p] = inside || clamp_outside ? mix(near, far, share[2]) : outside;
}
