// Linear elasticity of hex8: the forces of every element on its nodes, K u, without any matrix, 2 x 2 x 2 Gauss points.
// Layouts and the mathematics are those of elasticity.h; derivatives, with u fastest at the vertices, of trilinear.h.

#include "elasticity.h"
#include "trilinear.h"

#define FULL 0
#define INCOMPATIBLE 1 // with three quadratic modes a component. Source: Taylor, Beresford and Wilson 1976
#define BBAR 2         // with the mean dilatation. Source: Hughes 1980
#define U_FASTEST(a) ((a) ^ ((a) >> 1 & 1)) // VTK's vertex at place a, or the other way about

// The 3 x 3 derivatives, component by direction, at Gauss point g.
inline void at_point(const realv *d, int g, realv *t)
{
    int i = g >> 2, j = (g >> 1) & 1, k = g & 1;
    for (int c = 0; c < 3; c++) {
        t[3 * c] = d[12 * c + j + 2 * k];
        t[3 * c + 1] = d[12 * c + 4 + i + 2 * k];
        t[3 * c + 2] = d[12 * c + 8 + i + 2 * j];
    }
}

// Sign of parameter d at Gauss point g.
#define SIGN(g, d) ((((g) >> (2 - (d))) & 1) ? (real)1 : (real)-1)

inline void centre_cofactors(const realv *dx, realv *A)
{
    realv t[9];
    for (int q = 0; q < 9; q++)
        t[q] = (realv)0.25 * (dx[4 * q] + dx[4 * q + 1] + dx[4 * q + 2] + dx[4 * q + 3]);
    cofactors(t, A);
}

// Amplitudes of the incompatible modes, 3 x 3 mode by component, that are in balance with the displacement.
inline void amplitudes(const realv *dx, const realv *du, const realv *centre, __global const real *lam,
                       __global const real *mu, __global const real *inverse_modes, int m, int e, realv *alpha)
{
    realv r[9];
    for (int q = 0; q < 9; q++)
        r[q] = alpha[q] = 0;
    for (int g = 0; g < 8; g++) {
        realv t[9], A[9], H[9], G[9], S[6], f[3];
        at_point(dx, g, t);
        at_point(du, g, H);
        realv inverse = 1 / cofactors(t, A);
        times(H, A, G);
        stress(G, inverse, load(lam, (size_t)g * m + e), load(mu, (size_t)g * m + e), S);
        for (int mode = 0; mode < 3; mode++) {
            traction(S, centre + 3 * mode, f);
            for (int c = 0; c < 3; c++)
                r[3 * mode + c] += SIGN(g, mode) * f[c];
        }
    }
    for (int p = 0; p < 9; p++)
        for (int q = 0; q < 9; q++)
            alpha[p] -= load(inverse_modes, (size_t)(9 * p + q) * m + e) * ((realv)WEIGHT * r[q]);
}

// Mean dilatation and the pressure that it makes.
inline realv mean_pressure(const realv *dx, const realv *du, __global const real *lam, __global const real *mu, int m,
                           int e, realv *dilatation)
{
    realv volume = 0, growth = 0, bulk = 0;
    for (int g = 0; g < 8; g++) {
        realv t[9], A[9], H[9], G[9];
        at_point(dx, g, t);
        at_point(du, g, H);
        realv det = cofactors(t, A);
        times(H, A, G);
        volume += det;
        growth += G[0] + G[4] + G[8];
        bulk += det * (load(lam, (size_t)g * m + e) + (realv)(2.0 / 3.0) * load(mu, (size_t)g * m + e));
    }
    *dilatation = growth / volume;
    return *dilatation * bulk / volume;
}

// Forces against the derivatives, 3 x 3 x 4, from the derivatives of places and displacements.
inline void forces_of(const realv *dx, const realv *du, __global const real *lam, __global const real *mu,
                      int formulation, __global const real *inverse_modes, int m, int e, realv *out)
{
    realv centre[9], alpha[9], dilatation, pressure = 0;
    if (formulation == INCOMPATIBLE) {
        centre_cofactors(dx, centre);
        amplitudes(dx, du, centre, lam, mu, inverse_modes, m, e, alpha);
    }
    if (formulation == BBAR)
        pressure = mean_pressure(dx, du, lam, mu, m, e, &dilatation);
    for (int q = 0; q < 36; q++)
        out[q] = 0;
    for (int g = 0; g < 8; g++) {
        int i = g >> 2, j = (g >> 1) & 1, k = g & 1;
        realv t[9], A[9], H[9], G[9], S[6], f[3];
        at_point(dx, g, t);
        at_point(du, g, H);
        realv inverse = 1 / cofactors(t, A), second = load(mu, (size_t)g * m + e);
        times(H, A, G);
        if (formulation == INCOMPATIBLE)
            for (int c = 0; c < 3; c++)
                for (int l = 0; l < 3; l++)
                    for (int mode = 0; mode < 3; mode++)
                        G[3 * c + l] += SIGN(g, mode) * alpha[3 * mode + c] * centre[3 * mode + l];
        if (formulation == BBAR) {
            stress(G, inverse, (realv)(-2.0 / 3.0) * second, second, S);
            for (int c = 0; c < 3; c++)
                S[c] += pressure;
        } else
            stress(G, inverse, load(lam, (size_t)g * m + e), second, S);
        int place[3] = {j + 2 * k, 4 + i + 2 * k, 8 + i + 2 * j};
        for (int d = 0; d < 3; d++) {
            traction(S, A + 3 * d, f);
            for (int c = 0; c < 3; c++)
                out[12 * c + place[d]] += (realv)WEIGHT * f[c];
        }
    }
}

inline void derivatives_of(int n, __global const real *planes, __global const int *nodes, int m, int e, realv *d)
{
    for (int c = 0; c < 3; c++) {
        realv v[8];
        for (int a = 0; a < 8; a++)
            v[a] = gathered(planes + (size_t)c * n, nodes + (size_t)U_FASTEST(a) * m, m, e);
        derivatives(v, d + 12 * c);
    }
}

// Forces (3, 8, m) of hex8 elements on their nodes, 2 x 2 x 2 Gauss points. `inverse_modes` is (9, 9, m), the inverse of
// `modes`, where the formulation has modes.
__kernel __attribute__((vec_type_hint(realv)))
void forces(__global const real *points, __global const real *displacement, int n, __global const int *nodes, int m,
            __global const real *lam, __global const real *mu, int formulation,
            __global const real *inverse_modes, __global real *forces)
{
    FOR_LANES(e, m) {
        realv dx[36], du[36], out[36], v[8];
        derivatives_of(n, points, nodes, m, e, dx);
        derivatives_of(n, displacement, nodes, m, e, du);
        if (formulation == FULL) // told apart here, so that the loop over Gauss points asks nothing
            forces_of(dx, du, lam, mu, FULL, inverse_modes, m, e, out);
        else
            forces_of(dx, du, lam, mu, formulation, inverse_modes, m, e, out);
        for (int c = 0; c < 3; c++) {
            vertices(out + 12 * c, v);
            for (int a = 0; a < 8; a++)
                store(v[a], forces, (size_t)(8 * c + U_FASTEST(a)) * m + e, m - e);
        }
    }
}

// Stiffness (9, 9, m) of the incompatible modes, mode by component.
__kernel __attribute__((vec_type_hint(realv)))
void modes(__global const real *points, int n, __global const int *nodes, int m, __global const real *lam,
           __global const real *mu, __global real *modes)
{
    FOR_LANES(e, m) {
        realv dx[36], centre[9];
        derivatives_of(n, points, nodes, m, e, dx);
        centre_cofactors(dx, centre);
        for (int p = 0; p < 3; p++)
            for (int q = 0; q < 3; q++) {
                realv first = 0, second = 0;
                for (int g = 0; g < 8; g++) {
                    realv t[9], A[9];
                    at_point(dx, g, t);
                    realv factor = SIGN(g, p) * SIGN(g, q) * (realv)WEIGHT / cofactors(t, A);
                    first += factor * load(lam, (size_t)g * m + e);
                    second += factor * load(mu, (size_t)g * m + e);
                }
                const realv *a = centre + 3 * p, *b = centre + 3 * q;
                realv both = second * (a[0] * b[0] + a[1] * b[1] + a[2] * b[2]);
                for (int c = 0; c < 3; c++)
                    for (int l = 0; l < 3; l++) {
                        realv value = first * a[c] * b[l] + second * a[l] * b[c] + (c == l ? both : (realv)0);
                        store(value, modes, (size_t)(9 * (3 * p + c) + 3 * q + l) * m + e, m - e);
                    }
            }
    }
}
