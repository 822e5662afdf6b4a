// Bernstein coefficients of the Jacobian determinant inside hexes: samples, changes of basis, bounds.
//
// Arrays have the element as their fastest index. Coefficients of degree n - 1 along u, v, w are (n, n, n, elements).

typedef struct { real x, y, z; } place;

// Determinants (n_samples, n_cells) of hexes of n_nodes nodes; launched over both.
// gradients: (3, n_samples, n_nodes), of the shape functions along u, v, w; they add up to 0 over the nodes, so that
// coordinates may be taken from the first.
__kernel void determinants(__global const real *x, __global const real *y, __global const real *z,
                           __global const int *cells, int n_cells, int n_nodes, __global const real *gradients,
                           int n_samples, __global real *out)
{
    int c = get_global_id(0), s = get_global_id(1);
    if (c >= n_cells)
        return;
    __global const int *cell = cells + (size_t)c * n_nodes;
    __global const real *along_u = gradients + s * n_nodes;
    __global const real *along_v = along_u + n_samples * n_nodes, *along_w = along_v + n_samples * n_nodes;
    place origin = {x[cell[0]], y[cell[0]], z[cell[0]]}, u = {0, 0, 0}, v = {0, 0, 0}, w = {0, 0, 0};
    for (int n = 1; n < n_nodes; n++) {
        int node = cell[n];
        place d = {x[node] - origin.x, y[node] - origin.y, z[node] - origin.z};
        u.x += along_u[n] * d.x;
        u.y += along_u[n] * d.y;
        u.z += along_u[n] * d.z;
        v.x += along_v[n] * d.x;
        v.y += along_v[n] * d.y;
        v.z += along_v[n] * d.z;
        w.x += along_w[n] * d.x;
        w.y += along_w[n] * d.y;
        w.z += along_w[n] * d.z;
    }
    out[(size_t)s * n_cells + c] =
        u.x * (v.y * w.z - v.z * w.y) + u.y * (v.z * w.x - v.x * w.z) + u.z * (v.x * w.y - v.y * w.x);
}

// Matrix (n_rows, length) times values (before, length, after) along their middle; launched over the result.
__kernel void along(__global const real *values, int length, int after, __global const real *matrix, int n_rows,
                    __global real *out)
{
    int a = get_global_id(0), item = get_global_id(1);
    if (a >= after)
        return;
    int before = item / n_rows, row = item % n_rows;
    real total = 0;
    for (int n = 0; n < length; n++)
        total += matrix[row * length + n] * values[((size_t)before * length + n) * after + a];
    out[(size_t)item * after + a] = total;
}

// Least coefficient, and least of the eight at the corners, which are values, of each of parts^3 blocks of n^3.
// values: (parts n, parts n, parts n, n_cells); lower, upper: (parts^3, n_cells), over which it is launched.
__kernel void bounds(__global const real *values, int n, int parts, int n_cells, __global real *lower,
                     __global real *upper)
{
    int c = get_global_id(0), part = get_global_id(1);
    if (c >= n_cells)
        return;
    int size = parts * n;
    size_t start = ((part / (parts * parts)) * size + part / parts % parts) * (size_t)size + part % parts;
    real low = values[n * start * n_cells + c], high = low;
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++)
            for (int k = 0; k < n; k++) {
                real value = values[(n * start + (i * size + j) * size + k) * n_cells + c];
                low = fmin(low, value);
                if ((i == 0 || i == n - 1) && (j == 0 || j == n - 1) && (k == 0 || k == n - 1))
                    high = fmin(high, value);
            }
    lower[(size_t)part * n_cells + c] = low;
    upper[(size_t)part * n_cells + c] = high;
}
