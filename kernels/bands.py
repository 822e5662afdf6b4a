"""A solid patch on a CPU: all passes in one launch, band by band, what is between them in a core's cache."""

from typing import Any

import warp as wp

from gpubspline.kernels.lanes import LaneArray, fetch
from gpubspline.kernels.span_sum import origin_of, weight

CHUNK = wp.constant(512)  # numbers of a plane that stay in the first cache while some spans are made of them


@wp.func
def sum_rows(
    source: LaneArray,
    row: Any,
    values: wp.array(dtype=Any),
    degree: wp.int32,
    at: wp.int32,
    n_all: wp.int32,
    count: wp.int32,
    origin: Any,
    lanes: wp.int32,
    target: LaneArray,
    to: wp.int64,
):
    """The sum of degree + 1 rows of ``count`` numbers by the weights of one parameter, and an origin."""
    w0 = weight(values, 0, degree, at, n_all)
    w1 = weight(values, 1, degree, at, n_all)
    w2 = weight(values, 2, degree, at, n_all)
    w3 = weight(values, 3, degree, at, n_all)
    w4 = weight(values, 4, degree, at, n_all)
    w5 = weight(values, 5, degree, at, n_all)
    for vector in range((count + lanes - 1) // lanes):
        i = wp.int64(wp.min(vector * lanes, count - lanes))
        total = w0 * source[row[0] + i] + w1 * source[row[1] + i]
        if degree > 1:
            total = total + w2 * source[row[2] + i]
        if degree > 2:
            total = total + w3 * source[row[3] + i]
        if degree > 3:
            total = total + w4 * source[row[4] + i]
        if degree > 4:
            total = total + w5 * source[row[5] + i]
        for lane in range(len(total)):
            total[lane] = total[lane] + origin
        target[to + i] = total


@wp.func
def ring_rows(first: wp.int32, degree: wp.int32, places: wp.int32, size: wp.int32, ring: wp.int64):
    """Where degree + 1 rows from number ``first`` on lie in a ring of so many places, ``size`` apart."""
    rows = wp.vector(length=6, dtype=wp.int64)
    for a in range(6):
        rows[a] = ring + wp.int64((first + wp.min(a, degree)) % places) * wp.int64(size)
    return rows


@wp.func
def interleave(
    control: LaneArray,
    plane: wp.int64,
    row: wp.int32,
    n_u: wp.int32,
    n_v: wp.int32,
    lanes: wp.int32,
    scratch: wp.array(dtype=Any),
    vectors: LaneArray,
    packed: wp.int64,
    soon: wp.int64,
):
    """Bring as many rows of a plane as there are lanes to ``packed`` (n_u, lanes); beyond the last row, it again.

    The rows from ``soon`` on are what the next call wants.
    """
    tile = wp.outer(control[0], control[0])
    if n_u < lanes:
        for m in range(lanes):
            start = plane + wp.int64(wp.min(row + m, n_v - 1) * n_u)
            for i in range(n_u):
                scratch[packed + wp.int64(i * lanes + m)] = control[start + wp.int64(i)][0]
    else:
        for t in range((n_u + lanes - 1) // lanes):
            i = wp.min(t * lanes, n_u - lanes)
            for m in range(lanes):
                for line in range(0, lanes, 16):
                    fetch(control, wp.int32(soon) + m * n_u + i + line)
                tile[m] = control[plane + wp.int64(wp.min(row + m, n_v - 1) * n_u + i)]
            turned = wp.transpose(tile)
            for m in range(lanes):
                vectors[packed + wp.int64((i + m) * lanes)] = turned[m]


@wp.func
def contract_lines(
    span: wp.array(dtype=wp.int32),
    values: wp.array(dtype=Any),
    n_all: wp.int32,
    degree: wp.int32,
    n_out: wp.int32,
    row: wp.int32,
    lanes: wp.int32,
    vectors: LaneArray,
    packed: wp.int64,
    rows: wp.int64,
    n_rows: wp.int32,
    row_size: wp.int32,
):
    """u axis of the interleaved rows, of which a span is read without a gather, to their places in the ring."""
    tile = wp.outer(vectors[packed], vectors[packed])
    for t in range((n_out + lanes - 1) // lanes):
        first = wp.min(t * lanes, n_out - lanes)
        for m in range(lanes):
            start = packed + wp.int64((span[first + m] - degree) * lanes)
            total = values[first + m] * vectors[start]
            for a in range(1, degree + 1):
                total = total + values[a * n_all + first + m] * vectors[start + wp.int64(a * lanes)]
            tile[m] = total
        turned = wp.transpose(tile)
        for m in range(lanes):
            vectors[rows + wp.int64(((row + m) % n_rows) * row_size + first)] = turned[m]


@wp.kernel(enable_backward=False, module="unique")
def contract_solid(
    control: LaneArray,
    n_channels: wp.int32,
    n_u: wp.int32,
    n_v: wp.int32,
    n_w: wp.int32,
    span: wp.array(dtype=wp.int32),
    values: wp.array(dtype=Any),
    degree_u: wp.int32,
    out_u: wp.int32,
    degree_v: wp.int32,
    out_v: wp.int32,
    degree_w: wp.int32,
    out_w: wp.int32,
    band: wp.int32,
    part: wp.int32,
    n_planes: wp.int32,
    item_size: wp.int32,
    x0: Any,
    y0: Any,
    z0: Any,
    scratch: wp.array(dtype=Any),
    vectors: LaneArray,
    target: LaneArray,
    first: wp.int32,
    lanes: wp.int32,
):
    """All axes of a solid on a CPU: control (n_channels, n_w, n_v, n_u) -> target (n_channels, out_w, out_v, out_u).

    Launched over (items, 1, out_u); of an item only the first along u works. It makes a band of ``band`` rows of
    ``part`` planes of one channel. Rows of control points that are contracted along u, and planes that are contracted
    along v too, wait for the next pass in rings, which stay in its core's cache. The ring of ``n_planes`` holds a few
    beside those of a span: what the first cache has taken of them then makes all parameters of some spans. ``scratch``
    and ``vectors`` are one memory, ``item_size`` an item. The first three channels are places from (x0, y0, z0).
    """
    tid_item, _none, along = wp.tid()
    if along > 0:
        return
    item = tid_item + first
    n_bands = (out_v + band - 1) // band
    n_parts = (out_w + part - 1) // part
    n_uv = out_u + out_v  # parameters; those of v are behind those of u, those of w behind them
    n_all = n_uv + out_w
    first_j = out_u + (item % n_bands) * band
    end_j = wp.min(first_j + band, n_uv)
    first_k = n_uv + (item // n_bands % n_parts) * part
    end_k = wp.min(first_k + part, n_all)
    channel = wp.int64(item // (n_bands * n_parts))
    origin = origin_of(item // (n_bands * n_parts), x0, y0, z0)
    none = type(origin)(-0.0)  # adding it leaves every number as it is
    count = (end_j - first_j) * out_u
    n_rows = degree_v + lanes
    row_size = ((out_u + lanes - 1) // lanes) * lanes
    plane_size = ((band * out_u + lanes - 1) // lanes) * lanes
    packed = wp.int64(item) * wp.int64(item_size)
    rows = packed + wp.int64((n_u + lanes) * lanes)
    planes = rows + wp.int64(n_rows * row_size)
    plane = wp.int32(0)
    k = first_k
    while k < end_k:
        if k > first_k and span[k] < span[wp.max(k - 1, 0)]:  # parameters that run back: the ring begins anew
            plane = 0
        ahead = span[k] - degree_w
        plane = wp.max(plane, ahead)
        ahead = ahead + n_planes
        end = k + 1
        while end < end_k and wp.where(
            span[wp.min(end, end_k - 1)] < ahead, span[wp.min(end, end_k - 1)] >= span[end - 1], False
        ):
            end = end + 1
        while plane <= span[end - 1]:
            source = (channel * wp.int64(n_w) + wp.int64(plane)) * wp.int64(n_v * n_u)
            row = wp.int32(0)
            for j in range(first_j, end_j):
                if j > first_j and span[j] < span[wp.max(j - 1, 0)]:
                    row = 0
                row = wp.max(row, span[j] - degree_v)
                while row <= span[j]:
                    soon = source + wp.int64(row + lanes) * wp.int64(n_u)
                    if row + lanes > span[end_j - 1]:  # the first of the next plane
                        soon = source + wp.int64(n_v + span[first_j] - degree_v) * wp.int64(n_u)
                    interleave(control, source, row, n_u, n_v, lanes, scratch, vectors, packed, soon)
                    contract_lines(
                        span, values, n_all, degree_u, out_u, row, lanes, vectors, packed, rows, n_rows, row_size
                    )
                    row = row + lanes
                each = ring_rows(span[j] - degree_v, degree_v, n_rows, row_size, rows)
                to = planes + wp.int64((plane % n_planes) * plane_size + (j - first_j) * out_u)
                sum_rows(vectors, each, values, degree_v, j, n_all, out_u, none, lanes, vectors, to)
            plane = plane + 1
        for done in range(0, count, CHUNK):
            size = wp.min(count - done, CHUNK)
            for at in range(k, end):
                each = ring_rows(span[at] - degree_w, degree_w, n_planes, plane_size, planes + wp.int64(done))
                layer = (channel * wp.int64(out_w) + wp.int64(at - n_uv)) * wp.int64(out_v)
                to = (layer + wp.int64(first_j - out_u)) * wp.int64(out_u) + wp.int64(done)
                sum_rows(vectors, each, values, degree_w, at, n_all, size, origin, lanes, target, to)
        k = end
