"""B-spline basis functions by the recurrence of Cox and de Boor, and their derivatives.

Source: Piegl and Tiller, The NURBS Book, 2nd ed., sections 2.2 to 2.3.
"""

from typing import Any

import warp as wp

ORDER_LIMIT = wp.constant(6)  # degree 5 and lower


@wp.func
def knot_span(knots: wp.array(dtype=Any), degree: wp.int32, n_control: wp.int32, t: Any):
    """Index s of the span with knots[s] <= t < knots[s + 1], the last non-empty span at the end of the domain."""
    low = degree
    high = n_control
    while high - low > 1:
        middle = (low + high) // 2
        if t < knots[middle]:
            high = middle
        else:
            low = middle
    while low > degree and knots[low] == knots[low + 1]:
        low = low - 1
    return low


@wp.kernel(enable_backward=False, module="unique")
def basis_functions(
    knots: wp.array(dtype=Any),
    degree: wp.int32,
    n_control: wp.int32,
    parameters: wp.array(dtype=Any),
    n: wp.int32,
    order: wp.int32,
    span: wp.array(dtype=wp.int32),
    values: wp.array(dtype=Any),
    first: wp.int32,
):
    """The ``order``-th derivatives of the degree + 1 basis functions that live at each parameter.

    values: (degree + 1, n) planes; function span - degree + a is plane a.
    """
    i = wp.tid() + first
    t = parameters[i]
    s = knot_span(knots, degree, n_control, t)
    N = wp.vector(length=ORDER_LIMIT, dtype=values.dtype)
    if order <= degree:
        N[0] = values.dtype(1.0)
    for d in range(1, degree - order + 1):
        saved = values.dtype(0.0)
        for a in range(d):
            right = knots[s + a + 1] - t
            left = t - knots[s + a + 1 - d]
            share = N[a] / (right + left)
            N[a] = saved + right * share
            saved = left * share
        N[d] = saved
    for d in range(wp.max(degree - order, 0) + 1, degree + 1):
        for down in range(d + 1):
            a = d - down
            slope = values.dtype(0.0)
            if a > 0:
                slope = slope + N[a - 1] / (knots[s + a] - knots[s + a - d])
            if a < d:
                slope = slope - N[a] / (knots[s + a + 1] - knots[s + a + 1 - d])
            N[a] = values.dtype(d) * slope
    span[i] = s
    for a in range(degree + 1):
        values[a * n + i] = N[a]
