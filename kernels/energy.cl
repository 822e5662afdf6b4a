// What hexes and quads lack in scaled Jacobian and in even edges, and the gradient of it by their nodes.
//
// Coordinates are planes (3, n). `nodes` is (k, m): plane a holds the number of vertex a of each element, of k = 8 or 4, in
// VTK's order.
// `start` (n + 1) and `slots` say where the elements of each node are: slot a m + e for vertex a of element e.

#define TINY ((real)1e-20)

typedef struct { realv x, y, z; } lanes3;

inline lanes3 minus(lanes3 a, lanes3 b)
{
    lanes3 c = {a.x - b.x, a.y - b.y, a.z - b.z};
    return c;
}

inline lanes3 times(realv s, lanes3 a)
{
    lanes3 b = {s * a.x, s * a.y, s * a.z};
    return b;
}

inline void add(lanes3 *a, lanes3 b)
{
    a->x += b.x;
    a->y += b.y;
    a->z += b.z;
}

inline realv inner(lanes3 a, lanes3 b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

inline lanes3 outer(lanes3 a, lanes3 b)
{
    lanes3 c = {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
    return c;
}

// Unit vector of an edge; `gradient` is that of weight (ln l^2 - target)^2, which is added to `energy`.
inline lanes3 edge(lanes3 from, lanes3 to, realv target, real weight, realv *inverse, realv *energy, lanes3 *gradient)
{
    lanes3 d = minus(to, from);
    realv squared = fmax(inner(d, d), (realv)TINY);
    *inverse = rsqrt(squared);
    lanes3 unit = times(*inverse, d);
    realv off = log(squared) - target;
    *energy += weight * off * off;
    *gradient = times(4 * weight * off * *inverse, unit);
    return unit;
}

// Adds max(0, goal - SJ)^power of one corner to the energy, and its derivatives by the three edges to their gradients.
inline void corner(lanes3 u, lanes3 v, lanes3 w, realv iu, realv iv, realv iw, real goal, int power, realv *energy,
                   lanes3 *gu, lanes3 *gv, lanes3 *gw)
{
    lanes3 vw = outer(v, w), wu = outer(w, u), uv = outer(u, v);
    realv jacobian = inner(u, vw);
    realv short_of = fmax(goal - jacobian, (realv)0), square = short_of * short_of;
    realv slope = power == 2 ? -2 * short_of : -4 * square * short_of;
    *energy += power == 2 ? square : square * square;
    add(gu, times(slope * iu, minus(vw, times(jacobian, u))));
    add(gv, times(slope * iv, minus(wu, times(jacobian, v))));
    add(gw, times(slope * iw, minus(uv, times(jacobian, w))));
}

inline lanes3 vertex(__global const real *x, int n, __global const int *nodes, int m, int first, int a)
{
    union { realv v; real lane[LANES]; } px, py, pz;
    for (int lane = 0; lane < LANES; lane++) {
        size_t node = nodes[(size_t)a * m + min(first + lane, m - 1)];
        px.lane[lane] = x[node];
        py.lane[lane] = x[n + node];
        pz.lane[lane] = x[2 * (size_t)n + node];
    }
    lanes3 p = {px.v, py.v, pz.v};
    return p;
}

inline void give(lanes3 g, __global real *gradient, int k, int m, int a, int first)
{
    size_t at = (size_t)a * m + first, plane = (size_t)k * m;
    store(g.x, gradient, at, m - first);
    store(g.y, gradient, plane + at, m - first);
    store(g.z, gradient, 2 * plane + at, m - first);
}

// Energy (m) of each hex and its gradient (3, 8, m) by its vertices: max(0, goal - SJ)^power summed over the corners, power
// 2 or 4, and weight (ln l^2 - log_lengths)^2 over the edges, log_lengths (3, m) for those along u, v and w.
__kernel __attribute__((vec_type_hint(realv)))
void hex_energy(__global const real *x, int n, __global const int *nodes, int m, __global const real *log_lengths,
                real goal, int power, real weight, __global real *energy, __global real *gradient)
{
    FOR_LANES(first, m) {
        lanes3 p[8], u[4], v[4], w[4], gu[4], gv[4], gw[4];
        realv iu[4], iv[4], iw[4], sum = 0;
        for (int a = 0; a < 8; a++)
            p[a] = vertex(x, n, nodes, m, first, a);
        realv lu = load(log_lengths, first), lv = load(log_lengths, (size_t)m + first);
        realv lw = load(log_lengths, 2 * (size_t)m + first);
        for (int c = 0; c < 2; c++) {
            int b = 4 * c, d = 2 * c;
            u[d] = edge(p[b], p[b + 1], lu, weight, &iu[d], &sum, &gu[d]);
            u[d + 1] = edge(p[b + 3], p[b + 2], lu, weight, &iu[d + 1], &sum, &gu[d + 1]);
            v[d] = edge(p[b], p[b + 3], lv, weight, &iv[d], &sum, &gv[d]);
            v[d + 1] = edge(p[b + 1], p[b + 2], lv, weight, &iv[d + 1], &sum, &gv[d + 1]);
        }
        for (int a = 0; a < 4; a++)
            w[a] = edge(p[a], p[a + 4], lw, weight, &iw[a], &sum, &gw[a]);
        for (int c = 0; c < 2; c++) {
            int d = 2 * c, e = d + 1;
            corner(u[d], v[d], w[0], iu[d], iv[d], iw[0], goal, power, &sum, &gu[d], &gv[d], &gw[0]);
            corner(u[d], v[e], w[1], iu[d], iv[e], iw[1], goal, power, &sum, &gu[d], &gv[e], &gw[1]);
            corner(u[e], v[e], w[2], iu[e], iv[e], iw[2], goal, power, &sum, &gu[e], &gv[e], &gw[2]);
            corner(u[e], v[d], w[3], iu[e], iv[d], iw[3], goal, power, &sum, &gu[e], &gv[d], &gw[3]);
        }
        store(sum, energy, first, m - first);
        lanes3 g[8];
        for (int c = 0; c < 2; c++) {
            int b = 4 * c, d = 2 * c, e = d + 1;
            g[b] = times(-1, gu[d]);
            g[b + 1] = gu[d];
            g[b + 2] = gu[e];
            g[b + 3] = times(-1, gu[e]);
            add(&g[b], times(-1, gv[d]));
            add(&g[b + 1], times(-1, gv[e]));
            add(&g[b + 2], gv[e]);
            add(&g[b + 3], gv[d]);
            for (int a = 0; a < 4; a++)
                add(&g[b + a], c ? gw[a] : times(-1, gw[a]));
        }
        for (int a = 0; a < 8; a++)
            give(g[a], gradient, 8, m, a, first);
    }
}

// Adds what the corner between two unit edges of a quad lacks, and its derivatives by the edges and by the unit normal.
inline void quad_corner(lanes3 a, lanes3 b, lanes3 normal, realv ia, realv ib, real goal, int power, realv *energy,
                        lanes3 *ga, lanes3 *gb, lanes3 *gn)
{
    lanes3 ab = outer(a, b);
    realv jacobian = inner(normal, ab);
    realv short_of = fmax(goal - jacobian, (realv)0), square = short_of * short_of;
    realv slope = power == 2 ? -2 * short_of : -4 * square * short_of;
    *energy += power == 2 ? square : square * square;
    add(ga, times(slope * ia, minus(outer(b, normal), times(jacobian, a))));
    add(gb, times(slope * ib, minus(outer(normal, a), times(jacobian, b))));
    add(gn, times(slope, ab));
}

// The same of quads in space, whose corners are measured against the normal at the centre: log_lengths (2, m), gradient
// (3, 4, m).
__kernel __attribute__((vec_type_hint(realv)))
void quad_energy(__global const real *x, int n, __global const int *nodes, int m, __global const real *log_lengths,
                 real goal, int power, real weight, __global real *energy, __global real *gradient)
{
    FOR_LANES(first, m) {
        lanes3 p[4], e[4], ge[4], gn = {0, 0, 0};
        realv inverse[4], sum = 0;
        for (int a = 0; a < 4; a++)
            p[a] = vertex(x, n, nodes, m, first, a);
        realv lu = load(log_lengths, first), lv = load(log_lengths, (size_t)m + first);
        for (int a = 0; a < 4; a++)
            e[a] = edge(p[a], p[(a + 1) & 3], a & 1 ? lv : lu, weight, &inverse[a], &sum, &ge[a]);
        lanes3 d = minus(p[2], p[0]), f = minus(p[3], p[1]), df = outer(d, f);
        realv over = rsqrt(fmax(inner(df, df), (realv)TINY));
        lanes3 normal = times(over, df);
        for (int a = 0; a < 4; a++) {
            int b = (a + 1) & 3;
            quad_corner(e[a], e[b], normal, inverse[a], inverse[b], goal, power, &sum, &ge[a], &ge[b], &gn);
        }
        store(sum, energy, first, m - first);
        gn = times(over, minus(gn, times(inner(gn, normal), normal)));
        lanes3 gd = outer(f, gn), gf = outer(gn, d);
        for (int a = 0; a < 4; a++) {
            lanes3 g = minus(ge[(a + 3) & 3], ge[a]);
            add(&g, times(a < 2 ? -1 : 1, a & 1 ? gf : gd));
            give(g, gradient, 4, m, a, first);
        }
    }
}

// Gradient (3, n) by node: the sum of what its elements gave, less what would push it off the level set or the curve.
__kernel void node_gradient(__global const real *values, int k, int m, __global const int *start, __global const int *slots,
                            __global const real *normal, __global const real *slack, __global const int *levels, int n,
                            __global real *out)
{
    int i = get_global_id(0);
    if (i >= n)
        return;
    size_t plane = (size_t)k * m, second = n, third = 2 * second;
    real gx = 0, gy = 0, gz = 0;
    for (int s = start[i], end = start[i + 1]; s < end; s++) {
        size_t at = slots[s];
        gx += values[at];
        gy += values[plane + at];
        gz += values[2 * plane + at];
    }
    real nx = normal[i], ny = normal[second + i], nz = normal[third + i];
    real off = gx * nx + gy * ny + gz * nz;
    if (slack[i] > 0 && levels[second + i] < 0) // a step back from the end of the slack is free
        off = fmin(off, (real)0);
    real moves = slack[i] < 0 ? 0 : 1, kept = moves;
    if (levels[second + i] >= 0 && slack[i] == 0) { // the normal is the curve's direction: nothing but what goes along it is left
        off = -off;
        kept = 0;
    }
    out[i] = kept * gx - moves * off * nx;
    out[second + i] = kept * gy - moves * off * ny;
    out[third + i] = kept * gz - moves * off * nz;
}
