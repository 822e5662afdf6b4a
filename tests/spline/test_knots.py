"""Knot vectors against their definitions and against scipy."""

import numpy as np
import pytest
from scipy.interpolate import BSpline, make_interp_spline

from gpubspline.errors import InputError
from gpubspline.spline.knots import averaged, check_knots, clamped_uniform, greville, inserted, normalised


@pytest.mark.parametrize("degree", [1, 2, 3, 4, 5])
def test_clamped_uniform_has_even_spans(degree: int) -> None:
    knots = clamped_uniform(9, degree)
    check_knots(knots, degree, 9)
    inner = knots[degree:-degree]
    assert np.allclose(np.diff(inner), 1 / (9 - degree), rtol=1e-14)


@pytest.mark.parametrize("degree", [1, 2, 3, 4, 5])
def test_greville_abscissae_make_the_identity(degree: int) -> None:
    knots = clamped_uniform(8, degree)
    t = np.linspace(0, 1, 57)
    assert np.allclose(BSpline(knots, greville(knots, degree), degree)(t), t, atol=1e-14)


@pytest.mark.parametrize("degree", [1, 3, 5])
def test_averaged_knots_are_those_of_scipy_for_odd_degrees(degree: int) -> None:
    t = np.linspace(0, 1, 12)
    expected = make_interp_spline(t, np.zeros(12), k=degree).t  # not-a-knot; the same for evenly spaced data
    assert np.allclose(averaged(t, degree), expected, atol=1e-14)


@pytest.mark.parametrize("degree", [1, 2, 3, 4, 5])
def test_insertion_matrix_keeps_the_curve(degree: int) -> None:
    rng = np.random.default_rng(degree)
    knots, control = clamped_uniform(8, degree), rng.standard_normal(8)
    finer, matrix = inserted(knots, degree, [0.5, 0.31, 0.77])
    t = np.linspace(0, 1, 101)
    assert matrix.shape == (11, 8)
    assert np.allclose(BSpline(finer, matrix @ control, degree)(t), BSpline(knots, control, degree)(t), atol=1e-13)


def test_normalised_runs_from_0_to_1() -> None:
    assert np.array_equal(normalised([2, 2, 3, 6, 6]), [0, 0, 0.25, 1, 1])


@pytest.mark.parametrize(
    ("knots", "degree", "n_control", "reason"),
    [
        ([0, 0, 0.5, 1, 1], 1, 4, "expected 6 knots"),
        ([0, 0, 0.7, 0.2, 1, 1], 1, 4, "non-decreasing"),
        ([0, 0.1, 0.5, 0.7, 1, 1], 1, 4, "clamped"),
        ([0, 0, 0.5, 0.5, 1, 1], 1, 4, "at most 1 times"),
        ([0, 0, 1, 1], 6, 2, "degree from 1 to 5"),
        ([0, 0, 1, 1], 3, 3, "degree below the number of control points"),
    ],
)
def test_bad_knots_are_named(knots: list[float], degree: int, n_control: int, reason: str) -> None:
    with pytest.raises(InputError, match=reason):
        check_knots(np.array(knots, dtype=float), degree, n_control)
