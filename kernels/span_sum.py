"""Sums over the degree + 1 functions of a knot span. The OpenCL twin of this is ``span_sum.h``."""

from typing import Any

import warp as wp


@wp.func
def weight(values: wp.array(dtype=Any), a: wp.int32, degree: wp.int32, at: wp.int32, n_all: wp.int32):
    """Value of function a of a span, 0 for those that a lower degree has not, at one of n_all parameters."""
    return wp.where(a <= degree, values[wp.min(a, degree) * n_all + at], values.dtype(0.0))


@wp.func
def origin_of(channel: wp.int32, x: Any, y: Any, z: Any):
    """What is added to the sums of a channel: those of x, y and z, the first three, are from an origin."""
    return wp.where(channel == 0, x, wp.where(channel == 1, y, wp.where(channel == 2, z, type(x)(0.0))))
