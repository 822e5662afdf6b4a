"""Knot vectors: clamped, non-decreasing, from 0 to 1."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpubspline.errors import InputError

Floats = NDArray[np.float64]
MAX_DEGREE = 5


def check_degree(degree: int, n_control: int) -> None:
    """Raise ``InputError`` unless 1 <= degree <= 5 and degree < n_control."""
    if not 1 <= degree <= MAX_DEGREE:
        raise InputError(f"expected a degree from 1 to {MAX_DEGREE}, got {degree}")
    if degree >= n_control:
        raise InputError(
            f"expected a degree below the number of control points, got degree {degree} with {n_control} control points"
        )


def clamped_uniform(n_control: int, degree: int) -> Floats:
    """(n_control + degree + 1,) knots: both ends degree + 1 times, the inner ones evenly between."""
    check_degree(degree, n_control)
    inner = np.linspace(0.0, 1.0, n_control - degree + 1)
    return np.concatenate([np.zeros(degree), inner, np.ones(degree)])


def averaged(parameters: ArrayLike, degree: int) -> Floats:
    """Clamped knots for the interpolation of data at increasing parameters from 0 to 1: means of ``degree`` of them.

    The collocation matrix is then banded and invertible. Source: Piegl and Tiller, The NURBS Book, eq. 9.8.
    """
    t = np.asarray(parameters, dtype=np.float64)
    check_degree(degree, len(t))
    sums = np.concatenate([[0.0], np.cumsum(t)])
    inner = (sums[degree + 1 : -1] - sums[1 : -degree - 1]) / degree
    return np.concatenate([np.zeros(degree + 1), inner, np.ones(degree + 1)])


def normalised(knots: ArrayLike) -> Floats:
    """Knots over any interval, moved and scaled to run from 0 to 1.

    Raises InputError where they span no interval.
    """
    values = np.asarray(knots, dtype=np.float64)
    if values.ndim != 1 or len(values) < 2 or not values[-1] > values[0]:
        raise InputError(f"expected a knot vector over an interval, got {values.tolist()}")
    return np.asarray((values - values[0]) / (values[-1] - values[0]))


def check_knots(knots: Floats, degree: int, n_control: int) -> None:
    """Raise ``InputError`` unless the knots are clamped, non-decreasing, from 0 to 1 and of the right number."""
    check_degree(degree, n_control)
    expected = n_control + degree + 1
    if knots.shape != (expected,):
        raise InputError(f"expected {expected} knots for {n_control} control points, got {len(knots)}")
    if np.any(np.diff(knots) < 0) or np.any(knots[: degree + 1] != 0) or np.any(knots[-degree - 1 :] != 1):
        raise InputError(f"expected clamped, non-decreasing knots from 0 to 1, got {knots.tolist()}")
    inner, times = np.unique(knots[degree + 1 : -degree - 1], return_counts=True)
    if np.any(times > degree) or np.any(inner == 0) or np.any(inner == 1):
        raise InputError(f"expected inner knots at most {degree} times each, got {knots.tolist()}")


def greville(knots: Floats, degree: int) -> Floats:
    """(n_control,) Greville abscissae: where each control point would have to lie to make its coordinate linear."""
    n_control = len(knots) - degree - 1
    return np.array([knots[i + 1 : i + degree + 1].mean() for i in range(n_control)])


def inserted(knots: Floats, degree: int, new: Sequence[float]) -> tuple[Floats, Floats]:
    """Knots with ``new`` ones added, and the (n_control + len(new), n_control) matrix that takes control points along.

    Source: Boehm's algorithm; Piegl and Tiller, The NURBS Book, eq. 5.15.
    Raises InputError for a knot not inside (0, 1).
    """
    n_control = len(knots) - degree - 1
    matrix = np.eye(n_control)
    for knot in sorted(new):
        if not 0.0 < knot < 1.0:
            raise InputError(f"expected new knots inside (0, 1), got {knot}")
        span = int(np.searchsorted(knots, knot, side="right")) - 1
        step = np.zeros((len(matrix) + 1, len(matrix)))
        for i in range(len(step)):
            if i <= span - degree:
                share = 1.0
            elif i > span:
                share = 0.0
            else:
                share = (knot - knots[i]) / (knots[i + degree] - knots[i])
            if share:
                step[i, i] = share
            if share != 1.0:
                step[i, i - 1] = 1.0 - share
        matrix = step @ matrix
        knots = np.insert(knots, span + 1, knot)
    check_knots(knots, degree, len(matrix))
    return knots, matrix
