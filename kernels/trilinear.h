// Hex8 in linear elasticity, full integration: forces against the derivatives of its 3 trilinear functions.
//
// Vertices are numbered u fastest, Gauss points w fastest. Derivatives are 12 a component: 4 along u at the Gauss points of
// v and w, u does not matter, then 4 along v, then 4 along w. The mathematics are those of elasticity.h.

// Nothing of it must round alike on both backends, as meshes must: products and sums may be fused.
#pragma OPENCL FP_CONTRACT ON

#define NEAR 0.21132486540518711775 // (1 - 1 / sqrt 3) / 2, the nearer Gauss point
#define FAR 0.78867513459481288225
#define WEIGHT 0.125

// Values at four corners (0, 0), (1, 0), (0, 1), (1, 1) to the four Gauss points in the same order; its own transpose.
inline void bilinear(realv a, realv b, realv c, realv d, realv *out)
{
    realv s = b - a, t = d - c;
    realv p = a + (realv)NEAR * s, q = a + (realv)FAR * s, r = c + (realv)NEAR * t, o = c + (realv)FAR * t;
    realv u = r - p, v = o - q;
    out[0] = p + (realv)NEAR * u;
    out[1] = q + (realv)NEAR * v;
    out[2] = p + (realv)FAR * u;
    out[3] = q + (realv)FAR * v;
}

// Derivatives of a trilinear function from its values at the vertices.
inline void derivatives(const realv *v, realv *d)
{
    bilinear(v[1] - v[0], v[3] - v[2], v[5] - v[4], v[7] - v[6], d);
    bilinear(v[2] - v[0], v[3] - v[1], v[6] - v[4], v[7] - v[5], d + 4);
    bilinear(v[4] - v[0], v[5] - v[1], v[6] - v[2], v[7] - v[3], d + 8);
}

// The transpose: what the vertices get.
inline void vertices(const realv *d, realv *out)
{
    realv u[4], v[4], w[4];
    bilinear(d[0], d[1], d[2], d[3], u);
    bilinear(d[4], d[5], d[6], d[7], v);
    bilinear(d[8], d[9], d[10], d[11], w);
    out[0] = -u[0] - v[0] - w[0];
    out[1] = u[0] - v[1] - w[1];
    out[2] = v[0] - u[1] - w[2];
    out[3] = u[1] + v[1] - w[3];
    out[4] = w[0] - u[2] - v[2];
    out[5] = u[2] - v[3] + w[1];
    out[6] = v[2] - u[3] + w[2];
    out[7] = u[3] + v[3] + w[3];
}

inline realv dot3(realv a, realv b, realv c, realv x, realv y, realv z)
{
    return a * x + b * y + c * z;
}

// What the stress at Gauss point g gives against the derivatives, added to f.
inline void add_forces(const realv *x, const realv *h, realv *f, int g, realv lambda, realv mu)
{
    int i = g >> 2, j = (g >> 1) & 1, k = g & 1, u = j + 2 * k, v = 4 + i + 2 * k, w = 8 + i + 2 * j;
    realv xu = x[u], xv = x[v], xw = x[w], yu = x[12 + u], yv = x[12 + v], yw = x[12 + w];
    realv zu = x[24 + u], zv = x[24 + v], zw = x[24 + w];
    realv a0 = yv * zw - yw * zv, a1 = zv * xw - zw * xv, a2 = xv * yw - xw * yv; // rows of A
    realv b0 = yw * zu - yu * zw, b1 = zw * xu - zu * xw, b2 = xw * yu - xu * yw;
    realv c0 = yu * zv - yv * zu, c1 = zu * xv - zv * xu, c2 = xu * yv - xv * yu;
    realv factor = (realv)WEIGHT / dot3(xu, yu, zu, a0, a1, a2), shear = factor * mu, twice = shear + shear;
    realv hu = h[u], hv = h[v], hw = h[w];
    realv xx = dot3(hu, hv, hw, a0, b0, c0), xy = dot3(hu, hv, hw, a1, b1, c1), xz = dot3(hu, hv, hw, a2, b2, c2);
    hu = h[12 + u], hv = h[12 + v], hw = h[12 + w];
    realv yy = dot3(hu, hv, hw, a1, b1, c1), yz = dot3(hu, hv, hw, a2, b2, c2);
    xy += dot3(hu, hv, hw, a0, b0, c0);
    hu = h[24 + u], hv = h[24 + v], hw = h[24 + w];
    realv zz = dot3(hu, hv, hw, a2, b2, c2);
    xz += dot3(hu, hv, hw, a0, b0, c0);
    yz += dot3(hu, hv, hw, a1, b1, c1);
    realv pressure = factor * lambda * (xx + yy + zz);
    xx = pressure + twice * xx, yy = pressure + twice * yy, zz = pressure + twice * zz;
    yz *= shear, xz *= shear, xy *= shear;
    f[u] += dot3(xx, xy, xz, a0, a1, a2);
    f[v] += dot3(xx, xy, xz, b0, b1, b2);
    f[w] += dot3(xx, xy, xz, c0, c1, c2);
    f[12 + u] += dot3(xy, yy, yz, a0, a1, a2);
    f[12 + v] += dot3(xy, yy, yz, b0, b1, b2);
    f[12 + w] += dot3(xy, yy, yz, c0, c1, c2);
    f[24 + u] += dot3(xz, yz, zz, a0, a1, a2);
    f[24 + v] += dot3(xz, yz, zz, b0, b1, b2);
    f[24 + w] += dot3(xz, yz, zz, c0, c1, c2);
}

// Forces f against the derivatives (36) of LANES elements from those of places and of displacements; moduli of one Gauss
// point are `step` from those of the next.
inline void stressed(const realv *x, const realv *h, realv *f, __global const real *lam, __global const real *mu,
                     size_t step)
{
    for (int q = 0; q < 36; q++)
        f[q] = 0;
    for (int g = 0; g < 8; g++)
        add_forces(x, h, f, g, load(lam, g * step), load(mu, g * step));
}
