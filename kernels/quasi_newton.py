"""Limited-memory BFGS whose two loops run on the products of its vectors: the rows of a basis (rows, n).

Source: Chen, Wang and Zhou 2014, "Large-scale L-BFGS using MapReduce".
"""

from typing import Any

import warp as wp


@wp.kernel(enable_backward=False, module="unique")
def remember(
    x: wp.array(dtype=Any),
    x_new: wp.array(dtype=Any),
    g: wp.array(dtype=Any),
    g_new: wp.array(dtype=Any),
    scale: wp.array(dtype=Any),
    slot: wp.int32,
    memory: wp.int32,
    n: wp.int32,
    basis: wp.array(dtype=Any),
    first: wp.int32,
):
    """Takes in a step from x to x_new and the gradients g and g_new there.

    Row ``slot`` of the basis becomes the step over ``scale`` (n), that ``memory`` further on the change of the gradient
    times ``scale``, and row 2 ``memory``, the last, g_new times ``scale``.
    """
    i = wp.tid() + first
    step = wp.int64(slot) * wp.int64(n) + wp.int64(i)
    rows = wp.int64(memory) * wp.int64(n)
    basis[step] = (x_new[i] - x[i]) / scale[i]
    basis[step + rows] = (g_new[i] - g[i]) * scale[i]
    basis[wp.int64(2) * rows + wp.int64(i)] = g_new[i] * scale[i]


@wp.kernel(enable_backward=False, module="unique")
def row_products(
    basis: wp.array(dtype=Any),
    slot: wp.int32,
    memory: wp.int32,
    n: wp.int32,
    parts: wp.int32,
    out: wp.array(dtype=Any),
    first: wp.int32,
):
    """Sums (3, 2 memory + 1, parts) of these three rows times every row, each part over a run of elements of its own.

    Work items beside each other share a run of the three, which stays in the cache.
    """
    item = wp.tid() + first
    rows = 2 * memory + 1
    row = item % rows
    part = item // rows
    y = wp.int64(row) * wp.int64(n)
    a = wp.int64(slot) * wp.int64(n)
    b = a + wp.int64(memory) * wp.int64(n)
    c = wp.int64(2 * memory) * wp.int64(n)
    run = (n + parts - 1) // parts
    sum_a = out.dtype(0.0)
    sum_b = out.dtype(0.0)
    sum_c = out.dtype(0.0)
    for k in range(part * run, wp.min((part + 1) * run, n)):
        i = wp.int64(k)
        value = basis[y + i]
        sum_a += basis[a + i] * value
        sum_b += basis[b + i] * value
        sum_c += basis[c + i] * value
    at = row * parts + part
    out[at] = sum_a
    out[rows * parts + at] = sum_b
    out[2 * rows * parts + at] = sum_c


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
