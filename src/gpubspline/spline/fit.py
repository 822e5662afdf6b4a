"""From a lattice of data points to a hyperpatch: as control points, through them, or nearest to them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline
from scipy.linalg import solve_banded

from gpubspline.device import Device, check_device
from gpubspline.errors import InputError, expect
from gpubspline.shown import brief
from gpubspline.spline.hyperpatch import Hyperpatch, hyperpatch
from gpubspline.spline.knots import averaged, clamped_uniform, greville
from gpubspline.spline.lattice import ControlLattice

Floats = NDArray[np.float64]
METHODS = ("control", "interpolate", "least-squares")


@dataclass(frozen=True)
class FitError:
    """How far the patch runs from the data it was made from."""

    mean_mm: float
    max_mm: float
    mean_hu: float
    max_hu: float


@dataclass(frozen=True, eq=False)
class Fit:
    """A hyperpatch and its distance from the data."""

    patch: Hyperpatch
    error: FitError

    __repr__ = brief


def fit(
    lattice: ControlLattice,
    method: str = "control",
    *,
    degree: int | Sequence[int] = 3,
    control: Sequence[int] | None = None,
    device: Device,
) -> Fit:
    """Make a hyperpatch from a lattice of data points (n_u, n_v[, n_w], 3 + C).

    Arguments
    ---------
    method: ``"control"``: the data are the control points, as in the paper; ``"interpolate"``: the patch passes through
        the data, at evenly spaced parameters; ``"least-squares"``: ``control`` points, fewer than data, nearest to the
        data at evenly spaced parameters.
    control: control points in each direction, for ``"least-squares"``; half the data where not given.

    Raises
    ------
    InputError for an unknown method, a degree not below the number of control points, or more control points than data.
    """
    expect(lattice, ControlLattice, "control_lattice lays one")
    check_device(device)
    data = lattice.points
    shape = data.shape[:-1]
    degrees = (degree,) * len(shape) if isinstance(degree, int) else tuple(degree)
    if len(degrees) != len(shape):
        raise InputError(f"expected {len(shape)} degrees, got {degrees}")
    if method == "control":
        patch = hyperpatch(data, degrees, channels=lattice.channels)
        parameters = [greville(knots, p) for knots, p in zip(patch.knots, degrees, strict=True)]
    elif method == "interpolate":
        parameters = [np.linspace(0.0, 1.0, n) for n in shape]
        patch = _interpolate(data, parameters, degrees, lattice.channels)
    elif method == "least-squares":
        parameters = [np.linspace(0.0, 1.0, n) for n in shape]
        counts = (
            tuple(control)
            if control is not None
            else tuple(max(n // 2, p + 1) for n, p in zip(shape, degrees, strict=True))
        )
        patch = _least_squares(data, parameters, degrees, counts, lattice.channels)
    else:
        raise InputError(f"expected a fit of {', '.join(METHODS)}, got {method!r}")
    return Fit(patch, _error(patch, data, parameters, device))


def _interpolate(
    data: Floats, parameters: list[Floats], degrees: tuple[int, ...], channels: tuple[str, ...]
) -> Hyperpatch:
    """Solve the collocation equations one direction at a time; averaged knots keep them banded and regular."""
    knots = tuple(averaged(t, p) for t, p in zip(parameters, degrees, strict=True))
    control = data
    for direction, (t, vector, degree) in enumerate(zip(parameters, knots, degrees, strict=True)):
        lines = np.moveaxis(control, direction, 0)
        solved = _solve_collocation(vector, degree, t, lines.reshape(len(t), -1))
        control = np.moveaxis(solved.reshape(lines.shape), 0, direction)
    return hyperpatch(control, degrees, knots=knots, channels=channels)


def _solve_collocation(knots: Floats, degree: int, parameters: Floats, data: Floats) -> Floats:
    matrix = BSpline.design_matrix(parameters, knots, degree).todia()
    band = np.zeros((2 * degree + 1, len(parameters)))
    for offset, diagonal in zip(matrix.offsets, matrix.data, strict=True):
        band[degree - offset, : len(diagonal)] = diagonal
    return np.asarray(solve_banded((degree, degree), band, data))


def _least_squares(
    data: Floats,
    parameters: list[Floats],
    degrees: tuple[int, ...],
    counts: tuple[int, ...],
    channels: tuple[str, ...],
) -> Hyperpatch:
    """Least squares over a grid factorise: the pseudo-inverse of each direction's design matrix in turn."""
    if len(counts) != len(parameters):
        raise InputError(f"expected {len(parameters)} numbers of control points, got {counts}")
    control, knots = data, []
    for direction, (t, degree, count) in enumerate(zip(parameters, degrees, counts, strict=True)):
        if count > len(t):
            raise InputError(f"expected at most {len(t)} control points in direction {'uvw'[direction]}, got {count}")
        vector = clamped_uniform(count, degree)
        design = BSpline.design_matrix(t, vector, degree).toarray()
        lines = np.moveaxis(control, direction, 0)
        solved = np.linalg.lstsq(design, lines.reshape(len(t), -1), rcond=None)[0]
        control = np.moveaxis(solved.reshape(count, *lines.shape[1:]), 0, direction)
        knots.append(vector)
    return hyperpatch(control, degrees, knots=knots, channels=channels)


def _error(patch: Hyperpatch, data: Floats, parameters: list[Floats], device: Device) -> FitError:
    off = np.asarray(patch.evaluate_grid(parameters, device), dtype=np.float64) - data
    distance, hu = np.linalg.norm(off[..., :3], axis=-1), np.abs(off[..., 3])
    return FitError(float(distance.mean()), float(distance.max()), float(hu.mean()), float(hu.max()))
