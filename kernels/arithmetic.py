"""What the arithmetic of a device gives: products and sums of numbers that stay in registers, fused where it can."""

from typing import Any

import warp as wp

from gpubspline.kernels.lanes import LaneArray

FLAGS = f"{getattr(wp.config, 'cpu_compiler_flags', '')} -ffp-contract=fast"


@wp.kernel(enable_backward=False, module="unique", module_options={"cpu_compiler_flags": FLAGS})
def multiply_add(
    start: LaneArray,
    a: Any,
    b: Any,
    rounds: wp.int32,
    n: wp.int32,
    out: LaneArray,
    first: wp.int32,
    lanes: wp.int32,
):
    """8 times ``rounds`` steps y = a y + b of each element, 2 operations each; the 8 do not wait for each other."""
    i = wp.min((wp.tid() + first) * lanes, n - lanes)
    x = start[i]
    more = start.dtype(b)
    y0 = x
    y1 = x + start.dtype(type(a)(1.0))
    y2 = x + start.dtype(type(a)(2.0))
    y3 = x + start.dtype(type(a)(3.0))
    y4 = x + start.dtype(type(a)(4.0))
    y5 = x + start.dtype(type(a)(5.0))
    y6 = x + start.dtype(type(a)(6.0))
    y7 = x + start.dtype(type(a)(7.0))
    for _round in range(rounds):
        y0 = a * y0 + more
        y1 = a * y1 + more
        y2 = a * y2 + more
        y3 = a * y3 + more
        y4 = a * y4 + more
        y5 = a * y5 + more
        y6 = a * y6 + more
        y7 = a * y7 + more
    out[i] = ((y0 + y1) + (y2 + y3)) + ((y4 + y5) + (y6 + y7))
