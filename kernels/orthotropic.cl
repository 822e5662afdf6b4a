// Linear elasticity of hexes of orthotropic material, one an element: what stress gives against the parameters.
//
// With Q, symmetric, whose axes are the material's and whose values are fourth roots of its moduli, the stress of a strain
// e is Q C(Q e Q) Q, where C is isotropic with a modulus of 1. Layouts and the rest as in elasticity.h; flux_forces of
// isoparametric.cl takes the fluxes on.

#include "elasticity.h"

// Fluxes (points, 3, 3, m); `roots` (6, m) are Q: xx, yy, zz, yz, xz, xy; lam and mu (m), of a modulus of 1.
__kernel __attribute__((vec_type_hint(realv)))
void fluxes(__global const real *points, __global const real *displacement, int n, __global const int *nodes, int k,
            int m, __global const real *slopes, __global const real *weights, int n_points,
            __global const real *roots, __global const real *lam, __global const real *mu, __global real *out)
{
    size_t second = m, third = 2 * second, fourth = 3 * second, fifth = 4 * second, sixth = 5 * second;
    FOR_LANES(e, m) {
        realv x[3 * MOST_NODES], u[3 * MOST_NODES], t[9], A[9], H[9], G[9], S[9];
        realv yz = load(roots, fourth + e), xz = load(roots, fifth + e), xy = load(roots, sixth + e);
        realv Q[9] = {load(roots, e), xy, xz, xy, load(roots, second + e), yz, xz, yz, load(roots, third + e)};
        realv lambda = load(lam, e), shear = load(mu, e);
        values_of(n, points, nodes, k, m, e, x);
        values_of(n, displacement, nodes, k, m, e, u);
        for (int g = 0; g < n_points; g++) {
            tangents(g, slopes, k, x, t);
            tangents(g, slopes, k, u, H);
            realv inverse = 1 / cofactors(t, A);
            times(H, A, S);
            for (int c = 0; c < 9; c++)
                S[c] *= inverse;
            times(Q, S, H);
            times(H, Q, G);
            realv pressure = lambda * (G[0] + G[4] + G[8]);
            for (int r = 0; r < 3; r++)
                for (int c = 0; c < 3; c++)
                    S[3 * r + c] = shear * (G[3 * r + c] + G[3 * c + r]) + (r == c ? pressure : (realv)0);
            times(Q, S, H);
            times(H, Q, S);
            for (int c = 0; c < 3; c++)
                for (int d = 0; d < 3; d++) {
                    realv f = S[3 * c] * A[3 * d] + S[3 * c + 1] * A[3 * d + 1] + S[3 * c + 2] * A[3 * d + 2];
                    store(weights[g] * f, out, (size_t)(9 * g + 3 * c + d) * m + e, m - e);
                }
        }
    }
}
