// Speed of longitudinal ultrasound in an isotropic solid.

// Metres a second, from MPa, a ratio and g/cm3 (n); 0 where there is no density.
__kernel void speed(__global const real *modulus, __global const real *poisson, __global const real *density, int n,
                    __global real *out)
{
    int i = get_global_id(0);
    if (i >= n)
        return;
    real nu = poisson[i];
    real stiffness = 1e3f * modulus[i] * (1 - nu) / ((1 + nu) * (1 - 2 * nu));
    out[i] = density[i] > 0 ? sqrt(stiffness / density[i]) : 0;
}
