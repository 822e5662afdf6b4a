"""Vector lanes in Warp.

Warp's CPU compiler does not vectorise across work items. A ``LaneArray`` is an array of overlapping vectors, one that
begins at every element: its index is that of an element, and what it holds there are this element and its next
neighbours. The Warp device chooses the length: many where the kernel's last argument is ``lanes`` and the device is a
CPU, else one. A work item then handles the elements ``min(item * lanes, n - lanes)`` and on of the fastest dimension,
so that the last vector of a row overlaps the one before it. The OpenCL twin of this is ``lanes.h``.
"""

from typing import Any

import warp as wp

LaneArray = wp.array(dtype=Any)

IntLaneArray = wp.array(dtype=Any)
"""A LaneArray of int32."""


@wp.func
def inverse_root(squared: Any):
    """1 / sqrt of each lane, 0 where it is 0."""
    result = squared
    for lane in range(len(squared)):
        value = squared[lane]
        none = type(value)(0.0)
        result[lane] = wp.where(value > none, type(value)(1.0) / wp.sqrt(value), none)
    return result
