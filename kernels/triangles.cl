// Distance of points from triangles, found through a grid of bins that list the triangles that pass through them.
//
// The nearest point of a triangle lies on its plane, where the foot of the perpendicular is within the triangle, or else
// on one of its edges.

typedef struct { real x, y, z; } place;

inline real inner(place a, place b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

inline place minus(place a, place b)
{
    place c = {a.x - b.x, a.y - b.y, a.z - b.z};
    return c;
}

// Squared distance of p from the segment from the origin to e, which may have no length.
inline real segment_squared(place p, place e)
{
    real length = inner(e, e);
    real share = length > 0 ? clamp(inner(p, e) / length, (real)0, (real)1) : 0;
    place d = {p.x - share * e.x, p.y - share * e.y, p.z - share * e.z};
    return inner(d, d);
}

// Positive where p is on the inner side of the edge e of a triangle with the normal n.
inline real leftward(place p, place e, place n)
{
    return p.x * (n.y * e.z - n.z * e.y) + p.y * (n.z * e.x - n.x * e.z) + p.z * (n.x * e.y - n.y * e.x);
}

// Squared distance of p from triangle t.
inline real triangle_squared(place p, int t, int m, __global const real *corners)
{
    __global const real *first = corners + t, *second = first + 3 * (size_t)m, *third = second + 3 * (size_t)m;
    place a = {p.x - first[0], p.y - first[m], p.z - first[2 * (size_t)m]};
    place b = {p.x - second[0], p.y - second[m], p.z - second[2 * (size_t)m]};
    place c = {p.x - third[0], p.y - third[m], p.z - third[2 * (size_t)m]};
    place u = minus(a, b), v = minus(b, c), w = minus(c, a);
    place n = {u.y * v.z - u.z * v.y, u.z * v.x - u.x * v.z, u.x * v.y - u.y * v.x};
    real square = inner(n, n), height = inner(a, n);
    if (square > 0 && leftward(a, u, n) >= 0 && leftward(b, v, n) >= 0 && leftward(c, w, n) >= 0)
        return height / square * height;
    return fmin(segment_squared(a, u), fmin(segment_squared(b, v), segment_squared(c, w)));
}

inline int outermost(int a, int b, int c)
{
    return max((int)abs(a), max((int)abs(b), (int)abs(c)));
}

// Distance from the nearest triangle and its number; -1 and -1 where none is listed within `rings` bins.
//
// corners: (9, n_triangles) planes, x, y, z of each triangle's three. start (n_i n_j n_k + 1): where a bin's triangles
// begin in `listed`; bins are cubes of edge `size` from (x0, y0, z0) on, i fastest. Exact where it is no more than rings
// times size.
__kernel void nearest(__global const real *x, __global const real *y, __global const real *z,
                      __global const real *corners, int n_triangles, __global const int *start,
                      __global const int *listed, int n_i, int n_j, int n_k, real x0, real y0, real z0, real size,
                      int rings, int n_points, __global real *distance, __global int *triangle)
{
    int at = get_global_id(0);
    if (at >= n_points)
        return;
    place p = {x[at], y[at], z[at]};
    int i = clamp((int)floor((p.x - x0) / size), 0, n_i - 1);
    int j = clamp((int)floor((p.y - y0) / size), 0, n_j - 1);
    int k = clamp((int)floor((p.z - z0) / size), 0, n_k - 1);
    real best = -1;
    int chosen = -1;
    for (int ring = 0; ring <= rings; ring++) {
        for (int c = max(k - ring, 0); c <= min(k + ring, n_k - 1); c++)
            for (int b = max(j - ring, 0); b <= min(j + ring, n_j - 1); b++)
                for (int a = max(i - ring, 0); a <= min(i + ring, n_i - 1); a++) {
                    if (outermost(a - i, b - j, c - k) != ring)
                        continue;
                    int bin = (c * n_j + b) * n_i + a;
                    for (int s = start[bin]; s < start[bin + 1]; s++) {
                        real squared = triangle_squared(p, listed[s], n_triangles, corners);
                        if (chosen < 0 || squared < best) {
                            best = squared;
                            chosen = listed[s];
                        }
                    }
                }
        real reach = (real)ring * size;
        if (chosen >= 0 && best <= reach * reach)
            break;
    }
    distance[at] = chosen >= 0 ? sqrt(fmax(best, (real)0)) : (real)-1;
    triangle[at] = chosen;
}

// Distance of each point from the triangle given for it.
__kernel void given(__global const real *x, __global const real *y, __global const real *z,
                    __global const real *corners, int n_triangles, __global const int *triangle, int n_points,
                    __global real *distance)
{
    int at = get_global_id(0);
    if (at >= n_points)
        return;
    place p = {x[at], y[at], z[at]};
    distance[at] = sqrt(triangle_squared(p, triangle[at], n_triangles, corners));
}
