"""A solid patch on a GPU: the passes along v and w in one launch, what is between them in registers."""

from typing import Any

import warp as wp

from gpubspline.kernels.lanes import element, stream
from gpubspline.kernels.span_sum import origin_of, weight

TILE = wp.constant(32)  # neighbours along u that a group of threads writes at once
TILE_ROWS = wp.constant(8)  # such tiles along v, which read the same rows of control points


@wp.func
def places(source: wp.array(dtype=Any), at: wp.int32):
    """Four numbers, TILE apart."""
    return wp.vector(
        element(source, at), element(source, at + TILE), element(source, at + 2 * TILE), element(source, at + 3 * TILE)
    )


@wp.func
def along_v(source: wp.array(dtype=Any), at: wp.int32, inner: wp.int32, degree: wp.int32, v: Any):
    """Sums along v of the plane that begins at ``at``, at four places."""
    total = v[0] * places(source, at) + v[1] * places(source, at + inner)
    if degree > 1:
        total = total + v[2] * places(source, at + 2 * inner)
    if degree > 2:
        total = total + v[3] * places(source, at + 3 * inner)
    if degree > 3:
        total = total + v[4] * places(source, at + 4 * inner)
    if degree > 4:
        total = total + v[5] * places(source, at + 5 * inner)
    return total


@wp.func
def along_w(
    degree: wp.int32,
    source: wp.array(dtype=Any),
    rows: wp.int32,
    layer: wp.int32,
    inner: wp.int32,
    degree_v: wp.int32,
    v: Any,
    span: wp.array(dtype=wp.int32),
    values: wp.array(dtype=Any),
    n_all: wp.int32,
    begin: wp.int32,
    end: wp.int32,
    origin: Any,
    target: wp.array(dtype=Any),
    at: wp.int32,
    plane: wp.int32,
    left: wp.int32,
):
    """Go along w; one copy a degree, so that only the sums of its span are kept and added, the oldest first."""
    none = v[0] * places(source, rows)
    r0 = none
    r1 = none
    r2 = none
    r3 = none
    r4 = none
    r5 = none
    newest = wp.int32(-1)
    to = wp.int32(at)
    for k in range(begin, end):
        last = element(span, k)
        if last < newest:  # parameters that run back: anew
            newest = -1
        newest = wp.max(newest, last - degree - 1)
        while newest < last:
            newest = newest + 1
            total = along_v(source, rows + newest * layer, inner, degree_v, v)
            r0 = r1
            r1 = wp.where(degree == 1, total, r2)
            r2 = wp.where(degree == 2, total, r3)
            r3 = wp.where(degree == 3, total, r4)
            r4 = wp.where(degree == 4, total, r5)
            r5 = total
        node = element(values, k) * r0 + element(values, n_all + k) * r1
        if degree > 1:
            node = node + element(values, 2 * n_all + k) * r2
        if degree > 2:
            node = node + element(values, 3 * n_all + k) * r3
        if degree > 3:
            node = node + element(values, 4 * n_all + k) * r4
        if degree > 4:
            node = node + element(values, 5 * n_all + k) * r5
        stream(target, to, node[0] + origin)
        if left > TILE:
            stream(target, to + TILE, node[1] + origin)
        if left > 2 * TILE:
            stream(target, to + 2 * TILE, node[2] + origin)
        if left > 3 * TILE:
            stream(target, to + 3 * TILE, node[3] + origin)
        to = to + plane


@wp.kernel(enable_backward=False, module="unique")
def contract_columns(
    source: wp.array(dtype=Any),
    n_v: wp.int32,
    n_w: wp.int32,
    inner: wp.int32,
    span: wp.array(dtype=wp.int32),
    values: wp.array(dtype=Any),
    degree_v: wp.int32,
    out_v: wp.int32,
    degree_w: wp.int32,
    out_w: wp.int32,
    part: wp.int32,
    x0: Any,
    y0: Any,
    z0: Any,
    target: wp.array(dtype=Any),
    first: wp.int32,
):
    """v and w axes on a GPU: source (n_channels, n_w, n_v, inner) -> target (n_channels, out_w, out_v, inner).

    Launched over (n_channels * parts, bands * chunks * TILE_ROWS * TILE): a part is ``part`` planes, a band TILE_ROWS
    rows, a chunk 4 * TILE of ``inner``. A work item goes along w at four places of its chunk, TILE apart; chunks begin
    where the memory's blocks do. What lies beyond a row is read and not used, up to 3 * TILE numbers behind the last of
    ``source``. The first three channels are places from (x0, y0, z0).
    """
    tid_group, item = wp.tid()
    n_uv = inner + out_v  # parameters; those of v are behind those of u, those of w behind them
    n_all = n_uv + out_w
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
    i = tile // TILE_ROWS % n_chunks * (4 * TILE) + item % TILE - row % TILE
    count = wp.int32(4)
    if i < 0:  # before the row: its next three
        i = i + TILE
        count = 3
    if i >= inner:
        return
    v = wp.vector(
        element(values, inner + j),
        element(values, n_all + inner + j),
        weight(values, 2, degree_v, inner + j, n_all),
        weight(values, 3, degree_v, inner + j, n_all),
        weight(values, 4, degree_v, inner + j, n_all),
        weight(values, 5, degree_v, inner + j, n_all),
    )
    rows = (channel * n_w * n_v + element(span, inner + j) - degree_v) * inner + i
    layer = n_v * inner
    step = out_v * inner
    to = row + i
    left = wp.min(inner - i, count * TILE)
    k = n_uv + k
    end = n_uv + end
    origin = origin_of(channel, x0, y0, z0)
    if degree_w == 1:
        along_w(1, source, rows, layer, inner, degree_v, v, span, values, n_all, k, end, origin, target, to, step, left)
    if degree_w == 2:
        along_w(2, source, rows, layer, inner, degree_v, v, span, values, n_all, k, end, origin, target, to, step, left)
    if degree_w == 3:
        along_w(3, source, rows, layer, inner, degree_v, v, span, values, n_all, k, end, origin, target, to, step, left)
    if degree_w == 4:
        along_w(4, source, rows, layer, inner, degree_v, v, span, values, n_all, k, end, origin, target, to, step, left)
    if degree_w == 5:
        along_w(5, source, rows, layer, inner, degree_v, v, span, values, n_all, k, end, origin, target, to, step, left)
