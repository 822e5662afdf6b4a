// Integrals over elements: where the quadrature points lie, nodal fields at them, and means over each element.
//
// `nodes` is (k, m): plane a holds the number of vertex a of each element, in VTK's order. What belongs to quadrature
// points is (points, m). `shape` (points, k) and `slopes` (points, k, 3) are the shape functions and their derivatives;
// the third of quads is 0.

#define MOST_NODES 27

inline realv gathered(__global const real *plane, __global const int *nodes, int m, int first)
{
    union { realv v; real lane[LANES]; } parts;
    for (int lane = 0; lane < LANES; lane++)
        parts.lane[lane] = plane[nodes[min(first + lane, m - 1)]];
    return parts.v;
}

// Place of each point and the volume that it stands for, of quads (`flat` 1) the area.
__kernel __attribute__((vec_type_hint(realv)))
void places(__global const real *points, int n, __global const int *nodes, int k, int m, int flat,
            __global const real *shape, __global const real *slopes, __global const real *weights, int n_points,
            __global real *x, __global real *y, __global real *z, __global real *volume)
{
    FOR_LANES(e, m) {
        realv corner[3], edge[3 * MOST_NODES];
        for (int c = 0; c < 3; c++) {
            __global const real *plane = points + (size_t)c * n;
            corner[c] = gathered(plane, nodes, m, e);
            for (int a = 1; a < k; a++) // from vertex 0, so that the digits of the place are not lost in the differences
                edge[3 * a + c] = gathered(plane, nodes + (size_t)a * m, m, e) - corner[c];
        }
        for (int g = 0; g < n_points; g++) {
            realv place[3] = {0, 0, 0}, u[3] = {0, 0, 0}, v[3] = {0, 0, 0}, w[3] = {0, 0, 0};
            for (int a = 1; a < k; a++) {
                int at = g * k + a;
                real s = shape[at], along_u = slopes[3 * at], along_v = slopes[3 * at + 1], along_w = slopes[3 * at + 2];
                for (int c = 0; c < 3; c++) {
                    place[c] += s * edge[3 * a + c];
                    u[c] += along_u * edge[3 * a + c];
                    v[c] += along_v * edge[3 * a + c];
                    w[c] += along_w * edge[3 * a + c];
                }
            }
            size_t out = (size_t)g * m + e;
            store(corner[0] + place[0], x, out, m - e);
            store(corner[1] + place[1], y, out, m - e);
            store(corner[2] + place[2], z, out, m - e);
            realv nx = u[1] * v[2] - u[2] * v[1], ny = u[2] * v[0] - u[0] * v[2], nz = u[0] * v[1] - u[1] * v[0];
            realv size = flat == 1 ? sqrt(nx * nx + ny * ny + nz * nz) : nx * w[0] + ny * w[1] + nz * w[2];
            store(weights[g] * size, volume, out, m - e);
        }
    }
}

// A nodal field at each point, within what it is at the element's own nodes; over (points, m).
__kernel __attribute__((vec_type_hint(realv)))
void interpolate(__global const real *field, __global const int *nodes, int k, int m, __global const real *shape,
                 __global real *out)
{
    int g = get_global_id(1);
    FOR_LANES(e, m) {
        realv value = gathered(field, nodes, m, e), low = value, high = value, total = shape[g * k] * value;
        for (int a = 1; a < k; a++) {
            value = gathered(field, nodes + (size_t)a * m, m, e);
            low = fmin(low, value);
            high = fmax(high, value);
            total += shape[g * k + a] * value;
        }
        store(fmin(fmax(total, low), high), out, (size_t)g * m + e, m - e);
    }
}

// Integral (k, m) of values (points, m) times the shape function of each vertex, over each element.
__kernel __attribute__((vec_type_hint(realv)))
void shares(__global const real *values, __global const real *volume, __global const real *shape, int n_points, int k,
            int m, __global real *out)
{
    FOR_LANES(e, m) {
        for (int a = 0; a < k; a++) {
            realv total = 0;
            for (int g = 0; g < n_points; g++) {
                size_t at = (size_t)g * m + e;
                total += shape[g * k + a] * fabs(load(volume, at)) * load(values, at);
            }
            store(total, out, (size_t)a * m + e, m - e);
        }
    }
}

// Mean (m) of values (points, m) over each element, by the size of the volume that each point stands for.
__kernel __attribute__((vec_type_hint(realv)))
void means(__global const real *values, __global const real *volume, int n_points, int m, __global real *out)
{
    FOR_LANES(e, m) {
        realv total = 0, size = 0, plain = 0;
        for (int g = 0; g < n_points; g++) {
            size_t at = (size_t)g * m + e;
            realv part = fabs(load(volume, at)), value = load(values, at);
            size += part;
            total += part * value;
            plain += value;
        }
        store(size > 0 ? total / size : plain / n_points, out, e, m - e);
    }
}
