"""Fits against their definitions, scipy's splines and observed orders of convergence."""

import numpy as np
import pytest
from scipy.interpolate import make_lsq_spline

from gpubspline.device import Device
from gpubspline.errors import InputError
from gpubspline.spline.fit import fit
from gpubspline.spline.lattice import ControlLattice


def lattice(points: np.ndarray) -> ControlLattice:
    return ControlLattice(points, ("HU",))


def curved(n_u: int, n_v: int, n_w: int) -> np.ndarray:
    """A smooth bent body with a smooth material over evenly spaced parameters, (n_u, n_v, n_w, 4)."""
    u, v, w = np.meshgrid(*(np.linspace(0, 1, n) for n in (n_u, n_v, n_w)), indexing="ij")
    return np.stack([u + 0.2 * np.sin(2 * v), v + 0.1 * u * w, 2 * w + 0.3 * np.cos(3 * u), np.exp(u - v) * w], axis=-1)


def test_interpolation_passes_through_its_data(device64: Device) -> None:
    data = np.random.default_rng(0).uniform(-1, 1, (9, 8, 7, 4))
    result = fit(lattice(data), "interpolate", degree=(3, 4, 5), device=device64)
    axes = [np.linspace(0, 1, n) for n in data.shape[:3]]
    assert np.allclose(result.patch.evaluate_grid(axes, device64), data, atol=1e-11)
    assert result.error.max_mm < 1e-11 and result.error.max_hu < 1e-11


def test_interpolation_keeps_a_linear_field_of_space(device64: Device) -> None:
    data = curved(9, 8, 7)
    data[..., 3] = data[..., :3] @ [1.5, -2.0, 0.5] + 7
    patch = fit(lattice(data), "interpolate", device=device64).patch
    found = patch.evaluate_grid([np.linspace(0, 1, 31)] * 3, device64)
    assert np.allclose(found[..., 3], found[..., :3] @ [1.5, -2.0, 0.5] + 7, atol=1e-12)


@pytest.mark.parametrize("degree", [1, 2, 3, 4, 5])
def test_interpolation_converges_at_degree_plus_one(device64: Device, degree: int) -> None:
    fine = [np.linspace(0, 1, n) for n in (61, 67, 71)]
    exact = curved(61, 67, 71)
    errors = []
    for n in (13, 25):
        patch = fit(lattice(curved(n, n, n)), "interpolate", degree=degree, device=device64).patch
        errors.append(np.abs(patch.evaluate_grid(fine, device64) - exact).max())
    order = np.log2(errors[0] / errors[1])
    assert degree + 0.5 < order < degree + 2.5, f"observed order {order:.2f}"


def test_least_squares_agrees_with_scipy(device64: Device) -> None:
    rng = np.random.default_rng(4)
    data = curved(30, 20, 1)[:, :, 0] + 0.01 * rng.standard_normal((30, 20, 4))
    patch = fit(lattice(data), "least-squares", control=(9, 7), device=device64).patch
    expected = data
    for direction, n in enumerate((30, 20)):
        lines = np.moveaxis(expected, direction, 0)
        spline = make_lsq_spline(np.linspace(0, 1, n), lines, patch.knots[direction], 3)
        expected = np.moveaxis(spline.c, 0, direction)
    assert np.allclose(patch.control, expected, atol=1e-10)


def test_least_squares_comes_nearer_with_more_points(device64: Device) -> None:
    data = lattice(curved(24, 24, 24))
    errors = [fit(data, "least-squares", control=(n, n, n), device=device64).error for n in (5, 8, 12)]
    assert errors[0].max_mm > 4 * errors[1].max_mm > 16 * errors[2].max_mm
    assert errors[0].mean_hu > errors[1].mean_hu > errors[2].mean_hu > 0


def test_least_squares_takes_half_the_data_and_as_many_points_as_a_degree_needs(device: Device) -> None:
    assert fit(lattice(curved(6, 9, 12)), "least-squares", device=device).patch.shape == (4, 4, 6)


def test_control_passes_through_the_corners_and_reports_the_rest(device: Device) -> None:
    data = curved(9, 8, 7)
    result = fit(lattice(data), device=device)
    corners = result.patch.evaluate_grid([[0.0, 1.0]] * 3, device)
    assert np.allclose(corners, data[::8, ::7, ::6], atol=1e-6)
    assert 1e-4 < result.error.mean_mm < result.error.max_mm < 0.1


def test_bad_fits_are_named(device: Device) -> None:
    data = lattice(curved(6, 6, 6))
    with pytest.raises(InputError, match="expected a fit of control, interpolate, least-squares"):
        fit(data, "spline", device=device)
    with pytest.raises(InputError, match="at most 6 control points in direction v"):
        fit(data, "least-squares", control=(5, 7, 5), device=device)
    with pytest.raises(InputError, match="degree below"):
        fit(lattice(curved(6, 3, 6)), device=device)
    with pytest.raises(InputError, match="3 degrees"):
        fit(data, degree=(3, 3), device=device)
