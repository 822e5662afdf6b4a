// WIDE
// Piecewise power law from HU to density, Young's modulus and Poisson's ratio (the form of eqs 3.6 and 3.7).

// Piece q holds lower[q] <= HU < upper[q] (the last one its upper end too): E = factor rho^exponent + offset in MPa with
// rho = slope HU + intercept in g/cm3 by the last of the density's lines that starts at or below HU. HU outside every
// piece: policy 0 moves it to the nearest end of a range, policy 1 keeps its density and gives the floor values. `piece`
// is the index used, or -1 - index where HU was outside.
#define TINY 1e-30 // for a density of 0
#define NEAREST 12582912.0f // 1.5 * 2^23, added and taken away: rounds to a whole number

// x^e of a positive x. In float by polynomials of least greatest error (2e-8 of log2 between sqrt(1/2) and sqrt(2), 2e-9 of
// exp2 between -1/2 and 1/2), a fourth of the work of exp2 and log2, and the same bits as in Warp.
inline realv power(realv x, realv e)
{
#if REAL_BYTES == 4
    intv bits = as_intv(x), scale = (bits - 0x3f3504f3) & (intv)0xff800000; // x = 2^(scale / 2^23) m
    realv t = as_realv(bits - scale) - 1, t2 = t * t;
    realv low = (1.4426950216293335f - 0.7213472127914429f * t) + t2 * (0.4809102714061737f - 0.3607162535190582f * t);
    realv high = (0.2879391014575958f - 0.23867568373680115f * t) +
                 t2 * ((0.21521227061748505f - 0.2089337706565857f * t) + 0.1292642056941986f * t2);
    realv power = e * (t * (low + t2 * t2 * high) + to_realv(scale >> 23)); // of 2
    power = power > -126 ? power : (realv)-126;
    power = power < 127 ? power : (realv)127;
    realv whole = (power + NEAREST) - NEAREST, f = power - whole, f2 = f * f;
    low = (1 + 0.6931471824645996f * f) + f2 * (0.24022646248340607f + 0.05550328642129898f * f);
    high = (0.009618489071726799f + 0.0013399930903688073f * f) + 0.00015345815336331725f * f2;
    return (low + f2 * f2 * high) * as_realv((to_intv(whole) + 127) << 23);
#else
    return exp2(e * log2(x));
#endif
}

ALONE __kernel __attribute__((vec_type_hint(realv)))
void power_law(__global const real *hu, __global const real *lower, __global const real *upper,
               __global const real *factor, __global const real *exponent, __global const real *offset,
               __global const real *poisson, int n_pieces, __global const real *line_start,
               __global const real *line_slope, __global const real *line_intercept, int n_lines, int policy,
               real floor_modulus, real floor_poisson, int n, __global real *density, __global real *modulus,
               __global real *poisson_out, __global int *piece)
{
    FOR_LANES(i, n) {
        realv value = load(hu, i), low = lower[0], high = upper[0], used = 0;
        realv f = factor[0], e = exponent[0], o = offset[0], nu = poisson[0];
        for (int q = 1; q < n_pieces; q++) {
            maskv later = value >= lower[q] || lower[q] - value < value - high; // in a gap: nearer to its upper end
            low = later ? (realv)lower[q] : low;
            high = later ? (realv)upper[q] : high;
            used = later ? (realv)q : used;
            f = later ? (realv)factor[q] : f;
            e = later ? (realv)exponent[q] : e;
            o = later ? (realv)offset[q] : o;
            nu = later ? (realv)poisson[q] : nu;
        }
        // an upper end belongs to the piece that begins there, the last one's to itself
        maskv inside = value >= low && (value < high || (value == high && used == n_pieces - 1));
        realv nearest = value > low ? value : low;
        nearest = nearest < high ? nearest : high;
        value = policy == 0 ? nearest : value;
        realv slope = line_slope[0], intercept = line_intercept[0];
        for (int q = 1; q < n_lines; q++) {
            slope = value >= line_start[q] ? (realv)line_slope[q] : slope;
            intercept = value >= line_start[q] ? (realv)line_intercept[q] : intercept;
        }
        realv rho = slope * value + intercept;
        rho = rho > 0 ? rho : (realv)0;
        realv e_modulus = f * power(rho > (realv)TINY ? rho : (realv)TINY, e) + o;
        int count = n - i;
        stream(rho, density, i, count);
        stream(policy == 0 || inside ? e_modulus : (realv)floor_modulus, modulus, i, count);
        stream(policy == 0 || inside ? nu : (realv)floor_poisson, poisson_out, i, count);
        stream_int(to_intv(inside ? used : -1 - used), piece, i, count);
    }
}
