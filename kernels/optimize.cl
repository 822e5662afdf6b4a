// Better hexes by moving nodes: nodes that slide on a level set, and moves of single nodes that raise the worst corner round
// them; the energy that they descend is in energy.cl.
//
// Coordinates are planes (3, n). `nodes` is (8, m): plane a holds the number of vertex a of each element, in VTK's order.
// `start` (n + 1) and `slots` say where the elements of each node are: slot a m + e for vertex a of element e.
// `slack` (n) says how far a node may be from the zero level: FREE or more lets it go anywhere, below 0 it stays.
// `volume` samples one level or more, one after another; `levels` (2, n) says which one holds each node, and the second one
// of a node on the curve where two meet, else -1. `to_index` is the row-major 3x4 map from coordinates to the index (i, j, k).

#define FREE ((real)1e6)
#define TINY ((real)1e-20)
#define NEWTON_STEPS 3

// out = x + a d, no node farther than `cap` times its `size` (n).
__kernel void move(__global const real *x, __global const real *d, int n, real a, real cap, __global const real *size,
                   __global real *out)
{
    int i = get_global_id(0);
    if (i >= n)
        return;
    size_t second = (size_t)n + i, third = 2 * (size_t)n + i;
    real dx = a * d[i], dy = a * d[second], dz = a * d[third];
    real length = sqrt(dx * dx + dy * dy + dz * dz);
    real most = cap * size[i], share = length > most ? most / length : 1;
    out[i] = x[i] + share * dx;
    out[second] = x[second] + share * dy;
    out[third] = x[third] + share * dz;
}

typedef struct { real x, y, z; } point;

// The level at p and its gradient.
inline real level_at(__global const real *volume, int n_i, int n_j, int n_k, __global const real *m, point p, point *g)
{
    real ti = m[0] * p.x + m[1] * p.y + m[2] * p.z + m[3];
    real tj = m[4] * p.x + m[5] * p.y + m[6] * p.z + m[7];
    real tk = m[8] * p.x + m[9] * p.y + m[10] * p.z + m[11];
    ti = fmin(fmax(ti, (real)0), (real)(n_i - 1));
    tj = fmin(fmax(tj, (real)0), (real)(n_j - 1));
    tk = fmin(fmax(tk, (real)0), (real)(n_k - 1));
    int i = min((int)ti, n_i - 2), j = min((int)tj, n_j - 2), k = min((int)tk, n_k - 2);
    real a = ti - i, b = tj - j, c = tk - k;
    __global const real *near = volume + ((size_t)k * n_j + j) * n_i + i, *far = near + (size_t)n_i * n_j;
    real d00 = near[1] - near[0], d10 = near[n_i + 1] - near[n_i];
    real d01 = far[1] - far[0], d11 = far[n_i + 1] - far[n_i];
    real e00 = near[0] + a * d00, e10 = near[n_i] + a * d10, e01 = far[0] + a * d01, e11 = far[n_i] + a * d11;
    real f0 = e00 + b * (e10 - e00), f1 = e01 + b * (e11 - e01);
    real gi = (1 - c) * (d00 + b * (d10 - d00)) + c * (d01 + b * (d11 - d01));
    real gj = (1 - c) * (e10 - e00) + c * (e11 - e01), gk = f1 - f0;
    g->x = m[0] * gi + m[4] * gj + m[8] * gk;
    g->y = m[1] * gi + m[5] * gj + m[9] * gk;
    g->z = m[2] * gi + m[6] * gj + m[10] * gk;
    return f0 + c * (f1 - f0);
}

// Brings p within `slack` of the zero level; `normal` points out of what is allowed, and is 0 inside of it.
inline point held(__global const real *volume, int n_i, int n_j, int n_k, __global const real *m, point p, real slack,
                  point *normal)
{
    point g = {0, 0, 0};
    real side = 0;
    for (int step = 0; step < NEWTON_STEPS; step++) {
        real phi = level_at(volume, n_i, n_j, n_k, m, p, &g);
        real off = phi - fmin(fmax(phi, -slack), slack);
        if (off != 0)
            side = off > 0 ? 1 : -1;
        real share = off / fmax(g.x * g.x + g.y * g.y + g.z * g.z, (real)0.04);
        p.x -= share * g.x;
        p.y -= share * g.y;
        p.z -= share * g.z;
    }
    if (slack == 0)
        side = 1;
    real scale = side * rsqrt(fmax(g.x * g.x + g.y * g.y + g.z * g.z, TINY));
    normal->x = scale * g.x;
    normal->y = scale * g.y;
    normal->z = scale * g.z;
    return p;
}

// The same on the level `one`, and where `other` is not negative on both levels: `normal` is the curve's direction then,
// or with slack that of a level whose end is reached.
inline point held_on(__global const real *volume, int n_i, int n_j, int n_k, __global const real *m, int one, int other,
                     point p, real slack, point *normal)
{
    size_t size = (size_t)n_i * n_j * n_k;
    p = held(volume + one * size, n_i, n_j, n_k, m, p, slack, normal);
    if (other < 0)
        return p;
    point a, b;
    for (int turn = 0; turn < 2; turn++) {
        p = held(volume + other * size, n_i, n_j, n_k, m, p, slack, &b);
        p = held(volume + one * size, n_i, n_j, n_k, m, p, slack, &a);
    }
    if (slack > 0) {
        *normal = a.x != 0 || a.y != 0 || a.z != 0 ? a : b;
        return p;
    }
    point along = {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
    real scale = rsqrt(fmax(along.x * along.x + along.y * along.y + along.z * along.z, TINY));
    normal->x = scale * along.x;
    normal->y = scale * along.y;
    normal->z = scale * along.z;
    return p;
}

// Brings nodes back to within their slack of the zero level, and gives the normals (3, n) there, 0 for those that are free.
__kernel void slide(__global real *x, int n, __global const real *slack, __global const int *levels,
                    __global const real *volume, int n_i, int n_j, int n_k, __global const real *to_index,
                    __global real *normal)
{
    int i = get_global_id(0);
    if (i >= n)
        return;
    size_t second = (size_t)n + i, third = 2 * (size_t)n + i;
    point out = {0, 0, 0};
    if (slack[i] >= 0 && slack[i] < FREE) {
        point p = {x[i], x[second], x[third]};
        p = held_on(volume, n_i, n_j, n_k, to_index, levels[i], levels[second], p, slack[i], &out);
        x[i] = p.x;
        x[second] = p.y;
        x[third] = p.z;
    }
    normal[i] = out.x;
    normal[second] = out.y;
    normal[third] = out.z;
}

inline point at_node(__global const real *x, int n, int node)
{
    point p = {x[node], x[(size_t)n + node], x[2 * (size_t)n + node]};
    return p;
}

inline point toward(point from, point to)
{
    real dx = to.x - from.x, dy = to.y - from.y, dz = to.z - from.z;
    real scale = rsqrt(fmax(dx * dx + dy * dy + dz * dz, TINY));
    point e = {scale * dx, scale * dy, scale * dz};
    return e;
}

inline real determinant(point a, point b, point c)
{
    return a.x * (b.y * c.z - b.z * c.y) + a.y * (b.z * c.x - b.x * c.z) + a.z * (b.x * c.y - b.y * c.x);
}

inline int vtk_corner(int bits) // bits a + 2 b + 4 c of a corner at (a, b, c), and back
{
    return bits ^ (bits >> 1 & 1);
}

// Least scaled Jacobian of the corners that a node at p would have a part in.
inline real least_round(__global const real *x, int n, __global const int *nodes, int m, __global const int *slots,
                        int begin, int end, point p)
{
    real least = 2;
    for (int s = begin; s < end; s++) {
        int e = slots[s] % m, own = vtk_corner(slots[s] / m);
        real sign = (own ^ own >> 1 ^ own >> 2) & 1 ? -1 : 1;
        point u = at_node(x, n, nodes[(size_t)vtk_corner(own ^ 1) * m + e]);
        point v = at_node(x, n, nodes[(size_t)vtk_corner(own ^ 2) * m + e]);
        point w = at_node(x, n, nodes[(size_t)vtk_corner(own ^ 4) * m + e]);
        point uv = at_node(x, n, nodes[(size_t)vtk_corner(own ^ 3) * m + e]);
        point uw = at_node(x, n, nodes[(size_t)vtk_corner(own ^ 5) * m + e]);
        point vw = at_node(x, n, nodes[(size_t)vtk_corner(own ^ 6) * m + e]);
        point pu = toward(p, u), pv = toward(p, v), pw = toward(p, w);
        least = fmin(least, sign * determinant(pu, pv, pw));
        least = fmin(least, sign * determinant(pu, toward(u, uv), toward(u, uw)));
        least = fmin(least, sign * determinant(toward(v, uv), pv, toward(v, vw)));
        least = fmin(least, sign * determinant(toward(w, uw), toward(w, vw), pw));
    }
    return least;
}

// Moves each of the nodes `moved` (count), no two of which share an element, to raise the least scaled Jacobian of the
// corners it has a part in, to `floor` if it can: the best of 14 directions, again from there, `step` times the node's `size`
// halved `halvings` times where none helps.
__kernel void improve(__global real *x, int n, __global const int *nodes, int m, __global const int *start,
                      __global const int *slots, __global const real *slack, __global const int *levels,
                      __global const int *moved, int begin, int count, real floor, real step, __global const real *size, int halvings, int tries,
                      __global const real *volume, int n_i, int n_j, int n_k, __global const real *to_index)
{
    int item = get_global_id(0);
    if (item >= count)
        return;
    int i = moved[begin + item];
    real loose = slack[i];
    if (loose < 0)
        return;
    int first = start[i], last = start[i + 1];
    step *= size[i];
    point p = at_node(x, n, i);
    real least = least_round(x, n, nodes, m, slots, first, last, p);
    for (int turn = 0, halved = 0; turn < tries && halved <= halvings && least < floor; turn++) {
        point best = p;
        real best_least = least;
        for (int way = 0; way < 14; way++) {
            // six along the axes, eight along the diagonals
            real a = way < 6 ? step : step * (real)0.57735027;
            point q = p, normal;
            int bits = way - 6;
            real sign = way & 1 ? -1 : 1;
            q.x += way < 6 ? (way / 2 == 0 ? sign * a : 0) : (bits & 1 ? a : -a);
            q.y += way < 6 ? (way / 2 == 1 ? sign * a : 0) : (bits & 2 ? a : -a);
            q.z += way < 6 ? (way / 2 == 2 ? sign * a : 0) : (bits & 4 ? a : -a);
            if (loose < FREE)
                q = held_on(volume, n_i, n_j, n_k, to_index, levels[i], levels[(size_t)n + i], q, loose, &normal);
            real value = least_round(x, n, nodes, m, slots, first, last, q);
            if (value > best_least) {
                best_least = value;
                best = q;
            }
        }
        if (best_least > least) {
            least = best_least;
            p = best;
        } else {
            step *= (real)0.5;
            halved++;
        }
    }
    x[i] = p.x;
    x[(size_t)n + i] = p.y;
    x[2 * (size_t)n + i] = p.z;
}
