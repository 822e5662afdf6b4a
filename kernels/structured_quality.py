"""Scaled Jacobian of structured hexes: that of ``quality``, without connectivity.

On a CPU the OpenCL twin works out once what neighbours along u share; here the work items of a row know nothing of each
other.
"""

import warp as wp

from gpubspline.kernels.lanes import LaneArray
from gpubspline.kernels.quality import hex_corners, least8


@wp.kernel(enable_backward=False, module="unique")
def hex_scaled_jacobian(
    x: LaneArray,
    y: LaneArray,
    z: LaneArray,
    n_u: wp.int32,
    n_v: wp.int32,
    n_w: wp.int32,
    out: LaneArray,
    first: wp.int32,
    lanes: wp.int32,
):
    """Nodes n_u x n_v x n_w, u fastest; launched over (n_w - 1, n_v - 1, n_u - 1) cells."""
    tid_k, j, item = wp.tid()
    k = tid_k + first
    i = wp.min(item * lanes, n_u - 1 - lanes)
    a = (k * n_v + j) * n_u + i
    b = a + n_u
    c = a + n_u * n_v
    d = c + n_u
    c0, c1, c2, c3, c4, c5, c6, c7 = hex_corners(
        x[a],
        y[a],
        z[a],
        x[a + 1],
        y[a + 1],
        z[a + 1],
        x[b + 1],
        y[b + 1],
        z[b + 1],
        x[b],
        y[b],
        z[b],
        x[c],
        y[c],
        z[c],
        x[c + 1],
        y[c + 1],
        z[c + 1],
        x[d + 1],
        y[d + 1],
        z[d + 1],
        x[d],
        y[d],
        z[d],
    )
    out[(k * (n_v - 1) + j) * (n_u - 1) + i] = least8(c0, c1, c2, c3, c4, c5, c6, c7)
