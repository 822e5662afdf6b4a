"""Vectors of the iterative solvers: sums of multiples, products of vectors, 3 x 3 blocks times a vector."""

from typing import Any

import warp as wp

RUN = wp.constant(64)  # elements that a part takes together


@wp.kernel(enable_backward=False, module="unique")
def combine(x: wp.array(dtype=Any), a: Any, b: Any, n: wp.int32, y: wp.array(dtype=Any), first: wp.int32):
    """y = a x + b y."""
    i = wp.tid() + first
    y[i] = a * x[i] + b * y[i]


@wp.kernel(enable_backward=False, module="unique")
def product(
    x: wp.array(dtype=Any),
    y: wp.array(dtype=Any),
    n: wp.int32,
    parts: wp.int32,
    out: wp.array(dtype=Any),
    first: wp.int32,
):
    """Sums (parts) of x times y (n) over every parts-th run of elements: the same in any order of work."""
    part = wp.tid() + first
    total = out.dtype(0.0)
    runs = (n + RUN - 1) // RUN
    for run in range(part, runs, parts):
        for k in range(run * RUN, wp.min((run + 1) * RUN, n)):
            total = total + x[k] * y[k]
    out[part] = total


@wp.kernel(enable_backward=False, module="unique")
def blocks_times(
    blocks: wp.array(dtype=Any),
    x: wp.array(dtype=Any),
    n: wp.int32,
    out: wp.array(dtype=Any),
    first: wp.int32,
):
    """out = B x for symmetric 3 x 3 blocks (6, n): xx, yy, zz, yz, xz, xy; x and out are (3, n)."""
    i = wp.tid() + first
    a = x[i]
    b = x[n + i]
    c = x[2 * n + i]
    yz = blocks[3 * n + i]
    xz = blocks[4 * n + i]
    xy = blocks[5 * n + i]
    out[i] = blocks[i] * a + xy * b + xz * c
    out[n + i] = xy * a + blocks[n + i] * b + yz * c
    out[2 * n + i] = xz * a + yz * b + blocks[2 * n + i] * c
