"""A solid patch on a GPU: the passes along v and w in one launch, what is between them in registers."""

from typing import Any

import warp as wp

from gpubspline.kernels.lanes import element, stream
from gpubspline.kernels.span_sum import weight

TILE = wp.constant(32)  # neighbours along u that a group of threads writes at once
TILE_ROWS = wp.constant(8)  # such tiles along v, which read the same rows of control points


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
