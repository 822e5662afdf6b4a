"""Products of vectors on a device, the same each time and on every device's number of threads."""

import numpy as np
from numpy.typing import NDArray

from gpubspline.device import Buffer, Device

PARTS = 4096
"""Partial sums of a product, added on the host in float64."""


def products(device: Device, x: Buffer, y: Buffer, n: int, *, row: int = 0, rows: int = 1) -> NDArray[np.float64]:
    """Products (rows,) of a row of x with each row of y, of n numbers each, rows one after the other.

    Arguments
    ---------
    x: (., n), of which ``row`` is taken; y: (rows, n).
    """
    parts = device.empty((rows, PARTS))
    device.launch("vectors.row_products", rows * PARTS, x, row, y, rows, n, PARTS, parts)
    return np.asarray(device.get(parts).reshape(rows, PARTS).sum(axis=1, dtype=np.float64))
