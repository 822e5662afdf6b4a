"""Tensor-product B-spline evaluation (eqs 3.1 and 3.2 of the paper).

Sums factorise: a grid is evaluated one axis at a time, each pass contracting one axis of the control array with that
axis' basis. Arrays are component planes, u fastest. Offsets are 64-bit: planes of a large grid pass 2^31 elements.
"""

from typing import Any

import warp as wp

from gpubspline.kernels.lanes import LaneArray, element, fetch, stream

TILE = wp.constant(32)  # of a GPU: neighbours along u that a group of threads writes at once
TILE_ROWS = wp.constant(8)  # such tiles along v, which read the same rows of control points
CHUNK = wp.constant(512)  # numbers of a plane that stay in the first cache while some spans are made of them


@wp.kernel(enable_backward=False, module="unique")
def contract_rows(
    source: wp.array(dtype=Any),
    n_rows: wp.int32,
    block: wp.int32,
    n_control: wp.int32,
    span: wp.array(dtype=wp.int32),
    values: wp.array(dtype=Any),
    degree: wp.int32,
    n_out: wp.int32,
    target: wp.array(dtype=Any),
    first: wp.int32,
):
    """u axis: source (n_rows, n_control) -> target (n_rows, n_out).

    Launched over (n_rows / block, n_out), each work item taking ``block`` rows.
    """
    tid_row, i = wp.tid()
    row = (tid_row + first) * block
    for line in range(row, wp.min(row + block, n_rows)):
        start = wp.int64(line) * wp.int64(n_control) + wp.int64(span[i] - degree)
        total = target.dtype(0.0)
        for a in range(degree + 1):
            total = total + values[a * n_out + i] * source[start + wp.int64(a)]
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
    target: LaneArray,
    first: wp.int32,
    lanes: wp.int32,
):
    """v or w axis: source (outer, n_control, inner) -> target (outer, n_out, inner).

    Launched over (outer, n_out / block, inner), each work item taking its part of ``block`` planes.
    """
    tid_outer, group, item = wp.tid()
    outer = wp.int64(tid_outer + first)
    step = wp.int64(inner)
    i = wp.int64(wp.min(item * lanes, inner - lanes))
    for out in range(group * block, wp.min((group + 1) * block, n_out)):
        start = (outer * wp.int64(n_control) + wp.int64(span[out] - degree)) * step + i
        total = values[out] * source[start]
        for a in range(1, degree + 1):
            total = total + values[a * n_out + out] * source[start + wp.int64(a) * step]
        target[(outer * wp.int64(n_out) + wp.int64(out)) * step + i] = total


@wp.func
def weight(values: wp.array(dtype=Any), a: wp.int32, degree: wp.int32, at: wp.int32, n_out: wp.int32):
    """Value of function a of a span, 0 for those that a lower degree has not."""
    return wp.where(a <= degree, values[wp.min(a, degree) * n_out + at], values.dtype(0.0))


@wp.func
def sum_rows(
    source: LaneArray,
    row: Any,
    values: wp.array(dtype=Any),
    degree: wp.int32,
    at: wp.int32,
    n_out: wp.int32,
    count: wp.int32,
    lanes: wp.int32,
    target: LaneArray,
    to: wp.int64,
):
    """The sum of degree + 1 rows of ``count`` numbers by the weights of one parameter."""
    w0 = weight(values, 0, degree, at, n_out)
    w1 = weight(values, 1, degree, at, n_out)
    w2 = weight(values, 2, degree, at, n_out)
    w3 = weight(values, 3, degree, at, n_out)
    w4 = weight(values, 4, degree, at, n_out)
    w5 = weight(values, 5, degree, at, n_out)
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
                total = total + values[a * n_out + first + m] * vectors[start + wp.int64(a * lanes)]
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
    span_u: wp.array(dtype=wp.int32),
    values_u: wp.array(dtype=Any),
    degree_u: wp.int32,
    out_u: wp.int32,
    span_v: wp.array(dtype=wp.int32),
    values_v: wp.array(dtype=Any),
    degree_v: wp.int32,
    out_v: wp.int32,
    span_w: wp.array(dtype=wp.int32),
    values_w: wp.array(dtype=Any),
    degree_w: wp.int32,
    out_w: wp.int32,
    band: wp.int32,
    part: wp.int32,
    n_planes: wp.int32,
    item_size: wp.int32,
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
    and ``vectors`` are one memory, ``item_size`` an item.
    """
    tid_item, _none, along = wp.tid()
    if along > 0:
        return
    item = tid_item + first
    n_bands = (out_v + band - 1) // band
    n_parts = (out_w + part - 1) // part
    first_j = (item % n_bands) * band
    end_j = wp.min(first_j + band, out_v)
    first_k = (item // n_bands % n_parts) * part
    end_k = wp.min(first_k + part, out_w)
    channel = wp.int64(item // (n_bands * n_parts))
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
        if k > first_k and span_w[k] < span_w[wp.max(k - 1, 0)]:  # parameters that run back: the ring begins anew
            plane = 0
        ahead = span_w[k] - degree_w
        plane = wp.max(plane, ahead)
        ahead = ahead + n_planes
        end = k + 1
        while end < end_k and wp.where(
            span_w[wp.min(end, end_k - 1)] < ahead, span_w[wp.min(end, end_k - 1)] >= span_w[end - 1], False
        ):
            end = end + 1
        while plane <= span_w[end - 1]:
            source = (channel * wp.int64(n_w) + wp.int64(plane)) * wp.int64(n_v * n_u)
            row = wp.int32(0)
            for j in range(first_j, end_j):
                if j > first_j and span_v[j] < span_v[wp.max(j - 1, 0)]:
                    row = 0
                row = wp.max(row, span_v[j] - degree_v)
                while row <= span_v[j]:
                    soon = source + wp.int64(row + lanes) * wp.int64(n_u)
                    if row + lanes > span_v[end_j - 1]:  # the first of the next plane
                        soon = source + wp.int64(n_v + span_v[first_j] - degree_v) * wp.int64(n_u)
                    interleave(control, source, row, n_u, n_v, lanes, scratch, vectors, packed, soon)
                    contract_lines(
                        span_u, values_u, degree_u, out_u, row, lanes, vectors, packed, rows, n_rows, row_size
                    )
                    row = row + lanes
                each = ring_rows(span_v[j] - degree_v, degree_v, n_rows, row_size, rows)
                to = planes + wp.int64((plane % n_planes) * plane_size + (j - first_j) * out_u)
                sum_rows(vectors, each, values_v, degree_v, j, out_v, out_u, lanes, vectors, to)
            plane = plane + 1
        for done in range(0, count, CHUNK):
            size = wp.min(count - done, CHUNK)
            for at in range(k, end):
                each = ring_rows(span_w[at] - degree_w, degree_w, n_planes, plane_size, planes + wp.int64(done))
                layer = (channel * wp.int64(out_w) + wp.int64(at)) * wp.int64(out_v)
                to = (layer + wp.int64(first_j)) * wp.int64(out_u) + wp.int64(done)
                sum_rows(vectors, each, values_w, degree_w, at, out_w, size, lanes, target, to)
        k = end


@wp.func
def places(source: wp.array(dtype=Any), at: wp.int32, o1: wp.int32, o2: wp.int32, o3: wp.int32):
    """Four numbers, so far behind the first."""
    return wp.vector(element(source, at), element(source, at + o1), element(source, at + o2), element(source, at + o3))


@wp.kernel(enable_backward=False, module="unique")
def contract_columns(
    source: wp.array(dtype=Any),
    n_v: wp.int32,
    n_w: wp.int32,
    inner: wp.int32,
    span_v: wp.array(dtype=wp.int32),
    values_v: wp.array(dtype=Any),
    degree_v: wp.int32,
    out_v: wp.int32,
    span_w: wp.array(dtype=wp.int32),
    values_w: wp.array(dtype=Any),
    degree_w: wp.int32,
    out_w: wp.int32,
    part: wp.int32,
    target: wp.array(dtype=Any),
    first: wp.int32,
):
    """v and w axes on a GPU: source (n_channels, n_w, n_v, inner) -> target (n_channels, out_w, out_v, inner).

    Launched over (n_channels * parts, bands * chunks * TILE_ROWS * TILE): a part is ``part`` planes, a band TILE_ROWS
    rows, a chunk 4 * TILE of ``inner``. A work item goes along w at four places of its chunk, TILE apart; chunks begin
    where the memory's blocks do. Sums along v stay in registers, the oldest first, 0 beyond those of a span.
    """
    tid_group, item = wp.tid()
    group = tid_group + first
    n_parts = (out_w + part - 1) // part
    n_chunks = (inner + TILE - 1 + 4 * TILE - 1) // (4 * TILE)
    tile = item // TILE
    j = tile // (TILE_ROWS * n_chunks) * TILE_ROWS + tile % TILE_ROWS
    if j >= out_v:
        return
    channel = group // n_parts
    k = group % n_parts * part
    end = wp.min(k + part, out_w)
    row = ((channel * out_w + k) * out_v + j) * inner
    begin = tile // TILE_ROWS % n_chunks * (4 * TILE) + item % TILE - row % TILE
    if begin >= inner:
        return
    i = wp.max(begin, 0)
    o1 = wp.clamp(begin + TILE, 0, inner - 1) - i
    o2 = wp.clamp(begin + 2 * TILE, 0, inner - 1) - i
    o3 = wp.clamp(begin + 3 * TILE, 0, inner - 1) - i
    rows = (channel * n_w * n_v + element(span_v, j) - degree_v) * inner + i
    to = row + i
    v0 = weight(values_v, 0, degree_v, j, out_v)
    v1 = weight(values_v, 1, degree_v, j, out_v)
    v2 = weight(values_v, 2, degree_v, j, out_v)
    v3 = weight(values_v, 3, degree_v, j, out_v)
    v4 = weight(values_v, 4, degree_v, j, out_v)
    v5 = weight(values_v, 5, degree_v, j, out_v)
    none = target.dtype(0.0) * places(source, rows, o1, o2, o3)
    r0 = none
    r1 = none
    r2 = none
    r3 = none
    r4 = none
    r5 = none
    newest = wp.int32(-1)
    while k < end:
        last = element(span_w, k)
        if last < newest:  # parameters that run back: anew
            newest = -1
        newest = wp.max(newest, last - degree_w - 1)
        while newest < last:
            newest = newest + 1
            at = rows + newest * n_v * inner
            total = v0 * places(source, at, o1, o2, o3) + v1 * places(source, at + inner, o1, o2, o3)
            if degree_v > 1:
                total = total + v2 * places(source, at + 2 * inner, o1, o2, o3)
            if degree_v > 2:
                total = total + v3 * places(source, at + 3 * inner, o1, o2, o3)
            if degree_v > 3:
                total = total + v4 * places(source, at + 4 * inner, o1, o2, o3)
            if degree_v > 4:
                total = total + v5 * places(source, at + 5 * inner, o1, o2, o3)
            r0 = r1
            r1 = wp.where(degree_w == 1, total, r2)
            r2 = wp.where(degree_w == 2, total, r3)
            r3 = wp.where(degree_w == 3, total, r4)
            r4 = wp.where(degree_w == 4, total, r5)
            r5 = wp.where(degree_w == 5, total, none)
        node = element(values_w, k) * r0 + element(values_w, out_w + k) * r1
        node = node + element(values_w, wp.min(degree_w, 2) * out_w + k) * r2
        node = node + element(values_w, wp.min(degree_w, 3) * out_w + k) * r3
        node = node + element(values_w, wp.min(degree_w, 4) * out_w + k) * r4
        node = node + element(values_w, wp.min(degree_w, 5) * out_w + k) * r5
        stream(target, to, node[0])
        stream(target, to + o1, node[1])
        stream(target, to + o2, node[2])
        stream(target, to + o3, node[3])
        to = to + out_v * inner
        k = k + 1


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
    span_u: wp.array(dtype=wp.int32),
    span_v: wp.array(dtype=wp.int32),
    span_w: wp.array(dtype=wp.int32),
    values_u: wp.array(dtype=Any),
    values_v: wp.array(dtype=Any),
    values_w: wp.array(dtype=Any),
    n: wp.int32,
    out: wp.array(dtype=Any),
    first: wp.int32,
):
    """Scattered points: control (n_channels, n_w, n_v, n_u) planes, out (n_channels, n) planes."""
    tid_channel, i = wp.tid()
    channel = tid_channel + first
    total = out.dtype(0.0)
    for c in range(degree_w + 1):
        total_v = out.dtype(0.0)
        for b in range(degree_v + 1):
            row = ((channel * n_w) + span_w[i] - degree_w + c) * n_v + span_v[i] - degree_v + b
            start = row * n_u + span_u[i] - degree_u
            total_u = out.dtype(0.0)
            for a in range(degree_u + 1):
                total_u = total_u + values_u[a * n + i] * control[start + a]
            total_v = total_v + values_v[b * n + i] * total_u
        total = total + values_w[c * n + i] * total_v
    out[wp.int64(channel) * wp.int64(n) + wp.int64(i)] = total


@wp.kernel(enable_backward=False, module="unique")
def divide_by_weight(planes: wp.array(dtype=Any), n_channels: wp.int32, n: wp.int32, first: wp.int32):
    """NURBS: divide each of n_channels planes of n values by the weight plane that follows them."""
    i = wp.int64(wp.tid() + first)
    count = wp.int64(n)
    inverse = planes.dtype(1.0) / planes[wp.int64(n_channels) * count + i]
    for channel in range(n_channels):
        at = wp.int64(channel) * count + i
        planes[at] = planes[at] * inverse
