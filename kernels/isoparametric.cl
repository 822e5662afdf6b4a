// Linear elasticity of hexes of any order: the forces of every element on its nodes, K u, by way of its Gauss points.
// Layouts and the mathematics are those of elasticity.h.

#include "elasticity.h"

// Determinants (points, m) of the Jacobian, mm3.
__kernel __attribute__((vec_type_hint(realv)))
void jacobians(__global const real *points, int n, __global const int *nodes, int k, int m, __global const real *slopes,
               int n_points, __global real *out)
{
    FOR_LANES(e, m) {
        realv x[3 * MOST_NODES], t[9], A[9];
        values_of(n, points, nodes, k, m, e, x);
        for (int g = 0; g < n_points; g++) {
            tangents(g, slopes, k, x, t);
            store(cofactors(t, A), out, (size_t)g * m + e, m - e);
        }
    }
}

// What the stress at each Gauss point gives against the parameters' derivatives, (points, 3, 3, m): any element type.
__kernel __attribute__((vec_type_hint(realv)))
void fluxes(__global const real *points, __global const real *displacement, int n, __global const int *nodes, int k,
            int m, __global const real *slopes, __global const real *weights, int n_points, __global const real *lam,
            __global const real *mu, __global real *out)
{
    FOR_LANES(e, m) {
        realv x[3 * MOST_NODES], u[3 * MOST_NODES], t[9], A[9], H[9], G[9], S[6], f[3];
        values_of(n, points, nodes, k, m, e, x);
        values_of(n, displacement, nodes, k, m, e, u);
        for (int g = 0; g < n_points; g++) {
            tangents(g, slopes, k, x, t);
            tangents(g, slopes, k, u, H);
            realv inverse = 1 / cofactors(t, A);
            times(H, A, G);
            stress(G, inverse, load(lam, (size_t)g * m + e), load(mu, (size_t)g * m + e), S);
            for (int d = 0; d < 3; d++) {
                traction(S, A + 3 * d, f);
                for (int c = 0; c < 3; c++)
                    store(weights[g] * f[c], out, (size_t)(9 * g + 3 * c + d) * m + e, m - e);
            }
        }
    }
}

// Forces (3, k, m) from the fluxes; launched over (k, m).
__kernel __attribute__((vec_type_hint(realv)))
void flux_forces(__global const real *fluxes, __global const real *slopes, int n_points, int k, int m,
                 __global real *forces)
{
    int a = get_global_id(1);
    FOR_LANES(e, m) {
        realv f[3] = {0, 0, 0};
        for (int g = 0; g < n_points; g++)
            for (int d = 0; d < 3; d++) {
                real slope = slopes[(size_t)(g * k + a) * 3 + d];
                for (int c = 0; c < 3; c++)
                    f[c] += slope * load(fluxes, (size_t)(9 * g + 3 * c + d) * m + e);
            }
        for (int c = 0; c < 3; c++)
            store(f[c], forces, (size_t)(c * k + a) * m + e, m - e);
    }
}

// Stiffness of each node against itself, (6, k, m): xx, yy, zz, yz, xz, xy; launched over (k, m). Incompatible modes and
// mean dilatation, which make an element softer, are left out.
__kernel __attribute__((vec_type_hint(realv)))
void own_stiffness(__global const real *points, int n, __global const int *nodes, int k, int m,
                   __global const real *slopes, __global const real *weights, int n_points,
                   __global const real *lam, __global const real *mu, __global real *out)
{
    int a = get_global_id(1);
    FOR_LANES(e, m) {
        realv x[3 * MOST_NODES], t[9], A[9], s[6] = {0, 0, 0, 0, 0, 0};
        values_of(n, points, nodes, k, m, e, x);
        for (int g = 0; g < n_points; g++) {
            tangents(g, slopes, k, x, t);
            realv factor = weights[g] / cofactors(t, A), b[3];
            __global const real *slope = slopes + (size_t)(g * k + a) * 3;
            for (int c = 0; c < 3; c++)
                b[c] = slope[0] * A[c] + slope[1] * A[3 + c] + slope[2] * A[6 + c];
            realv second = factor * load(mu, (size_t)g * m + e);
            realv both = factor * load(lam, (size_t)g * m + e) + second;
            realv square = second * (b[0] * b[0] + b[1] * b[1] + b[2] * b[2]);
            s[0] += both * b[0] * b[0] + square;
            s[1] += both * b[1] * b[1] + square;
            s[2] += both * b[2] * b[2] + square;
            s[3] += both * b[1] * b[2];
            s[4] += both * b[0] * b[2];
            s[5] += both * b[0] * b[1];
        }
        for (int c = 0; c < 6; c++)
            store(s[c], out, (size_t)(c * k + a) * m + e, m - e);
    }
}
