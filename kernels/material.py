"""Piecewise power law from HU to density, Young's modulus and Poisson's ratio (the form of eqs 3.6 and 3.7)."""

from typing import Any

import warp as wp

from gpubspline.kernels.lanes import IntLaneArray, LaneArray

TINY = wp.constant(1e-30)  # for a density of 0
NEAREST = wp.constant(12582912.0)  # 1.5 * 2^23, added and taken away: rounds to a whole number


@wp.func
def power(x: wp.float32, e: wp.float32):
    """x^e of a positive x by polynomials of least greatest error, so that a compiler finds vectors in a loop over it.

    2e-8 of log2 between sqrt(1/2) and sqrt(2), 2e-9 of exp2 between -1/2 and 1/2; the same bits as in OpenCL.
    """
    bits = wp.cast(x, wp.int32)
    scale = (bits - 0x3F3504F3) & wp.int32(-0x800000)  # x = 2^(scale / 2^23) m
    t = wp.cast(bits - scale, wp.float32) - 1.0
    t2 = t * t
    low = (1.4426950216293335 - 0.7213472127914429 * t) + t2 * (0.4809102714061737 - 0.3607162535190582 * t)
    last = (0.21521227061748505 - 0.2089337706565857 * t) + 0.1292642056941986 * t2
    high = (0.2879391014575958 - 0.23867568373680115 * t) + t2 * last
    power_of_2 = e * (t * (low + t2 * t2 * high) + wp.float32(scale >> 23))
    power_of_2 = wp.where(power_of_2 > -126.0, power_of_2, wp.float32(-126.0))
    power_of_2 = wp.where(power_of_2 < 127.0, power_of_2, wp.float32(127.0))
    whole = (power_of_2 + wp.float32(NEAREST)) - wp.float32(NEAREST)
    f = power_of_2 - whole
    f2 = f * f
    low = (1.0 + 0.6931471824645996 * f) + f2 * (0.24022646248340607 + 0.05550328642129898 * f)
    high = (0.009618489071726799 + 0.0013399930903688073 * f) + 0.00015345815336331725 * f2
    return (low + f2 * f2 * high) * wp.cast((wp.int32(whole) + 127) << 23, wp.float32)


@wp.func
def power(x: wp.float64, e: wp.float64):  # noqa: F811, an overload
    return wp.pow(x, e)


@wp.kernel(enable_backward=False, module="unique")
def power_law(
    hu: LaneArray,
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
    density: LaneArray,
    modulus: LaneArray,
    poisson_out: LaneArray,
    piece: IntLaneArray,
    first: wp.int32,
    lanes: wp.int32,
):
    """Piece q holds lower[q] <= HU < upper[q] (the last one its upper end too).

    E = factor rho^exponent + offset in MPa with rho = slope HU + intercept in g/cm3 by the last
    of the density's lines that starts at or below HU. HU outside every piece: policy 0
    moves it to the nearest end of a range, policy 1 keeps its density and gives the floor values. ``piece`` is the
    index used, or -1 - index where HU was outside.
    """
    i = wp.min((wp.tid() + first) * lanes, n - lanes)
    value = hu[i]
    zero = lower.dtype(0.0)
    tiny = lower.dtype(TINY)
    low = hu.dtype(lower[0])
    high = hu.dtype(upper[0])
    f = hu.dtype(factor[0])
    e = hu.dtype(exponent[0])
    o = hu.dtype(offset[0])
    nu = hu.dtype(poisson[0])
    used = piece.dtype(0)
    for q in range(1, n_pieces):
        start = lower[q]
        for lane in range(len(value)):
            at = value[lane]  # in a gap: nearer to its upper end
            later = at >= start or start - at < at - high[lane]
            low[lane] = wp.where(later, start, low[lane])
            high[lane] = wp.where(later, upper[q], high[lane])
            used[lane] = wp.where(later, q, used[lane])
            f[lane] = wp.where(later, factor[q], f[lane])
            e[lane] = wp.where(later, exponent[q], e[lane])
            o[lane] = wp.where(later, offset[q], o[lane])
            nu[lane] = wp.where(later, poisson[q], nu[lane])
    inside = piece.dtype(0)
    for lane in range(len(value)):
        at = value[lane]  # an upper end belongs to the piece that begins there, the last one's to itself
        own_end = at == high[lane] and used[lane] == n_pieces - 1
        inside[lane] = wp.where(at >= low[lane] and (at < high[lane] or own_end), 1, 0)
        nearest = wp.where(at > low[lane], at, low[lane])
        nearest = wp.where(nearest < high[lane], nearest, high[lane])
        value[lane] = wp.where(policy == 0, nearest, at)
    slope = hu.dtype(line_slope[0])
    intercept = hu.dtype(line_intercept[0])
    for q in range(1, n_lines):
        for lane in range(len(value)):
            slope[lane] = wp.where(value[lane] >= line_start[q], line_slope[q], slope[lane])
            intercept[lane] = wp.where(value[lane] >= line_start[q], line_intercept[q], intercept[lane])
    rho = wp.cw_mul(slope, value) + intercept
    for lane in range(len(value)):
        rho[lane] = wp.where(rho[lane] > zero, rho[lane], zero)
        kept = policy == 0 or inside[lane] == 1
        result = f[lane] * power(wp.where(rho[lane] > tiny, rho[lane], tiny), e[lane]) + o[lane]
        f[lane] = wp.where(kept, result, floor_modulus)
        nu[lane] = wp.where(kept, nu[lane], floor_poisson)
        used[lane] = wp.where(inside[lane] == 1, used[lane], -1 - used[lane])
    density[i] = rho
    modulus[i] = f
    poisson_out[i] = nu
    piece[i] = used
