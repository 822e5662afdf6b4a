"""Limit and order: exact for series that follow them, for any three meshes or more; what has no limit says so."""

import numpy as np
import pytest

from gpubspline.analysis.richardson import extrapolate
from gpubspline.errors import InputError


def sizes(elements):
    return np.asarray(elements, dtype=float) ** (-1 / 3)


@pytest.mark.parametrize("order", [0.7, 1.0, 1.5, 2.0, 4.0])
@pytest.mark.parametrize("elements", [(1000, 8000, 64000), (1350, 2057, 4312, 9000, 12000, 15840, 27000)], ids=len)
@pytest.mark.parametrize("amplitude", [3.0, -40.0])
def test_a_series_gives_back_the_order_and_limit_that_made_it(order, elements, amplitude):
    h = sizes(elements)
    found = extrapolate(h, 100 + amplitude * (h / h[0]) ** order)
    assert found.order == pytest.approx(order, abs=1e-5) and found.limit == pytest.approx(100, rel=1e-7)
    assert found.meshes == max(3, (len(elements) + 1) // 2) and found.note == ""


def test_meshes_may_come_in_any_order_and_any_unit():
    h = sizes([1000, 2000, 4000, 8000])
    value = 5 - 2 * h**2
    one, other = extrapolate(h, value), extrapolate(1e3 * h[[2, 0, 3, 1]], value[[2, 0, 3, 1]])
    assert one.order == pytest.approx(other.order, rel=1e-6) and one.limit == pytest.approx(other.limit, rel=1e-9)


def test_three_meshes_halved_are_the_textbooks_formula():
    """p = log2 of the ratio of the steps, limit = f3 + (f3 - f2) / (2^p - 1)."""
    found = extrapolate([4, 2, 1], [0.80, 0.95, 0.98])
    order = np.log2(0.15 / 0.03)
    assert found.order == pytest.approx(order, abs=1e-6)
    assert found.limit == pytest.approx(0.98 + 0.03 / (2**order - 1), rel=1e-7)


@pytest.mark.parametrize(
    ("value", "note"),
    [
        ([1.0, 1.2, 1.1], "it goes up and down over the finest 3 meshes"),
        ([1.0, 1.1, 1.3], "do not shrink"),
        ([1.0, 2.0, 2.0 + 1e-6], "no order up to 8"),
        ([1.0, 1.0], "three meshes are needed, there are 2"),
        ([2.0, 2.0, 2.0], "agree to 1e-09"),
    ],
)
def test_what_has_no_order_says_why(value, note):
    found = extrapolate(2.0 ** -np.arange(len(value)), value)
    assert found.order is None and note in found.note
    assert found.to_dict() == {"limit": found.limit, "order": None, "meshes": found.meshes, "note": found.note}
    assert (found.limit is None) == ("agree" not in note and "no order up" not in note)


def test_a_limit_far_away_is_a_guess():
    found = extrapolate([3.0, 2.0, 1.5], [29.3, 22.8, 19.1])
    assert found.limit is None and found.order is not None and "would move the finest by" in found.note


def test_a_series_whose_coarse_meshes_turn_round_is_judged_by_its_finer_half():
    h = sizes([500, 1000, 2000, 4000, 8000, 16000])
    value = 10 + (h / h[0]) ** 2
    value[:2] = [9, 12]
    assert extrapolate(h, value).order == pytest.approx(2, abs=1e-5)


@pytest.mark.parametrize(("size", "value"), [([1, 1, 2], [1, 2, 3]), ([1, 2], [1]), ([1, 0, 2], [1, 2, 3])])
def test_what_is_no_series_is_refused(size, value):
    with pytest.raises(InputError, match="different sizes"):
        extrapolate(size, value)


def test_a_value_that_is_not_finite_is_refused():
    with pytest.raises(InputError, match="finite"):
        extrapolate([1, 2, 3], [1, np.nan, 3])
