"""Product of vectors on a device, the same each time and on every device's number of threads."""

import numpy as np

from gpubspline.device import Buffer, Device

PARTS = 4096
"""Partial sums of a product, added on the host in float64."""


def inner_product(device: Device, x: Buffer, y: Buffer, n: int) -> float:
    """Sum of the n products of the numbers of x and y."""
    parts = device.empty(PARTS)
    device.launch("vectors.product", PARTS, x, y, n, PARTS, parts)
    return float(device.get(parts).sum(dtype=np.float64))
