"""What the memory of a device gives: writing alone, two reads to a write (the triad of McCalpin's STREAM), and gathers.

A work item of a GPU takes several numbers, ``items`` apart, without which the launch of each would weigh more than it.
"""

from typing import Any

import warp as wp

from gpubspline.kernels.lanes import LaneArray, element


@wp.kernel(enable_backward=False, module="unique")
def fill(out: LaneArray, value: Any, n: wp.int32, items: wp.int32, first: wp.int32, lanes: wp.int32):
    i = (wp.tid() + first) * lanes
    while i < n:
        out[wp.min(i, n - lanes)] = out.dtype(value)
        i = i + items


@wp.kernel(enable_backward=False, module="unique")
def triad(
    a: LaneArray,
    b: LaneArray,
    factor: Any,
    n: wp.int32,
    items: wp.int32,
    out: LaneArray,
    first: wp.int32,
    lanes: wp.int32,
):
    i = (wp.tid() + first) * lanes
    while i < n:
        at = wp.min(i, n - lanes)
        out[at] = a[at] + factor * b[at]
        i = i + items


@wp.kernel(enable_backward=False, module="unique")
def gather(
    source: wp.array(dtype=Any),
    index: wp.array(dtype=wp.int32),
    n: wp.int32,
    items: wp.int32,
    out: wp.array(dtype=Any),
    first: wp.int32,
):
    i = wp.tid() + first
    while i < n:
        out[i] = element(source, element(index, i))
        i = i + items
