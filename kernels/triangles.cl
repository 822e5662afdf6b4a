// Distance of points from triangles, found through a grid of bins that list the triangles that pass through them.
//
// The nearest point of a triangle lies on its plane, where the foot of the perpendicular is within the triangle, or else
// on one of its edges.

typedef struct { realv x, y, z; } lanes3;

// Rings of single bins, after which they are looked at in blocks of so many a side: of those that are left most are farther
// than what is found.
#define NEAR 2
#define BLOCK 8
#define SLACK ((real)1e-3) // of a bin, by which boxes are larger than theirs, for what is rounded

typedef struct { real squared, away; int chosen; } nearest_yet;

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

// Goes through what is listed from s to `end`.
inline void look_through(lanes3 p, int s, int end, __global const real *corners, __global const real *balls, int n_listed,
                         nearest_yet *found)
{
    for (; s < end; s += LANES) {
        if (least(beyond(p, s, n_listed, balls, found->away)) > 0)
            continue;
        union { realv v; real lane[LANES]; } squared = {triangle_squared(p, s, n_listed, corners)};
        for (int lane = 0; lane < min(LANES, end - s); lane++)
            if (squared.lane[lane] < found->squared) {
                found->squared = squared.lane[lane];
                found->chosen = s + lane;
            }
        found->away = sqrt(fmax(found->squared, (real)0));
    }
}

// By how much a coordinate is outside of `count` bins, or 0.
inline real outside(real at, real first, int bin, int count, real size)
{
    real low = first + ((real)bin - SLACK) * size, high = first + ((real)(bin + count) + SLACK) * size;
    return fmax(fmax(low - at, at - high), (real)0);
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
    nearest_yet found = {INFINITY, INFINITY, known[(k * n_j + j) * n_i + i]};
    if (found.chosen >= 0) {
        union { realv v; real lane[LANES]; } squared = {triangle_squared(p, found.chosen, n_listed, corners)};
        found.squared = squared.lane[0];
        found.away = sqrt(fmax(found.squared, (real)0));
    }
    real off_x = outside(x[at], x0, 0, n_i, size), off_y = outside(y[at], y0, 0, n_j, size);
    real off_z = outside(z[at], z0, 0, n_k, size), off = off_x * off_x + off_y * off_y + off_z * off_z;
    bool going = true;
    for (int edge = 1; going && edge <= BLOCK; edge *= BLOCK) {
        int rings_here = edge == 1 ? min(rings, NEAR) : rings > NEAR ? rings / edge + 1 : -1;
        int i_here = i / edge, j_here = j / edge, k_here = k / edge;
        for (int ring = 0; going && ring <= rings_here; ring++) {
            for (int c = max(k_here - ring, 0); c <= min(k_here + ring, (n_k - 1) / edge); c++) {
                int first_k = c * edge, count_k = min(edge, n_k - first_k);
                real dz = outside(z[at], z0, first_k, count_k, size);
                for (int b = max(j_here - ring, 0); b <= min(j_here + ring, (n_j - 1) / edge); b++) {
                    int first_j = b * edge, count_j = min(edge, n_j - first_j);
                    real dy = outside(y[at], y0, first_j, count_j, size);
                    bool whole = max(abs(c - k_here), abs(b - j_here)) == ring; // else its two ends alone are of the ring
                    for (int a = i_here - ring; a <= min(i_here + ring, (n_i - 1) / edge); a += whole ? 1 : 2 * ring) {
                        int first_i = a * edge, count_i = min(edge, n_i - first_i);
                        int bin = (first_k * n_j + first_j) * n_i + first_i;
                        if (a < 0 || (edge == 1 && start[bin] == start[bin + 1])) // most are empty
                            continue;
                        real dx = outside(x[at], x0, first_i, count_i, size);
                        if (dx * dx + dy * dy + dz * dz > found.squared)
                            continue;
                        for (int row = 0; row < count_j * count_k; row++) {
                            int begin = bin + (row / count_j * n_j + row % count_j) * n_i;
                            look_through(p, start[begin], start[begin + count_i], corners, balls, n_listed, &found);
                        }
                    }
                }
            }
            real reach = (real)(ring * edge) * size;
            going = found.squared > off + reach * reach;
        }
    }
    distance[at] = found.chosen >= 0 ? found.away : (real)-1;
    triangle[at] = found.chosen >= 0 ? listed[found.chosen] : -1;
}
