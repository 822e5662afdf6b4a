// Piecewise power law from HU to density, Young's modulus and Poisson's ratio (the form of eqs 3.6 and 3.7).

// Piece q holds lower[q] <= HU < upper[q] (the last one its upper end too): E = factor rho^exponent + offset in MPa with
// rho = slope HU + intercept in g/cm3 by the last of the density's lines that starts at or below HU. HU outside every
// piece: policy 0 moves it to the nearest end of a range, policy 1 keeps its density and gives the floor values. `piece`
// is the index used, or -1 - index where HU was outside.
#define TINY 1e-30 // for a density of 0

__kernel __attribute__((vec_type_hint(realv)))
void power_law(__global const real *hu, __global const real *lower, __global const real *upper,
               __global const real *factor, __global const real *exponent, __global const real *offset,
               __global const real *poisson, int n_pieces, __global const real *line_start,
               __global const real *line_slope, __global const real *line_intercept, int n_lines, int policy,
               real floor_modulus, real floor_poisson, int n, __global real *density, __global real *modulus,
               __global real *poisson_out, __global int *piece)
{
    FOR_LANES(i, n) {
        realv value = load(hu, i), nearest = 0, gap = INFINITY, used = 0;
        realv f = 0, e = 0, o = 0, nu = 0;
        for (int q = 0; q < n_pieces; q++) {
            realv end = clamp(value, (realv)lower[q], (realv)upper[q]);
            bool closed = q == n_pieces - 1;
            // inside is nearer than touching: an upper end belongs to the piece that begins there
            realv away = fabs(value - end);
            away = value >= lower[q] && (closed ? value <= upper[q] : value < upper[q]) ? (realv)-1 : away;
            nearest = away < gap ? end : nearest;
            used = away < gap ? (realv)q : used;
            f = away < gap ? (realv)factor[q] : f;
            e = away < gap ? (realv)exponent[q] : e;
            o = away < gap ? (realv)offset[q] : o;
            nu = away < gap ? (realv)poisson[q] : nu;
            gap = fmin(away, gap);
        }
        if (policy == 0)
            value = nearest;
        realv slope = line_slope[0], intercept = line_intercept[0];
        for (int q = 1; q < n_lines; q++) {
            slope = value >= line_start[q] ? (realv)line_slope[q] : slope;
            intercept = value >= line_start[q] ? (realv)line_intercept[q] : intercept;
        }
        realv rho = fmax(slope * value + intercept, (realv)0);
        realv e_modulus = f * exp2(e * log2(fmax(rho, (realv)TINY))) + o; // half the work of pow, a few bits less
        int count = n - i;
        store(rho, density, i, count);
        store(policy == 1 && gap >= 0 ? (realv)floor_modulus : e_modulus, modulus, i, count);
        store(policy == 1 && gap >= 0 ? (realv)floor_poisson : nu, poisson_out, i, count);
        store_int(to_intv(gap < 0 ? used : -1 - used), piece, i, count);
    }
}
