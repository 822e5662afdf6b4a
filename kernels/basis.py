"""B-spline basis functions by the recurrence of Cox and de Boor, and their derivatives.

Source: Piegl and Tiller, The NURBS Book, 2nd ed., sections 2.2 to 2.3.
"""

from typing import Any

import warp as wp

ORDER_LIMIT = wp.constant(6)  # degree 5 and lower


@wp.func
def knot_span(given: wp.array(dtype=Any), knots: wp.int32, degree: wp.int32, n_control: wp.int32, t: Any):
    """Index s of the span with knots[s] <= t < knots[s + 1], the last non-empty span at the end of the domain.

    Knots begin at number ``knots`` of what is given.
    """
    low = degree
    high = n_control
    while high - low > 1:
        middle = (low + high) // 2
        if t < given[knots + middle]:
            high = middle
        else:
            low = middle
    while low > degree and given[knots + low] == given[knots + low + 1]:
        low = low - 1
    return low


@wp.kernel(enable_backward=False, module="unique")
def basis_functions(
    given: wp.array(dtype=Any),
    degree_u: wp.int32,
    n_u: wp.int32,
    out_u: wp.int32,
    order_u: wp.int32,
    degree_v: wp.int32,
    n_v: wp.int32,
    out_v: wp.int32,
    order_v: wp.int32,
    degree_w: wp.int32,
    n_w: wp.int32,
    out_w: wp.int32,
    order_w: wp.int32,
    span: wp.array(dtype=wp.int32),
    values: wp.array(dtype=Any),
    first: wp.int32,
):
    """The derivatives, of an order, of the degree + 1 basis functions that live at each parameter of each direction.

    given: the knots of u, v and w one after another, then their parameters, ``out_u`` and so on, n in all. span: (n,);
    values: (degree + 1, n) planes; function span - degree + a is plane a.
    """
    i = wp.tid() + first
    n = out_u + out_v + out_w
    knots = wp.int32(0)
    degree = degree_u
    n_control = n_u
    order = order_u
    if i >= out_u:
        knots = n_u + degree_u + 1
        degree = degree_v
        n_control = n_v
        order = order_v
    if i >= out_u + out_v:
        knots = knots + n_v + degree_v + 1
        degree = degree_w
        n_control = n_w
        order = order_w
    t = given[n_u + degree_u + n_v + degree_v + n_w + degree_w + 3 + i]
    s = knot_span(given, knots, degree, n_control, t)
    at = knots + s
    N = wp.vector(length=ORDER_LIMIT, dtype=values.dtype)
    if order <= degree:
        N[0] = values.dtype(1.0)
    for d in range(1, degree - order + 1):
        saved = values.dtype(0.0)
        for a in range(d):
            right = given[at + a + 1] - t
            left = t - given[at + a + 1 - d]
            share = N[a] / (right + left)
            N[a] = saved + right * share
            saved = left * share
        N[d] = saved
    for d in range(wp.max(degree - order, 0) + 1, degree + 1):
        for down in range(d + 1):
            a = d - down
            slope = values.dtype(0.0)
            if a > 0:
                slope = slope + N[a - 1] / (given[at + a] - given[at + a - d])
            if a < d:
                slope = slope - N[a] / (given[at + a + 1] - given[at + a + 1 - d])
            N[a] = values.dtype(d) * slope
    span[i] = s
    for a in range(degree + 1):
        values[a * n + i] = N[a]
