"""Arrays as text for a page: whole numbers, differences of neighbours, bytes by their place, deflated, base64."""

import base64
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

LEVELS = 65535
"""Steps between the least and the greatest of quantised values."""


def pack(numbers: NDArray[Any]) -> dict[str, Any]:
    """Pack whole numbers (n,) of 1, 2 or 4 bytes; ``unpack`` of ``page.js`` is the other way.

    Neighbours are alike, so their differences (modulo the type's range) are small, and bytes of one place are alike:
    deflate makes a third of what it makes of the numbers themselves.
    """
    flat = np.ascontiguousarray(numbers).reshape(-1)
    width = flat.dtype.itemsize
    unsigned = flat.view(f"u{width}").astype(f"<u{width}")
    steps = np.diff(unsigned, prepend=unsigned.dtype.type(0))
    planes = steps.view(np.uint8).reshape(-1, width).T
    return {"n": flat.size, "width": width, "data": base64.b64encode(zlib.compress(planes.tobytes(), 6)).decode()}


def quantise(values: NDArray[Any], logarithmic: bool = False) -> tuple[NDArray[np.uint16], float, float]:
    """Bring values (n,) to whole numbers of ``LEVELS`` steps.

    Returns
    -------
    The numbers and what 0 and ``LEVELS`` stand for. Values that are not finite are taken as the least.
    """
    wide = np.asarray(values, dtype=np.float64)
    wide = np.log(wide) if logarithmic else wide
    known = wide[np.isfinite(wide)]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 0.0)
    span = high - low if high > low else 1.0
    steps = np.round((np.where(np.isfinite(wide), wide, low) - low) * (LEVELS / span))
    low, high = (float(np.exp(end)) for end in (low, low + span)) if logarithmic else (low, low + span)
    return steps.astype(np.uint16), low, high
