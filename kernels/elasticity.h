// Linear elasticity of hexes, element by element: what the kernels of hex8.cl, isoparametric.cl and orthotropic.cl share.
//
// Vectors are component planes, x[], y[], z[] of n nodes each. `nodes` is (k, m): plane a holds the number of vertex a of
// each element, in VTK's order. Lame's moduli are given at the Gauss points, (points, m), in MPa; Gauss points run along
// w fastest. What an element gives its nodes is (3, k, m): nodal.cl sums it node by node.
//
// With the tangents t_d = dx/dt_d the inverse of the Jacobian is A / det, where A's rows are t_1 x t_2, t_2 x t_0 and
// t_0 x t_1. A displacement gradient H along the parameters is H A / det in space, and a stress S gives S A^T, times the
// weight, against the parameters' derivatives of the shape functions.

#define MOST_NODES 27

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

// out = X Y, 3 x 3 by rows; H A is det times the gradient in space.
inline void times(const realv *X, const realv *Y, realv *out)
{
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++)
            out[3 * r + c] = X[3 * r] * Y[c] + X[3 * r + 1] * Y[3 + c] + X[3 * r + 2] * Y[6 + c];
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
