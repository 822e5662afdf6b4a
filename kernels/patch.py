"""Tensor-product B-spline evaluation (eqs 3.1 and 3.2 of the paper).

Sums factorise: a grid is evaluated one axis at a time, each pass contracting one axis of the control array with that
axis' basis. Arrays are component planes, u fastest. Offsets are 64-bit: planes of a large grid pass 2^31 elements.
The three passes of a solid are one launch on a CPU, ``bands``; its last two are one on a GPU, ``columns``.
"""

from typing import Any

import warp as wp

from gpubspline.kernels.lanes import LaneArray
from gpubspline.kernels.span_sum import origin_of


@wp.kernel(enable_backward=False, module="unique")
def contract_rows(
    source: wp.array(dtype=Any),
    n_rows: wp.int32,
    block: wp.int32,
    n_control: wp.int32,
    span: wp.array(dtype=wp.int32),
    values: wp.array(dtype=Any),
    n_all: wp.int32,
    degree: wp.int32,
    n_out: wp.int32,
    target: wp.array(dtype=Any),
    first: wp.int32,
):
    """u axis: source (n_rows, n_control) -> target (n_rows, n_out); ``n_all`` parameters are of all directions.

    Launched over (n_rows / block, n_out), each work item taking ``block`` rows.
    """
    tid_row, i = wp.tid()
    row = (tid_row + first) * block
    for line in range(row, wp.min(row + block, n_rows)):
        start = wp.int64(line) * wp.int64(n_control) + wp.int64(span[i] - degree)
        total = target.dtype(0.0)
        for a in range(degree + 1):
            total = total + values[a * n_all + i] * source[start + wp.int64(a)]
        target[wp.int64(line) * wp.int64(n_out) + wp.int64(i)] = total


@wp.kernel(enable_backward=False, module="unique")
def contract(
    source: LaneArray,
    n_control: wp.int32,
    inner: wp.int32,
    span: wp.array(dtype=wp.int32),
    values: wp.array(dtype=Any),
    degree: wp.int32,
    n_out: wp.int32,
    block: wp.int32,
    x0: Any,
    y0: Any,
    z0: Any,
    target: LaneArray,
    first: wp.int32,
    lanes: wp.int32,
):
    """v axis of a surface: source (outer, n_control, inner) -> target (outer, n_out, inner).

    Launched over (outer, n_out / block, inner), each work item taking its part of ``block`` planes. The first three of
    outer are places from (x0, y0, z0).
    """
    tid_outer, group, item = wp.tid()
    outer = wp.int64(tid_outer + first)
    origin = origin_of(tid_outer + first, x0, y0, z0)
    step = wp.int64(inner)
    i = wp.int64(wp.min(item * lanes, inner - lanes))
    for out in range(group * block, wp.min((group + 1) * block, n_out)):
        at = inner + out  # behind what is of u
        start = (outer * wp.int64(n_control) + wp.int64(span[at] - degree)) * step + i
        total = values[at] * source[start]
        for a in range(1, degree + 1):
            total = total + values[a * (inner + n_out) + at] * source[start + wp.int64(a) * step]
        for lane in range(len(total)):
            total[lane] = total[lane] + origin
        target[(outer * wp.int64(n_out) + wp.int64(out)) * step + i] = total


@wp.kernel(enable_backward=False, module="unique")
def evaluate_points(
    control: wp.array(dtype=Any),
    n_channels: wp.int32,
    n_u: wp.int32,
    n_v: wp.int32,
    n_w: wp.int32,
    degree_u: wp.int32,
    degree_v: wp.int32,
    degree_w: wp.int32,
    span: wp.array(dtype=wp.int32),
    values: wp.array(dtype=Any),
    n: wp.int32,
    x0: Any,
    y0: Any,
    z0: Any,
    out: wp.array(dtype=Any),
    first: wp.int32,
):
    """Scattered points: control (n_channels, n_w, n_v, n_u) planes, whose first three are places from (x0, y0, z0).

    out: (n_channels, n) planes.
    """
    tid_channel, i = wp.tid()
    channel = tid_channel + first
    at_u = span[i] - degree_u
    at_v = span[n + i] - degree_v
    at_w = span[2 * n + i] - degree_w
    total = out.dtype(0.0)
    for c in range(degree_w + 1):
        total_v = out.dtype(0.0)
        for b in range(degree_v + 1):
            start = (((channel * n_w) + at_w + c) * n_v + at_v + b) * n_u + at_u
            total_u = out.dtype(0.0)
            for a in range(degree_u + 1):
                total_u = total_u + values[3 * a * n + i] * control[start + a]
            total_v = total_v + values[(3 * b + 1) * n + i] * total_u
        total = total + values[(3 * c + 2) * n + i] * total_v
    out[wp.int64(channel) * wp.int64(n) + wp.int64(i)] = total + origin_of(channel, x0, y0, z0)


@wp.kernel(enable_backward=False, module="unique")
def divide_by_weight(
    planes: wp.array(dtype=Any),
    n_channels: wp.int32,
    n: wp.int32,
    x0: Any,
    y0: Any,
    z0: Any,
    first: wp.int32,
):
    """NURBS: divide each of n_channels planes of n values by the weight plane that follows them.

    The first three are places from (x0, y0, z0).
    """
    i = wp.int64(wp.tid() + first)
    count = wp.int64(n)
    inverse = planes.dtype(1.0) / planes[wp.int64(n_channels) * count + i]
    for channel in range(n_channels):
        at = wp.int64(channel) * count + i
        planes[at] = planes[at] * inverse + origin_of(channel, x0, y0, z0)
