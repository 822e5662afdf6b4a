"""The sums of a patch on a device: a direction at a time on a grid, all of them at scattered points."""

from math import gcd, prod

import numpy as np
from numpy.typing import NDArray

from gpubspline.device import Buffer, Device

Basis = tuple[Buffer, Buffer, int]
"""Span (N,) and values (degree + 1, N) of one direction, and N."""

ROW_BLOCK = 8  # rows of control points that share their weights in a work item
PLANE_BLOCK = 8  # planes of nodes that share their control planes in a work item
RING_BYTES = 400 << 10  # planes that wait for the last pass: half of a core's second cache or less
SPARE_PLANES = 3  # of them, where reading them bounds the last pass: several spans are made of what is read once
SPARE_DEGREE = 5  # from which it does: 0.91 of the time with; 0.96 to 1.05 for lower ones, by Warp 1.1
SPARE_ROWS = 32  # of a band, below which the rows that two bands both make cost more
ITEMS_PER_CORE = 4  # so that cores which are held up leave work to others
MOST_LANES = 32
COLUMN_PLANES = (32, 128)  # of nodes, along which a work item of a GPU goes: of a small grid, and of a large one
LARGE_GRID = 1 << 26  # nodes
TILE = 32  # of a GPU, as in its kernel
TILE_ROWS = 8
TILE_PLACES = 4


def basis(
    device: Device, knots: NDArray[np.float64], degree: int, parameters: NDArray[np.float64], order: int
) -> Basis:
    """Basis functions, or their derivatives of an order, at the parameters of one direction."""
    count = len(parameters)
    span, values = device.empty(count, np.int32), device.empty((degree + 1, count))
    n_control = len(knots) - degree - 1
    arguments = (device.put(knots), degree, n_control, device.put(parameters), count, order, span, values)
    device.launch("basis.basis_functions", count, *arguments)
    return span, values, count


def contract_grid(
    device: Device, control: Buffer, shape: tuple[int, ...], degrees: tuple[int, ...], bases: list[Basis]
) -> tuple[Buffer, int]:
    """Evaluate a grid one direction at a time, u first; the last pass writes each node once.

    Arguments
    ---------
    control: (K, [n_w,] n_v, n_u) planes on the device.
    shape: (n_u, n_v[, n_w], K).

    Returns
    -------
    Buffer (K, N) of planes, and N. The same numbers come from all devices, in one launch or in three.
    """
    if len(bases) == 3 and device.cores:
        return _contract_solid(device, control, shape, degrees, bases)
    (span, values, inner), degree = bases[0], degrees[0]
    rows = prod(shape[1:])
    source = device.empty(rows * inner + (TILE_PLACES - 1) * TILE)  # columns read past the last row
    rows_of = (control, rows, ROW_BLOCK, shape[0], span, values, degree, inner, source)
    device.launch("patch.contract_rows", (-(-rows // ROW_BLOCK), inner), *rows_of)
    if len(bases) == 3:
        return _contract_columns(device, source, shape, degrees, bases)
    span, values, count = bases[1]
    target = device.empty((shape[2], count * inner))
    arguments = (source, shape[1], inner, span, values, degrees[1], count, PLANE_BLOCK, target)
    device.launch("patch.contract", (shape[2], -(-count // PLANE_BLOCK), inner), *arguments)
    return target, count * inner


def _contract_columns(
    device: Device, source: Buffer, shape: tuple[int, ...], degrees: tuple[int, ...], bases: list[Basis]
) -> tuple[Buffer, int]:
    """The second and third direction at once on a GPU, so that what is between them is never written."""
    (_, n_v, n_w, n_channels), (inner, out_v, out_w) = shape, [count for _, _, count in bases]
    count = out_w * out_v * inner
    target, planes = device.empty((n_channels, count)), COLUMN_PLANES[count >= LARGE_GRID]
    chunks = -(-(inner + TILE - 1) // (TILE_PLACES * TILE))
    items = (n_channels * -(-out_w // planes), -(-out_v // TILE_ROWS) * chunks * TILE_ROWS * TILE)
    each = [
        value for basis, degree in zip(bases[1:], degrees[1:], strict=True) for value in (*basis[:2], degree, basis[2])
    ]
    device.launch("columns.contract_columns", items, source, n_v, n_w, inner, *each, planes, target)
    return target, count


def _contract_solid(
    device: Device, control: Buffer, shape: tuple[int, ...], degrees: tuple[int, ...], bases: list[Basis]
) -> tuple[Buffer, int]:
    """All passes at once, band by band, so that what is between them never leaves a core's cache."""
    (n_u, n_v, n_w, n_channels), counts = shape, [count for _, _, count in bases]
    row_bytes, n_planes = counts[0] * device.real.itemsize, degrees[2] + 1
    spared_bytes = (n_planes + SPARE_PLANES) * SPARE_ROWS * row_bytes
    if degrees[2] >= SPARE_DEGREE and spared_bytes <= RING_BYTES:
        n_planes += SPARE_PLANES
    band = _evenly(counts[1], max(RING_BYTES // (n_planes * row_bytes), 1))
    aligned = MOST_LANES // gcd(MOST_LANES, counts[0])  # rows, after which a vector begins
    if aligned <= band:
        band = -(-band // aligned) * aligned
    n_bands = -(-counts[1] // band)
    part = _evenly(counts[2], max(counts[2] * n_bands * n_channels // (ITEMS_PER_CORE * device.cores), 1))
    items = n_bands * -(-counts[2] // part) * n_channels
    packed = (n_u + 2 * MOST_LANES) * MOST_LANES
    rows = (degrees[1] + MOST_LANES) * (counts[0] + MOST_LANES)
    item_size = packed + rows + n_planes * (band * counts[0] + 2 * MOST_LANES)
    item_size = -(-item_size // MOST_LANES) * MOST_LANES
    scratch, target = device.empty((items, item_size)), device.empty((n_channels, prod(counts)))
    each = [value for basis, degree in zip(bases, degrees, strict=True) for value in (*basis[:2], degree, basis[2])]
    arguments = (control, n_channels, n_u, n_v, n_w, *each, band, part, n_planes, item_size, scratch, scratch, target)
    device.launch("bands.contract_solid", (items, 1, counts[0]), *arguments)
    return target, prod(counts)


def _evenly(total: int, most: int) -> int:
    """Size of equal shares of a total, at most ``most``."""
    return -(-total // -(-total // most))


def contract_points(
    device: Device, control: Buffer, shape: tuple[int, ...], degrees: tuple[int, ...], bases: list[Basis]
) -> tuple[Buffer, int]:
    """Evaluate scattered points; arguments and result as of ``contract_grid``.

    A surface is a solid of one layer and degree 0 in w.
    """
    count = bases[0][2]
    if len(bases) == 2:
        ones = device.put(np.ones(count)), device.put(np.zeros(count, np.int32))
        bases, shape, degrees = [*bases, (ones[1], ones[0], count)], (*shape[:2], 1, shape[2]), (*degrees, 0)
    target = device.empty((shape[3], count))
    spans, values = [basis[0] for basis in bases], [basis[1] for basis in bases]
    arguments = (control, shape[3], *shape[:3], *degrees, *spans, *values, count, target)
    device.launch("patch.evaluate_points", (shape[3], count), *arguments)
    return target, count
