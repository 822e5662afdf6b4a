"""The sums of a patch on a device: a direction at a time on a grid, all of them at scattered points."""

from collections.abc import Sequence
from itertools import chain
from math import gcd, prod
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpubspline.device import Buffer, Device

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


class Direction(NamedTuple):
    """Knots of one direction of a patch, and the parameters where its basis, or a derivative of an order, is wanted."""

    knots: NDArray[np.float64]
    degree: int
    parameters: NDArray[np.float64]
    order: int = 0


NO_DIRECTION = Direction(np.array([0.0, 1.0]), 0, np.empty(0))

Origin = tuple[float, float, float]
"""x, y, z that are added to the first three channels when the sums are made, each once: float32 has digits to spare
where places are from the middle of a patch, not at the scanner's."""

NO_ORIGIN = (0.0, 0.0, 0.0)


def _bases(device: Device, directions: Sequence[Direction]) -> tuple[Buffer, Buffer]:
    """Spans (N,) and values (degree + 1, N) of the N parameters of all directions, one after another."""
    three = (*directions, NO_DIRECTION)[:3]
    each = [(way.degree, len(way.knots) - way.degree - 1, len(way.parameters), way.order) for way in three]
    given = np.concatenate([*(way.knots for way in three), *(way.parameters for way in three)])
    count = sum(len(way.parameters) for way in three)
    span, values = device.empty(count, np.int32), device.empty((max(way.degree for way in three) + 1, count))
    device.launch("basis.basis_functions", count, device.put(given), *chain(*each), span, values)
    return span, values


def contract_grid(
    device: Device, control: Buffer, shape: tuple[int, ...], directions: Sequence[Direction], origin: Origin = NO_ORIGIN
) -> tuple[Buffer, int]:
    """Evaluate a grid one direction at a time, u first; the last pass writes each node once.

    Arguments
    ---------
    control: (K, [n_w,] n_v, n_u) planes on the device.
    shape: (n_u, n_v[, n_w], K).
    directions: u, v and, of a solid, w.
    origin: what the first three channels are from.

    Returns
    -------
    Buffer (K, N) of planes, and N. The same numbers come from all devices, in one launch or in three.
    """
    span, values = _bases(device, directions)
    counts, degrees = [len(way.parameters) for way in directions], [way.degree for way in directions]
    if len(directions) == 3 and device.cores:
        return _contract_solid(device, control, shape, span, values, degrees, counts, origin)
    inner, rows = counts[0], prod(shape[1:])
    source = device.empty(rows * inner + (TILE_PLACES - 1) * TILE)  # columns read past the last row
    rows_of = (control, rows, ROW_BLOCK, shape[0], span, values, sum(counts), degrees[0], inner, source)
    device.launch("patch.contract_rows", (-(-rows // ROW_BLOCK), inner), *rows_of)
    if len(directions) == 3:
        return _contract_columns(device, source, shape, span, values, degrees, counts, origin)
    n_channels, count = shape[2], counts[1]
    target = device.empty((n_channels, count * inner))
    arguments = (source, shape[1], inner, span, values, degrees[1], count, PLANE_BLOCK, *origin, target)
    device.launch("patch.contract", (n_channels, -(-count // PLANE_BLOCK), inner), *arguments)
    return target, count * inner


def _contract_columns(
    device: Device,
    source: Buffer,
    shape: tuple[int, ...],
    span: Buffer,
    values: Buffer,
    degrees: list[int],
    counts: list[int],
    origin: Origin,
) -> tuple[Buffer, int]:
    """The second and third direction at once on a GPU, so that what is between them is never written."""
    (_, n_v, n_w, n_channels), (inner, out_v, out_w), (_, degree_v, degree_w) = shape, counts, degrees
    count = out_w * out_v * inner
    target, planes = device.empty((n_channels, count)), COLUMN_PLANES[count >= LARGE_GRID]
    chunks = -(-(inner + TILE - 1) // (TILE_PLACES * TILE))
    items = (n_channels * -(-out_w // planes), -(-out_v // TILE_ROWS) * chunks * TILE_ROWS * TILE)
    arguments = (source, n_v, n_w, inner, span, values, degree_v, out_v, degree_w, out_w, planes, *origin, target)
    device.launch("columns.contract_columns", items, *arguments)
    return target, count


def _contract_solid(
    device: Device,
    control: Buffer,
    shape: tuple[int, ...],
    span: Buffer,
    values: Buffer,
    degrees: list[int],
    counts: list[int],
    origin: Origin,
) -> tuple[Buffer, int]:
    """All passes at once, band by band, so that what is between them never leaves a core's cache."""
    n_u, n_v, n_w, n_channels = shape
    row_bytes, n_planes = counts[0] * device.real.itemsize, degrees[2] + 1
    spared_bytes = (n_planes + SPARE_PLANES) * SPARE_ROWS * row_bytes
    if degrees[2] >= SPARE_DEGREE and spared_bytes <= RING_BYTES:
        n_planes += SPARE_PLANES
    band = _band(counts, n_v, degrees[1], max(RING_BYTES // (n_planes * row_bytes), 1))
    n_bands = -(-counts[1] // band)
    part = _evenly(counts[2], max(counts[2] * n_bands * n_channels // (ITEMS_PER_CORE * device.cores), 1))
    items = n_bands * -(-counts[2] // part) * n_channels
    packed = (n_u + 2 * MOST_LANES) * MOST_LANES
    rows = (degrees[1] + MOST_LANES) * (counts[0] + MOST_LANES)
    item_size = packed + rows + n_planes * (band * counts[0] + 2 * MOST_LANES)
    item_size = -(-item_size // MOST_LANES) * MOST_LANES
    scratch, target = device.empty((items, item_size)), device.empty((n_channels, prod(counts)))
    each = (span, values, *chain(*zip(degrees, counts, strict=True)))
    over = (band, part, n_planes, item_size, *origin, scratch, scratch, target)
    device.launch("bands.contract_solid", (items, 1, counts[0]), control, n_channels, n_u, n_v, n_w, *each, *over)
    return target, prod(counts)


def _band(counts: list[int], n_v: int, degree: int, most: int) -> int:
    """Rows of a band, at most or about ``most``: so many that the control points of all bands fill the fewest blocks.

    Rows of control points go along u in blocks of as many as there are lanes, whether or not the band needs them all.
    """
    fewest = -(-counts[1] // most)
    aligned = MOST_LANES // gcd(MOST_LANES, counts[0])  # rows, after which a vector begins
    bands = [-(-counts[1] // n) for n in range(fewest, min(2 * fewest, counts[1]) + 1)]
    bands = [-(-band // aligned) * aligned if aligned <= band else band for band in bands]

    def blocks(band: int) -> int:
        rows = -(-band * (n_v - degree) // counts[1]) + degree  # as spans are even
        return -(-counts[1] // band) * -(-rows // MOST_LANES)

    return min(bands, key=blocks)


def _evenly(total: int, most: int) -> int:
    """Size of equal shares of a total, at most ``most``."""
    return -(-total // -(-total // most))


def contract_points(
    device: Device, control: Buffer, shape: tuple[int, ...], directions: Sequence[Direction], origin: Origin = NO_ORIGIN
) -> tuple[Buffer, int]:
    """Evaluate scattered points; arguments and result as of ``contract_grid``.

    A surface is a solid of one layer and degree 0 in w.
    """
    count = len(directions[0].parameters)
    if len(directions) == 2:
        directions = (*directions, NO_DIRECTION._replace(parameters=np.zeros(count)))
        shape = (*shape[:2], 1, shape[2])
    span, values = _bases(device, directions)
    target = device.empty((shape[3], count))
    degrees = (way.degree for way in directions)
    arguments = (control, shape[3], *shape[:3], *degrees, span, values, count, *origin, target)
    device.launch("patch.evaluate_points", (shape[3], count), *arguments)
    return target, count
