"""Limited-memory BFGS whose two loops run on the products of its vectors: the rows of a basis (rows, n).

Source: Chen, Wang and Zhou 2014, "Large-scale L-BFGS using MapReduce".
"""

from typing import Any

import warp as wp


@wp.kernel(enable_backward=False, module="unique")
def set_difference(
    x: wp.array(dtype=Any),
    y: wp.array(dtype=Any),
    scale: wp.array(dtype=Any),
    inverse: wp.int32,
    n: wp.int32,
    row: wp.int32,
    basis: wp.array(dtype=Any),
    first: wp.int32,
):
    """The row ``row`` of the basis becomes x - y, times ``scale`` (n) or, where ``inverse`` is 1, over it."""
    i = wp.tid() + first
    basis[wp.int64(row) * wp.int64(n) + wp.int64(i)] = wp.where(
        inverse == 1, (x[i] - y[i]) / scale[i], (x[i] - y[i]) * scale[i]
    )


@wp.kernel(enable_backward=False, module="unique")
def combine_rows(
    basis: wp.array(dtype=Any),
    coefficients: wp.array(dtype=Any),
    rows: wp.int32,
    scale: wp.array(dtype=Any),
    n: wp.int32,
    out: wp.array(dtype=Any),
    first: wp.int32,
):
    """``scale`` (n) times the rows times their coefficients."""
    i = wp.tid() + first
    total = out.dtype(0.0)
    for row in range(rows):
        total = total + coefficients[row] * basis[wp.int64(row) * wp.int64(n) + wp.int64(i)]
    out[i] = scale[i] * total
