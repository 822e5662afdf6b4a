// Piecewise power law from HU to density, Young's modulus and Poisson's ratio (the form of eqs 3.6 and 3.7).

// Piece q holds lower[q] <= HU < upper[q] (the last one its upper end too): E = factor rho^exponent + offset in MPa with
// rho = slope HU + intercept in g/cm3. HU outside every piece: policy 0 moves it to the nearest end of a range, policy 1
// keeps its density and gives the floor values. `piece` is the index used, or -1 - index where HU was outside.
__kernel void power_law(__global const real *hu, __global const real *lower, __global const real *upper,
                        __global const real *factor, __global const real *exponent, __global const real *offset,
                        __global const real *poisson, int n_pieces, real density_slope, real density_intercept,
                        int policy, real floor_modulus, real floor_poisson, int n, __global real *density,
                        __global real *modulus, __global real *poisson_out, __global int *piece)
{
    int i = get_global_id(0);
    if (i >= n)
        return;
    real value = hu[i], nearest = 0, gap = INFINITY;
    int used = 0;
    bool inside = false;
    for (int q = 0; q < n_pieces && !inside; q++) {
        inside = value >= lower[q] && (value < upper[q] || (q == n_pieces - 1 && value == upper[q]));
        real end = clamp(value, lower[q], upper[q]);
        real away = inside ? (real)-1 : fabs(value - end);
        if (away < gap) {
            gap = away;
            nearest = end;
            used = q;
        }
    }
    bool floored = !inside && policy == 1;
    if (!inside && policy == 0)
        value = nearest;
    real rho = fmax(density_slope * value + density_intercept, (real)0);
    density[i] = rho;
    modulus[i] = floored ? floor_modulus : factor[used] * pow(rho, exponent[used]) + offset[used];
    poisson_out[i] = floored ? floor_poisson : poisson[used];
    piece[i] = inside ? used : -1 - used;
}
