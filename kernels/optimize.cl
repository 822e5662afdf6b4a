// Better elements by moving nodes: nodes that slide on what holds them, and moves of single nodes that raise the worst corner
// round them; the energy that they descend is in energy.cl.
//
// Coordinates are planes (3, n). Where there are pieces to walk on, x is (4, n): places on the flat pieces, and in the last
// plane the piece that each node is on; y (3, n) is where the curved pieces have it. Elsewhere y is x. `nodes` is (k, m):
// plane a holds the number of vertex a of each element, 4 or 8, in VTK's order. `start` (n + 1) and `slots` say where the
// elements of each node are: slot a m + e for vertex a of element e.
// `slack` (n) says how far a node may be from the zero level: FREE or more lets it go anywhere, below 0 it stays.
// `levels` (2, n) says which level holds each node, and the second one of a node on the curve where two meet, else -1; where
// there are pieces, that it is on a curve. The rest is said in hold.h.

#include "hold.h"

// out = x + a d, no node farther than `cap` times its `size` (n); planes of x beyond the third are copied.
__kernel void move(__global const real *x, int planes, __global const real *d, int n, real a, real cap,
                   __global const real *size, __global real *out)
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
    if (planes > 3)
        out[3 * (size_t)n + i] = x[3 * (size_t)n + i];
}

// Brings nodes back to within their slack of what holds them, and gives the normals (3, n) there, 0 for those that are free;
// of a curve its direction.
__kernel void slide(__global real *x, int n, __global const real *slack, __global const int *levels,
                    __global const real *volume, int n_i, int n_j, int n_k, __global const real *to_index,
                    __global const real *pieces, int n_pieces, __global const int *around_start,
                    __global const int *around, __global real *y, __global real *normal)
{
    int i = get_global_id(0);
    if (i >= n)
        return;
    size_t second = (size_t)n + i, third = 2 * (size_t)n + i;
    point out = {0, 0, 0}, p = {x[i], x[second], x[third]}, q = p;
    if (slack[i] >= 0 && slack[i] < FREE) {
        if (n_pieces > 0) {
            int piece = (int)x[3 * (size_t)n + i], is_curve = levels[second] >= 0;
            p = walked(p, pieces, n_pieces, around_start, around, is_curve, &piece);
            q = lifted(p, pieces, n_pieces, piece, is_curve, &out);
            x[3 * (size_t)n + i] = piece;
        } else {
            p = held_on(volume, n_i, n_j, n_k, to_index, levels[i], levels[second], p, slack[i], &out);
        }
        x[i] = p.x;
        x[second] = p.y;
        x[third] = p.z;
    }
    if (n_pieces > 0) {
        y[i] = q.x;
        y[second] = q.y;
        y[third] = q.z;
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
    return to_unit(minus(to, from));
}

inline real determinant(point a, point b, point c)
{
    return inner(a, outer(b, c));
}

inline int vtk_corner(int bits) // bits a + 2 b + 4 c of a corner at (a, b, c), and back
{
    return bits ^ (bits >> 1 & 1);
}

// Least scaled Jacobian of the corners of hexes that a node at p would have a part in, and of its own edges' length times
// `steep`.
inline real least_round(__global const real *x, int n, __global const int *nodes, int m, __global const int *slots,
                        int begin, int end, point p, real steep)
{
    real least = 2, short_squared = 4 / (steep * steep);
    for (int s = begin; s < end; s++) {
        int e = slots[s] % m, own = vtk_corner(slots[s] / m);
        real sign = (own ^ own >> 1 ^ own >> 2) & 1 ? -1 : 1;
        point u = at_node(x, n, nodes[(size_t)vtk_corner(own ^ 1) * m + e]);
        point v = at_node(x, n, nodes[(size_t)vtk_corner(own ^ 2) * m + e]);
        point w = at_node(x, n, nodes[(size_t)vtk_corner(own ^ 4) * m + e]);
        point uv = at_node(x, n, nodes[(size_t)vtk_corner(own ^ 3) * m + e]);
        point uw = at_node(x, n, nodes[(size_t)vtk_corner(own ^ 5) * m + e]);
        point vw = at_node(x, n, nodes[(size_t)vtk_corner(own ^ 6) * m + e]);
        short_squared = fmin(short_squared, fmin(apart(p, u), fmin(apart(p, v), apart(p, w))));
        point pu = toward(p, u), pv = toward(p, v), pw = toward(p, w);
        least = fmin(least, sign * determinant(pu, pv, pw));
        least = fmin(least, sign * determinant(pu, toward(u, uv), toward(u, uw)));
        least = fmin(least, sign * determinant(toward(v, uv), pv, toward(v, vw)));
        least = fmin(least, sign * determinant(toward(w, uw), toward(w, vw), pw));
    }
    return fmin(least, steep * sqrt(short_squared));
}

// The same of quads, all of whose corners it has a part in through the normal at the centre.
inline real least_quad(__global const real *x, int n, __global const int *nodes, int m, __global const int *slots,
                       int begin, int end, point p)
{
    real least = 2;
    for (int s = begin; s < end; s++) {
        int e = slots[s] % m, own = slots[s] / m;
        point q = at_node(x, n, nodes[(size_t)(own + 1 & 3) * m + e]);
        point r = at_node(x, n, nodes[(size_t)(own + 2 & 3) * m + e]);
        point t = at_node(x, n, nodes[(size_t)(own + 3 & 3) * m + e]);
        point normal = to_unit(outer(minus(r, p), minus(t, q)));
        point pq = toward(p, q), qr = toward(q, r), rt = toward(r, t), tp = toward(t, p);
        least = fmin(least, fmin(determinant(normal, tp, pq), determinant(normal, pq, qr)));
        least = fmin(least, fmin(determinant(normal, qr, rt), determinant(normal, rt, tp)));
    }
    return least;
}

// p moved along one of 14 ways: six along the axes, eight along the diagonals.
inline point ahead(point p, int way, real step)
{
    real a = way < 6 ? step : step * (real)0.57735027, sign = way & 1 ? -1 : 1;
    int bits = way - 6;
    p.x += way < 6 ? (way / 2 == 0 ? sign * a : 0) : (bits & 1 ? a : -a);
    p.y += way < 6 ? (way / 2 == 1 ? sign * a : 0) : (bits & 2 ? a : -a);
    p.z += way < 6 ? (way / 2 == 2 ? sign * a : 0) : (bits & 4 ? a : -a);
    return p;
}

// Moves each of the nodes `moved` (count), no two of which share an element, to raise the least scaled Jacobian of the
// corners it has a part in, to `floor` if it can: the best of 14 directions, again from there, `step` times the node's `size`
// halved `halvings` times where none helps. The length of a hex's edge at the node, times `steep` and over its `size`,
// counts as a corner does.
__kernel void improve(__global real *x, __global real *y, int n, __global const int *nodes, int k, int m,
                      __global const int *start, __global const int *slots, __global const real *slack,
                      __global const int *levels, __global const int *moved, int begin, int count, real floor,
                      real steep, real step, __global const real *size, int halvings, int tries,
                      __global const real *volume, int n_i, int n_j, int n_k, __global const real *to_index,
                      __global const real *pieces, int n_pieces,
                      __global const int *around_start, __global const int *around)
{
    int item = get_global_id(0);
    if (item >= count)
        return;
    int i = moved[begin + item];
    real loose = slack[i];
    if (loose < 0)
        return;
    int first = start[i], last = start[i + 1], walks = n_pieces > 0 && loose < FREE, is_curve = levels[(size_t)n + i] >= 0;
    int piece = walks ? (int)x[3 * (size_t)n + i] : 0;
    step *= size[i];
    steep /= size[i];
    point p = at_node(x, n, i), seen = at_node(y, n, i);
    real least = k == 4 ? least_quad(y, n, nodes, m, slots, first, last, seen)
                        : least_round(y, n, nodes, m, slots, first, last, seen, steep);
    for (int turn = 0, halved = 0; turn < tries && halved <= halvings && least < floor; turn++) {
        point best = p, best_seen = seen, normal;
        real best_least = least;
        int best_piece = piece;
        for (int way = 0; way < 14; way++) {
            point q = ahead(p, way, step), r;
            int at = piece;
            if (walks)
                q = walked(q, pieces, n_pieces, around_start, around, is_curve, &at);
            else if (loose < FREE)
                q = held_on(volume, n_i, n_j, n_k, to_index, levels[i], levels[(size_t)n + i], q, loose, &normal);
            r = walks ? lifted(q, pieces, n_pieces, at, is_curve, &normal) : q;
            real value = k == 4 ? least_quad(y, n, nodes, m, slots, first, last, r)
                                : least_round(y, n, nodes, m, slots, first, last, r, steep);
            if (value > best_least) {
                best_least = value;
                best = q;
                best_seen = r;
                best_piece = at;
            }
        }
        if (best_least > least) {
            least = best_least;
            p = best;
            seen = best_seen;
            piece = best_piece;
        } else {
            step *= (real)0.5;
            halved++;
        }
    }
    x[i] = p.x;
    x[(size_t)n + i] = p.y;
    x[2 * (size_t)n + i] = p.z;
    y[i] = seen.x;
    y[(size_t)n + i] = seen.y;
    y[2 * (size_t)n + i] = seen.z;
    if (walks)
        x[3 * (size_t)n + i] = piece;
}
