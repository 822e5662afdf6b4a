"""What the memory of a device gives: writing alone, and two reads to a write (the triad of McCalpin's STREAM)."""

from typing import Any

import warp as wp

from gpubspline.kernels.lanes import LaneArray


@wp.kernel(enable_backward=False, module="unique")
def fill(out: LaneArray, value: Any, n: wp.int32, first: wp.int32, lanes: wp.int32):
    i = wp.min((wp.tid() + first) * lanes, n - lanes)
    out[i] = out.dtype(value)


@wp.kernel(enable_backward=False, module="unique")
def triad(a: LaneArray, b: LaneArray, factor: Any, n: wp.int32, out: LaneArray, first: wp.int32, lanes: wp.int32):
    i = wp.min((wp.tid() + first) * lanes, n - lanes)
    out[i] = a[i] + factor * b[i]
