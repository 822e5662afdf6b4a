"""What nodes have of what elements gave: sums in a fixed order, and the inverse of their own 3 x 3 stiffness."""

from typing import Any

import warp as wp


@wp.kernel(enable_backward=False, module="unique")
def gather(
    values: wp.array(dtype=Any),
    components: wp.int32,
    count: wp.int32,
    start: wp.array(dtype=wp.int32),
    slots: wp.array(dtype=wp.int32),
    free: wp.array(dtype=Any),
    n: wp.int32,
    out: wp.array(dtype=Any),
    first: wp.int32,
):
    """Sum over the elements of each node: values (components, k m) at the slots a m + e.

    ``start`` (n + 1) says where the slots of a node begin. What is not free (1 or 0 in ``free``, components x n)
    gets 0.
    """
    i = wp.tid() + first
    for c in range(components):
        total = out.dtype(0.0)
        for s in range(start[i], start[i + 1]):
            total = total + values[c * count + slots[s]]
        out[c * n + i] = total * free[c * n + i]


@wp.kernel(enable_backward=False, module="unique")
def invert_blocks(
    blocks: wp.array(dtype=Any), free: wp.array(dtype=Any), n: wp.int32, out: wp.array(dtype=Any), first: wp.int32
):
    """Inverse (6, n) of symmetric 3 x 3 blocks (6, n): xx, yy, zz, yz, xz, xy.

    Rows and columns that are not free become 0.
    """
    i = wp.tid() + first
    one = out.dtype(1.0)
    f = free[i]
    g = free[n + i]
    h = free[2 * n + i]
    a = wp.where(f > out.dtype(0.0), blocks[i], one)
    b = wp.where(g > out.dtype(0.0), blocks[n + i], one)
    c = wp.where(h > out.dtype(0.0), blocks[2 * n + i], one)
    d = g * h * blocks[3 * n + i]
    e = f * h * blocks[4 * n + i]
    o = f * g * blocks[5 * n + i]
    p = b * c - d * d
    q = d * e - o * c
    r = o * d - b * e
    inverse = one / (a * p + o * q + e * r)
    out[i] = f * p * inverse
    out[n + i] = g * (a * c - e * e) * inverse
    out[2 * n + i] = h * (a * b - o * o) * inverse
    out[3 * n + i] = g * h * (o * e - a * d) * inverse
    out[4 * n + i] = f * h * r * inverse
    out[5 * n + i] = f * g * q * inverse
