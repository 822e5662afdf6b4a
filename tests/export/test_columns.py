"""Fields of a fixed width: no wider, with a decimal point, and of as many digits as they hold."""

import io

import numpy as np
import pytest

from gpubspline.errors import InputError
from gpubspline.export.columns import Fixed, write_lines


def written(values: np.ndarray, width: int) -> list[str]:
    out = io.TextIOWrapper(io.BytesIO())
    write_lines(out, "{}", [Fixed(values, width)])
    out.flush()
    return out.buffer.getvalue().decode().splitlines()  # type: ignore[attr-defined]


@pytest.mark.parametrize(("width", "digits"), [(10, 3), (16, 9), (21, 14)])
@pytest.mark.parametrize("real", [np.float32, np.float64])
def test_reals_keep_their_width_and_the_digits_that_fit(width: int, digits: int, real: type) -> None:
    """Of every size that the type has in full, either sign, and where rounding needs one digit more."""
    rng = np.random.default_rng(1)
    most = 37 if real is np.float32 else 300
    values = rng.uniform(1, 10, 4000) * 10.0 ** rng.integers(-most, most, 4000) * rng.choice([-1, 1], 4000)
    hard = [0.0, 123456789.0, -99999999.5, 0.99999999999, -0.9999999, 6.00000000000001e-16, 1e15, 1e16, -1e-4, -1e-5]
    values = np.concatenate([values, hard]).astype(real)
    lines = written(values, width)
    assert {len(line) for line in lines} == {width} and all("." in line for line in lines)
    size = np.maximum(np.abs(values.astype(np.float64)), 1e-300)
    off = np.abs(np.array([float(line) for line in lines]) - values.astype(np.float64)) / size
    assert off.max() <= 5 * 10.0 ** -min(digits, 7 if real is np.float32 else 99)


def test_large_numbers_keep_as_many_digits_as_others() -> None:
    """Bone's modulus in pascals: three digits of it were off by half a per cent."""
    assert written(np.array([1.73456789e10, -1.73456789e10, 9.99999e9, 1.73456789e100]), 10) == [
        "1.7346e+10",
        "-1.735e+10",
        "1.0000e+10",
        "1.735e+100",
    ]


def test_a_label_too_long_is_refused() -> None:
    assert written(np.array([1, 99_999_999]), 8) == ["       1", "99999999"]
    with pytest.raises(InputError, match="labels of at most 8 digits for this format, got 100000000"):
        written(np.array([100_000_000]), 8)
