// Linear elasticity of hexes: the forces of every element on its nodes, K u, without any matrix.
//
// Vectors are component planes, x[], y[], z[] of n nodes each. `nodes` is (k, m): plane a holds the number of vertex a of
// each element, in VTK's order. Lame's moduli are given at the Gauss points, (points, m), in MPa; Gauss points run along
// w fastest. What an element gives its nodes is (3, k, m): nodal.cl sums it node by node.
//
// With the tangents t_d = dx/dt_d the inverse of the Jacobian is A / det, where A's rows are t_1 x t_2, t_2 x t_0 and
// t_0 x t_1. A displacement gradient H along the parameters is H A / det in space, and a stress S gives S A^T, times the
// weight, against the parameters' derivatives of the shape functions.

#define MOST_NODES 27
#define FULL 0
#define INCOMPATIBLE 1 // with three quadratic modes a component. Source: Taylor, Beresford and Wilson 1976
#define BBAR 2         // with the mean dilatation. Source: Hughes 1980
#define GAUSS 0.21132486540518711775 // (1 - 1 / sqrt 3) / 2
#define WEIGHT 0.125

inline realv gathered(__global const real *plane, __global const int *nodes, int m, int first)
{
#if LANES == 8 // lane by lane into a register: vectors put together in memory wait for it
    if (first + 8 <= m) {
        __global const int *at = nodes + first;
        return (realv)(plane[at[0]], plane[at[1]], plane[at[2]], plane[at[3]], plane[at[4]], plane[at[5]], plane[at[6]],
                       plane[at[7]]);
    }
#endif
    union { realv v; real lane[LANES]; } parts;
    for (int lane = 0; lane < LANES; lane++)
        parts.lane[lane] = plane[nodes[min(first + lane, m - 1)]];
    return parts.v;
}

// A by rows from the tangents t[component * 3 + direction]; gives the determinant.
inline realv cofactors(const realv *t, realv *A)
{
    for (int d = 0; d < 3; d++) {
        int e = (d + 1) % 3, f = (d + 2) % 3;
        A[3 * d] = t[3 + e] * t[6 + f] - t[6 + e] * t[3 + f];
        A[3 * d + 1] = t[6 + e] * t[f] - t[e] * t[6 + f];
        A[3 * d + 2] = t[e] * t[3 + f] - t[3 + e] * t[f];
    }
    return t[0] * A[0] + t[3] * A[1] + t[6] * A[2];
}

// H A: times 1 / det the gradient in space, by rows of the component.
inline void spread(const realv *H, const realv *A, realv *G)
{
    for (int c = 0; c < 3; c++)
        for (int l = 0; l < 3; l++)
            G[3 * c + l] = H[3 * c] * A[l] + H[3 * c + 1] * A[3 + l] + H[3 * c + 2] * A[6 + l];
}

// Stress (xx, yy, zz, yz, xz, xy) of a gradient G / det.
inline void stress(const realv *G, realv inverse, realv lambda, realv mu, realv *S)
{
    realv twice = 2 * mu * inverse, pressure = lambda * inverse * (G[0] + G[4] + G[8]);
    S[0] = pressure + twice * G[0];
    S[1] = pressure + twice * G[4];
    S[2] = pressure + twice * G[8];
    S[3] = (realv)0.5 * twice * (G[5] + G[7]);
    S[4] = (realv)0.5 * twice * (G[2] + G[6]);
    S[5] = (realv)0.5 * twice * (G[1] + G[3]);
}

// S times a row of A.
inline void traction(const realv *S, const realv *row, realv *t)
{
    t[0] = S[0] * row[0] + S[5] * row[1] + S[4] * row[2];
    t[1] = S[5] * row[0] + S[1] * row[1] + S[3] * row[2];
    t[2] = S[4] * row[0] + S[3] * row[1] + S[2] * row[2];
}

// Values at four corners (0, 0), (1, 0), (0, 1), (1, 1) to the four Gauss points in the same order; its own transpose.
inline void bilinear(realv a, realv b, realv c, realv d, realv *out)
{
    realv s = (realv)GAUSS * (b - a), t = (realv)GAUSS * (d - c);
    realv p = a + s, q = b - s, r = c + t, o = d - t;
    realv u = (realv)GAUSS * (r - p), v = (realv)GAUSS * (o - q);
    out[0] = p + u;
    out[1] = q + v;
    out[2] = r - u;
    out[3] = o - v;
}

// Derivatives of a trilinear function along each parameter, which does not depend on that parameter: 3 x 4 values at the
// Gauss points of the other two.
inline void derivatives(const realv *v, realv *d)
{
    bilinear(v[1] - v[0], v[2] - v[3], v[5] - v[4], v[6] - v[7], d);
    bilinear(v[3] - v[0], v[2] - v[1], v[7] - v[4], v[6] - v[5], d + 4);
    bilinear(v[4] - v[0], v[5] - v[1], v[7] - v[3], v[6] - v[2], d + 8);
}

// The transpose.
inline void vertices(const realv *d, realv *v)
{
    realv u[4], w[4], t[4];
    bilinear(d[0], d[1], d[2], d[3], u);
    bilinear(d[4], d[5], d[6], d[7], w);
    bilinear(d[8], d[9], d[10], d[11], t);
    v[0] = -u[0] - w[0] - t[0];
    v[1] = u[0] - w[1] - t[1];
    v[2] = u[1] + w[1] - t[3];
    v[3] = -u[1] + w[0] - t[2];
    v[4] = -u[2] - w[2] + t[0];
    v[5] = u[2] - w[3] + t[1];
    v[6] = u[3] + w[3] + t[3];
    v[7] = -u[3] + w[2] + t[2];
}

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
        spread(H, A, G);
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
        spread(H, A, G);
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
        spread(H, A, G);
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
            v[a] = gathered(planes + (size_t)c * n, nodes + (size_t)a * m, m, e);
        derivatives(v, d + 12 * c);
    }
}

// Forces (3, 8, m) of hex8 elements on their nodes, 2 x 2 x 2 Gauss points. `inverse_modes` is (9, 9, m), the inverse of
// `hex8_modes`, where the formulation has modes.
__kernel __attribute__((vec_type_hint(realv)))
void hex8_forces(__global const real *points, __global const real *displacement, int n, __global const int *nodes, int m,
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
                store(v[a], forces, (size_t)(8 * c + a) * m + e, m - e);
        }
    }
}

// Stiffness (9, 9, m) of the incompatible modes, mode by component.
__kernel __attribute__((vec_type_hint(realv)))
void hex8_modes(__global const real *points, int n, __global const int *nodes, int m, __global const real *lam,
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

// Tangents at one Gauss point from `slopes` (points, k, 3), the derivatives of the shape functions.
inline void tangents(int g, __global const real *slopes, int k, const realv *values, realv *t)
{
    for (int q = 0; q < 9; q++)
        t[q] = 0;
    slopes += (size_t)g * k * 3;
    for (int a = 0; a < k; a++)
        for (int d = 0; d < 3; d++) {
            real slope = slopes[3 * a + d];
            for (int c = 0; c < 3; c++)
                t[3 * c + d] += slope * values[3 * a + c];
        }
}

inline void values_of(int n, __global const real *planes, __global const int *nodes, int k, int m, int e, realv *values)
{
    for (int a = 0; a < k; a++)
        for (int c = 0; c < 3; c++)
            values[3 * a + c] = gathered(planes + (size_t)c * n, nodes + (size_t)a * m, m, e);
}

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
            spread(H, A, G);
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
