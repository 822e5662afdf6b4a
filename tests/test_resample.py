"""The trilinear resampling kernel against scipy, inside the volume, at its border and beyond."""

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from gpubspline.device import Device


@pytest.mark.parametrize("shape", [(5, 6, 7), (1, 6, 7), (9, 1, 1)])
@pytest.mark.parametrize("clamp", [0, 1])
def test_agrees_with_scipy(any_device: Device, shape: tuple[int, int, int], clamp: int) -> None:
    rng = np.random.default_rng(3)
    volume, n = rng.uniform(-1, 1, shape), 501  # no multiple of the lanes
    size = np.array(shape[::-1], dtype=float)[:, None]
    index = rng.uniform(-2, size + 1, (3, n))
    index[:, ::2] = rng.uniform(0, size - 1, (3, len(range(0, n, 2))))
    to_mm = np.linalg.inv(rng.uniform(-1, 1, (3, 3)) + 2 * np.eye(3))
    matrix = np.column_stack([np.linalg.inv(to_mm), [0.5, -0.25, 1.0]])
    points = to_mm @ (index - matrix[:, 3:])
    planes = [any_device.put(plane) for plane in points]
    grid = (any_device.put(volume), *shape[::-1], any_device.put(matrix))
    expected = map_coordinates(volume, index[::-1], order=1, mode="nearest")
    beyond = np.any((index < -0.5) | (index > size - 0.5), axis=0)
    if not clamp:
        expected[beyond] = -9.0
    assert beyond.any() and not beyond.all()
    sharp = np.any(np.abs(np.abs(index - (size - 1) / 2) - size / 2) < 1e-4, axis=0)  # on the half-voxel limit itself
    tolerance = 2e-5 if any_device.real == np.float32 else 1e-12
    for items, run in ((n, 1), (256, 2)):  # as on a CPU, and as on a GPU
        out = any_device.empty(n)
        any_device.launch("resample.trilinear", items, *grid, *planes, -9.0, clamp, run, n, out)
        assert np.abs(any_device.get(out) - expected)[~sharp].max() < tolerance


@pytest.mark.parametrize("shape", [(5, 6, 7), (9, 1, 4)])
def test_bricks_of_a_lattice_agree_with_scipy(any_device: Device, shape: tuple[int, int, int]) -> None:
    """A distance on a turned lattice that reaches beyond the volume, where its planes bound what is inside."""
    rng = np.random.default_rng(4)
    volume, edge, gap = rng.uniform(-8, 8, shape), 9, np.array([0.5, 2.0, 1.25])
    matrix = np.column_stack([rng.uniform(-0.4, 0.4, (3, 3)), np.array(shape[::-1]) / 3])
    corners = np.array([[0, 9, 0], [18, 0, 9]], dtype=np.int32)
    out = any_device.empty((2, edge, edge, edge))
    grid = (any_device.put(volume), *shape[::-1], any_device.put(matrix), any_device.put(gap))
    any_device.launch("resample.bricks", (2 * edge * edge, edge), *grid, any_device.put(corners), edge, out)
    k, j, i = np.indices((edge, edge, edge)).reshape(3, -1)
    at = np.concatenate([np.stack([i, j, k]) + corner[:, None] for corner in corners], axis=1)
    index = matrix @ np.vstack([at, np.ones(at.shape[1])])
    last = np.array(shape[::-1])[:, None] - 1
    off = (np.maximum(-index, index - last) * gap[:, None]).max(axis=0)
    expected = np.maximum(map_coordinates(volume, index[::-1], order=1, mode="nearest"), off)
    assert (off > 0).any() and (expected > off).any()
    tolerance = 2e-5 if any_device.real == np.float32 else 1e-12
    assert np.abs(np.asarray(any_device.get(out)).ravel() - expected).max() < tolerance
