"""Hyperpatches against mathematics and against scipy's BSpline and NdBSpline."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import BSpline, NdBSpline

from gpubspline.device import Device
from gpubspline.errors import InputError
from gpubspline.spline.hyperpatch import Hyperpatch, bezier, hyperpatch
from gpubspline.spline.knots import greville
from gpubspline.spline.model import load_model, save_model

UNEVEN = np.array([0, 0, 0, 0, 0.2, 0.5, 0.5, 0.7, 1, 1, 1, 1])


def tolerance(device: Device) -> float:
    return 1e-6 if device.real == np.float32 else 1e-12


def random_patch(shape: tuple[int, ...], degrees: tuple[int, ...], seed: int = 0) -> Hyperpatch:
    return hyperpatch(np.random.default_rng(seed).uniform(-1, 1, (*shape, 4)), degrees)


def parameters(*counts: int) -> list[np.ndarray]:
    rng = np.random.default_rng(7)
    return [np.concatenate([[0.0, 1.0], rng.uniform(0, 1, n - 2)]) for n in counts]


@pytest.mark.parametrize("degree", [1, 2, 3, 4, 5])
def test_basis_is_a_partition_of_unity(any_device: Device, degree: int) -> None:
    patch = hyperpatch(np.ones((7, 8, 9, 4)), degree)
    assert np.allclose(patch.evaluate_grid(parameters(11, 12, 13), any_device), 1, atol=tolerance(any_device))


@pytest.mark.parametrize("degrees", [(1, 1, 1), (3, 3, 3), (5, 4, 2), (2, 5, 1), (4, 1, 5)])
def test_solid_agrees_with_scipy(any_device: Device, degrees: tuple[int, int, int]) -> None:
    patch = random_patch((7, 8, 9), degrees)
    axes = parameters(23, 9, 17)
    oracle = NdBSpline(patch.knots, patch.control, degrees)
    expected = oracle(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1))
    assert np.allclose(patch.evaluate_grid(axes, any_device), expected, rtol=0, atol=2 * tolerance(any_device))
    points = np.stack(parameters(40, 40, 40), axis=-1)
    assert np.allclose(patch.evaluate_points(points, any_device), oracle(points), atol=2 * tolerance(any_device))


def test_float32_keeps_its_digits_far_from_the_origin(device: Device, device64: Device) -> None:
    near = random_patch((7, 8, 9), (3, 3, 3))
    far = replace(near, control=near.control * 100 + [300.0, -200.0, -1600.0, 0.0])  # a head at the end of the table
    axes = parameters(40, 41, 42)
    expected = far.evaluate_grid(axes, device64)[..., :3]
    off = np.abs(far.evaluate_grid(axes, device)[..., :3] - expected)
    assert np.all(off <= np.spacing(np.abs(expected).astype(np.float32)) / 2 + 6e-5)


def test_surface_agrees_with_scipy(any_device: Device) -> None:
    patch = random_patch((10, 6), (3, 2))
    axes = parameters(31, 14)
    oracle = NdBSpline(patch.knots, patch.control, patch.degrees)
    expected = oracle(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1))
    assert np.allclose(patch.evaluate_grid(axes, any_device), expected, atol=2 * tolerance(any_device))
    points = np.stack(parameters(40, 40), axis=-1)
    assert np.allclose(patch.evaluate_points(points, any_device), oracle(points), atol=2 * tolerance(any_device))


def test_given_knots_with_a_double_one(any_device: Device) -> None:
    control = np.random.default_rng(3).uniform(-1, 1, (8, 4, 4))
    patch = hyperpatch(control, (3, 1), knots=[UNEVEN, [0, 0, 0.1, 0.9, 1, 1]])
    axes = parameters(50, 9)
    expected = NdBSpline(patch.knots, control, patch.degrees)(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1))
    assert np.allclose(patch.evaluate_grid(axes, any_device), expected, atol=2 * tolerance(any_device))


@pytest.mark.parametrize("order", [(1, 0, 0), (0, 2, 0), (1, 1, 1), (0, 0, 3), (4, 0, 0)])
def test_derivatives_agree_with_scipy(device64: Device, order: tuple[int, int, int]) -> None:
    patch = random_patch((6, 7, 8), (3, 4, 5))
    axes = [values[(values > 0.01) & (values < 0.99)] for values in parameters(12, 13, 14)]
    expected = patch.control
    for direction, (knots, degree, t) in enumerate(zip(patch.knots, patch.degrees, axes, strict=True)):
        line = BSpline(knots, np.moveaxis(expected, direction, 0), degree)
        expected = np.moveaxis(line(t, nu=order[direction]), 0, direction)
    scale = max(1.0, np.abs(expected).max())
    found = patch.evaluate_grid(axes, device64, order)
    assert np.allclose(found, expected, atol=1e-12 * scale)
    corner = [[t[0] for t in axes], [t[-1] for t in axes]]
    at_points = patch.evaluate_points(corner, device64, order)
    assert np.allclose(at_points, [expected[0, 0, 0], expected[-1, -1, -1]], atol=1e-12 * scale)


def test_bezier_is_bernstein(any_device: Device) -> None:
    control = np.random.default_rng(5).uniform(-1, 1, (4, 3, 4))
    u, v = parameters(20, 10)
    cubic = np.stack([(1 - u) ** 3, 3 * u * (1 - u) ** 2, 3 * u**2 * (1 - u), u**3], axis=-1)
    square = np.stack([(1 - v) ** 2, 2 * v * (1 - v), v**2], axis=-1)
    expected = np.einsum("ui,vj,ijc->uvc", cubic, square, control)
    assert np.allclose(bezier(control).evaluate_grid([u, v], any_device), expected, atol=2 * tolerance(any_device))


def quarter_annulus() -> Hyperpatch:
    """An exact quarter of a ring of radii 1 and 2: a circle needs weights."""
    turn = np.array([[1, 0], [1, 1], [0, 1]], dtype=float)
    control = np.zeros((3, 2, 4))
    control[:, 0, :2], control[:, 1, :2], control[..., 3] = turn, 2 * turn, 100.0
    weights = np.repeat(np.array([[1], [np.sqrt(0.5)], [1]]), 2, axis=1)
    return hyperpatch(control, (2, 1), weights=weights)


def test_nurbs_draws_a_circle(any_device: Device) -> None:
    points = quarter_annulus().evaluate_grid([np.linspace(0, 1, 33), [0.0, 0.25, 1.0]], any_device)
    radius = np.hypot(points[..., 0], points[..., 1])
    assert np.allclose(radius, [1, 1.25, 2], atol=4 * tolerance(any_device))
    assert np.allclose(points[..., 3], 100, rtol=2 * tolerance(any_device))


@pytest.mark.parametrize("order", [(1, 0), (0, 1), (1, 1), (2, 0)])
def test_nurbs_derivatives_agree_with_finite_differences(device64: Device, order: tuple[int, int]) -> None:
    patch, step = quarter_annulus(), 1e-3
    stencils = {0: ([0], [1.0]), 1: ([-1, 1], [-0.5, 0.5]), 2: ([-1, 0, 1], [1.0, -2.0, 1.0])}
    (du, weight_u), (dv, weight_v) = stencils[order[0]], stencils[order[1]]
    grid = patch.evaluate_grid([0.4 + step * np.array(du), 0.6 + step * np.array(dv)], device64)
    expected = np.einsum("u,v,uvc->c", weight_u, weight_v, grid) / step ** sum(order)
    found = patch.evaluate_points([[0.4, 0.6]], device64, order)[0]
    assert np.allclose(found, expected, atol=1e-5)


@pytest.mark.parametrize("patch", [random_patch((6, 7, 5), (3, 2, 4)), quarter_annulus()], ids=["solid", "nurbs"])
def test_knot_insertion_leaves_the_patch(device64: Device, patch: Hyperpatch) -> None:
    finer = patch.insert_knots(1, [0.3, 0.35]).insert_knots(0, [0.62])
    axes = parameters(*(15,) * patch.parametric_dimension)
    assert finer.shape[:2] == (patch.shape[0] + 1, patch.shape[1] + 2)
    assert np.allclose(finer.evaluate_grid(axes, device64), patch.evaluate_grid(axes, device64), atol=1e-13)


def test_control_at_greville_abscissae_reproduces_linear_fields(any_device: Device) -> None:
    rng = np.random.default_rng(11)
    probe = random_patch((9, 8, 7), (3, 4, 2))
    grid = np.stack(np.meshgrid(*map(greville, probe.knots, probe.degrees), indexing="ij"), axis=-1)
    linear, shift = rng.uniform(-1, 1, (3, 4)), rng.uniform(-1, 1, 4)
    patch = hyperpatch(grid @ linear + shift, probe.degrees)
    axes = parameters(12, 13, 14)
    expected = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1) @ linear + shift
    assert np.allclose(patch.evaluate_grid(axes, any_device), expected, atol=4 * tolerance(any_device))


def test_backends_agree_on_a_ct_sized_patch(both_devices: tuple[Device, Device]) -> None:
    control = np.random.default_rng(2).uniform(-150, 150, (12, 14, 10, 4))
    control[..., 3] = np.random.default_rng(3).uniform(-1000, 2000, control.shape[:-1])
    patch, axes = hyperpatch(control), [np.linspace(0, 1, n) for n in (40, 50, 30)]
    one, other = (patch.evaluate_grid(axes, device) for device in both_devices)
    assert np.abs(one[..., :3] - other[..., :3]).max() < 1e-4
    assert np.abs(one[..., 3] - other[..., 3]).max() < 0.05


@pytest.mark.parametrize("patch", [random_patch((6, 7, 5), (3, 2, 4)), quarter_annulus()], ids=["solid", "nurbs"])
def test_model_file_round_trip(tmp_path: Path, patch: Hyperpatch) -> None:
    save_model(patch, tmp_path / "model.npz")
    back = load_model(tmp_path / "model.npz")
    assert np.array_equal(back.control, patch.control) and back.degrees == patch.degrees
    assert all(np.array_equal(one, other) for one, other in zip(back.knots, patch.knots, strict=True))
    assert (back.weights is None) == (patch.weights is None) and back.channels == patch.channels


def test_bad_model_files_are_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="does not exist"):
        load_model(tmp_path / "absent.npz")
    (tmp_path / "text.npz").write_text("not a model")
    with pytest.raises(InputError, match="expected a gpubspline model"):
        load_model(tmp_path / "text.npz")
    np.save(tmp_path / "array.npy", np.zeros(3))
    with pytest.raises(InputError, match=r"array\.npy: it is no \.npz file"):
        load_model(tmp_path / "array.npy")
    np.savez(tmp_path / "other.npz", a=np.ones(3))
    with pytest.raises(InputError, match="holds something else"):
        load_model(tmp_path / "other.npz")
    with pytest.raises(InputError, match=r"ending in \.npz"):
        save_model(quarter_annulus(), tmp_path / "model.txt")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["array.npy", "other.npz", "text.npz"]


def test_bad_patches_are_named(device: Device) -> None:
    with pytest.raises(InputError, match="shape"):
        hyperpatch(np.zeros((4, 4, 5)))
    with pytest.raises(InputError, match="degree below the number"):
        hyperpatch(np.zeros((4, 3, 4)))
    for weight in (0.0, np.nan, np.inf):
        with pytest.raises(InputError, match="positive weights"):
            hyperpatch(np.zeros((4, 4, 4)), weights=np.full((4, 4), weight))
    with pytest.raises(InputError, match="parameters from 0 to 1"):
        hyperpatch(np.zeros((4, 4, 4))).evaluate_grid([[0.0, 1 + 1e-6], [0.5]], device)
    with pytest.raises(InputError, match="2 directions"):
        hyperpatch(np.zeros((4, 4, 4))).evaluate_points([[0.1, 0.2, 0.3]], device)
    with pytest.raises(InputError, match="Bezier"):
        bezier(np.zeros((7, 4, 4)))
