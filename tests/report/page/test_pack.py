"""Packed numbers come back; quantised values are within half a step."""

import base64
import zlib
from typing import Any

import numpy as np
import pytest

from gpubspline.report.page.pack import LEVELS, pack, quantise


def unpacked(packed: dict[str, Any]) -> np.ndarray:
    """The other way, as ``unpack.js`` goes it."""
    planes = np.frombuffer(zlib.decompress(base64.b64decode(packed["data"])), dtype=np.uint8)
    steps = planes.reshape(packed["width"], packed["n"]).astype(np.uint64)
    numbers = sum(plane << np.uint64(8 * place) for place, plane in enumerate(steps))
    return np.cumsum(numbers).astype(f"u{packed['width']}")


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.uint32])
def test_packed_numbers_come_back(dtype: Any) -> None:
    ends = np.iinfo(dtype)
    numbers = np.random.default_rng(3).integers(0, ends.max, 1000, endpoint=True, dtype=dtype)
    numbers[:4] = 0, ends.max, 0, 1
    np.testing.assert_array_equal(unpacked(pack(numbers)), numbers)
    assert pack(numbers[:0])["n"] == 0


def test_quantised_values_are_within_half_a_step() -> None:
    values = np.random.default_rng(4).normal(size=500) * 100
    steps, low, high = quantise(values)
    np.testing.assert_allclose(low + steps * (high - low) / LEVELS, values, atol=0.5001 * (high - low) / LEVELS)
    assert (low, high) == (values.min(), pytest.approx(values.max()))
    moduli = np.geomspace(1e-2, 2e4, 500)
    steps, low, high = quantise(moduli, logarithmic=True)
    np.testing.assert_allclose(low * (high / low) ** (steps / LEVELS), moduli, rtol=2e-4)


def test_one_value_and_what_is_not_finite() -> None:
    steps, low, high = quantise(np.full(4, 7.0))
    assert (steps == 0).all() and low == 7.0 and high > low
    steps, low, high = quantise(np.array([1.0, np.nan, 3.0, np.inf]))
    assert steps.tolist() == [0, 0, LEVELS, 0] and (low, high) == (1.0, 3.0)
