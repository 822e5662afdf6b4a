"""Speed of longitudinal ultrasound in an isotropic solid."""

from typing import Any

import warp as wp


@wp.kernel(enable_backward=False, module="unique")
def speed(
    modulus: wp.array(dtype=Any),
    poisson: wp.array(dtype=Any),
    density: wp.array(dtype=Any),
    n: wp.int32,
    out: wp.array(dtype=Any),
    first: wp.int32,
):
    """Metres a second, from MPa, a ratio and g/cm3 (n,); 0 where there is no density."""
    i = wp.tid() + first
    nu = poisson[i]
    one = nu - nu + out.dtype(1.0)
    stiffness = out.dtype(1.0e3) * modulus[i] * (one - nu) / ((one + nu) * (one - nu - nu))
    if density[i] > out.dtype(0.0):
        out[i] = wp.sqrt(stiffness / density[i])
    else:
        out[i] = out.dtype(0.0)
