// Distance of points from triangles, found through a grid of bins that list the triangles that pass through them.
//
// The nearest point of a triangle lies on its plane, where the foot of the perpendicular is within the triangle, or else
// on one of its edges.

typedef struct { realv x, y, z; } lanes3;

inline realv inner(lanes3 a, lanes3 b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

inline lanes3 minus(lanes3 a, lanes3 b)
{
    lanes3 c = {a.x - b.x, a.y - b.y, a.z - b.z};
    return c;
}

// Squared distance of p from the segment from the origin to e, which may have no length.
inline realv segment_squared(lanes3 p, lanes3 e)
{
    realv length = inner(e, e), none = 0;
    realv share = length > 0 ? clamp(inner(p, e) / length, none, none + 1) : none;
    lanes3 d = {p.x - share * e.x, p.y - share * e.y, p.z - share * e.z};
    return inner(d, d);
}

// Positive where p is on the inner side of the edge e of a triangle with the normal n.
inline realv leftward(lanes3 p, lanes3 e, lanes3 n)
{
    return p.x * (n.y * e.z - n.z * e.y) + p.y * (n.z * e.x - n.x * e.z) + p.z * (n.x * e.y - n.y * e.x);
}

// Squared distance of p from triangle t and those that are listed after it.
inline realv triangle_squared(lanes3 p, int t, int m, __global const real *corners)
{
    __global const real *first = corners + t, *second = first + 3 * (size_t)m, *third = second + 3 * (size_t)m;
    lanes3 a = {p.x - load(first, 0), p.y - load(first, m), p.z - load(first, 2 * (size_t)m)};
    lanes3 b = {p.x - load(second, 0), p.y - load(second, m), p.z - load(second, 2 * (size_t)m)};
    lanes3 c = {p.x - load(third, 0), p.y - load(third, m), p.z - load(third, 2 * (size_t)m)};
    lanes3 u = minus(a, b), v = minus(b, c), w = minus(c, a);
    lanes3 n = {u.y * v.z - u.z * v.y, u.z * v.x - u.x * v.z, u.x * v.y - u.y * v.x};
    realv square = inner(n, n), height = inner(a, n);
    realv edges = smaller(segment_squared(a, u), smaller(segment_squared(b, v), segment_squared(c, w)));
    return square > 0 && leftward(a, u, n) >= 0 && leftward(b, v, n) >= 0 && leftward(c, w, n) >= 0
        ? height / square * height : edges;
}

// By how much the squared distance of p from the balls round triangle t, and those that are listed after it, is more than
// that of what is `away` from the triangles at least.
inline realv beyond(lanes3 p, int t, int m, __global const real *balls, real away)
{
    __global const real *ball = balls + t;
    lanes3 off = {p.x - load(ball, 0), p.y - load(ball, m), p.z - load(ball, 2 * (size_t)m)};
    realv most = away + load(ball, 3 * (size_t)m);
    return inner(off, off) - most * most;
}

inline real least(realv v)
{
    union { realv v; real lane[LANES]; } parts = {v};
    real found = parts.lane[0];
    for (int lane = 1; lane < LANES; lane++)
        found = fmin(found, parts.lane[lane]);
    return found;
}

inline int outermost(int a, int b, int c)
{
    return max((int)abs(a), max((int)abs(b), (int)abs(c)));
}

// Distance from the nearest triangle and its number; -1 and -1 where none is listed within `rings` bins.
//
// Bins are cubes of edge `size` from (x0, y0, z0) on, i fastest; the triangles that pass through one are listed together, from
// start (n_i n_j n_k + 1) on: corners (9, n_listed) planes, x, y, z of each triangle's three; balls (4, n_listed), centre and
// radius, a little larger than the triangle; its number, `listed`. known (n_i n_j n_k): where one is listed that counts for
// all points of a bin, or -1. Exact where it is no more than rings times size.
__kernel void nearest(__global const real *x, __global const real *y, __global const real *z,
                      __global const real *corners, __global const real *balls, int n_listed, __global const int *start,
                      __global const int *listed, __global const int *known, int n_i, int n_j, int n_k, real x0, real y0,
                      real z0, real size, int rings, int n_points, __global real *distance, __global int *triangle)
{
    int at = get_global_id(0);
    if (at >= n_points)
        return;
    lanes3 p = {x[at], y[at], z[at]};
    int i = clamp((int)floor((x[at] - x0) / size), 0, n_i - 1);
    int j = clamp((int)floor((y[at] - y0) / size), 0, n_j - 1);
    int k = clamp((int)floor((z[at] - z0) / size), 0, n_k - 1);
    int chosen = known[(k * n_j + j) * n_i + i];
    union { realv v; real lane[LANES]; } squared;
    real best = INFINITY;
    if (chosen >= 0) {
        squared.v = triangle_squared(p, chosen, n_listed, corners);
        best = squared.lane[0];
    }
    real away = sqrt(fmax(best, (real)0));
    for (int ring = 0; ring <= rings; ring++) {
        for (int c = max(k - ring, 0); c <= min(k + ring, n_k - 1); c++)
            for (int b = max(j - ring, 0); b <= min(j + ring, n_j - 1); b++)
                for (int a = max(i - ring, 0); a <= min(i + ring, n_i - 1); a++) {
                    if (outermost(a - i, b - j, c - k) != ring)
                        continue;
                    int bin = (c * n_j + b) * n_i + a;
                    for (int s = start[bin], end = start[bin + 1]; s < end; s += LANES) {
                        if (least(beyond(p, s, n_listed, balls, away)) > 0)
                            continue;
                        squared.v = triangle_squared(p, s, n_listed, corners);
                        for (int lane = 0; lane < min(LANES, end - s); lane++)
                            if (squared.lane[lane] < best) {
                                best = squared.lane[lane];
                                chosen = s + lane;
                            }
                        away = sqrt(fmax(best, (real)0));
                    }
                }
        real reach = (real)ring * size;
        if (best <= reach * reach)
            break;
    }
    distance[at] = chosen >= 0 ? sqrt(fmax(best, (real)0)) : (real)-1;
    triangle[at] = chosen >= 0 ? listed[chosen] : -1;
}
