"""Piecewise power law from HU to density, Young's modulus and Poisson's ratio (the form of eqs 3.6 and 3.7)."""

from typing import Any

import warp as wp


@wp.kernel(enable_backward=False, module="unique")
def power_law(
    hu: wp.array(dtype=Any),
    lower: wp.array(dtype=Any),
    upper: wp.array(dtype=Any),
    factor: wp.array(dtype=Any),
    exponent: wp.array(dtype=Any),
    offset: wp.array(dtype=Any),
    poisson: wp.array(dtype=Any),
    n_pieces: wp.int32,
    line_start: wp.array(dtype=Any),
    line_slope: wp.array(dtype=Any),
    line_intercept: wp.array(dtype=Any),
    n_lines: wp.int32,
    policy: wp.int32,
    floor_modulus: Any,
    floor_poisson: Any,
    n: wp.int32,
    density: wp.array(dtype=Any),
    modulus: wp.array(dtype=Any),
    poisson_out: wp.array(dtype=Any),
    piece: wp.array(dtype=wp.int32),
    first: wp.int32,
):
    """Piece q holds lower[q] <= HU < upper[q] (the last one its upper end too).

    E = factor rho^exponent + offset in MPa with rho = slope HU + intercept in g/cm3 by the last
    of the density's lines that starts at or below HU. HU outside every piece: policy 0
    moves it to the nearest end of a range, policy 1 keeps its density and gives the floor values. ``piece`` is the
    index used, or -1 - index where HU was outside.
    """
    i = wp.tid() + first
    value = hu[i]
    nearest = hu.dtype(0.0)
    gap = hu.dtype(wp.inf)
    used = wp.int32(0)
    inside = wp.bool(False)
    for q in range(n_pieces):
        if not inside:
            inside = value >= lower[q] and (value < upper[q] or (q == n_pieces - 1 and value == upper[q]))
            end = wp.clamp(value, lower[q], upper[q])
            away = wp.where(inside, hu.dtype(-1.0), wp.abs(value - end))
            if away < gap:
                gap = away
                nearest = end
                used = q
    if not inside and policy == 0:
        value = nearest
    line = wp.int32(0)
    for q in range(1, n_lines):
        if value >= line_start[q]:
            line = q
    rho = wp.max(line_slope[line] * value + line_intercept[line], hu.dtype(0.0))
    density[i] = rho
    piece[i] = wp.where(inside, used, -1 - used)
    if not inside and policy == 1:
        modulus[i] = floor_modulus
        poisson_out[i] = floor_poisson
    else:
        modulus[i] = factor[used] * wp.pow(rho, exponent[used]) + offset[used]
        poisson_out[i] = poisson[used]
