"""Volumes within the zero level of sampled distances, against formulas."""

import numpy as np
import pytest

from gpubspline.ct.enclosed import enclosed_volume


def ball(shape, centre, radius, spacing=(1, 1, 1)):
    grid = np.stack(np.meshgrid(*[np.arange(n) * s for n, s in zip(shape, spacing, strict=True)], indexing="ij"), -1)
    return np.linalg.norm(grid - centre, axis=-1) - radius


@pytest.mark.parametrize("shift", [0.0, 0.3, 0.5])
def test_a_sphere_of_ten_voxels_to_a_thousandth(shift):
    distance = ball((26, 26, 26), np.full(3, 12 + shift), 10)
    np.testing.assert_allclose(enclosed_volume(distance, np.eye(4)), 4 / 3 * np.pi * 1000, rtol=1e-3)


def test_a_sphere_on_flat_left_handed_voxels():
    distance = ball((16, 40, 40), (14.3, 12.1, 12.4), 10, (2.0, 0.6, 0.6))
    np.testing.assert_allclose(enclosed_volume(distance, np.diag([-0.6, 0.6, 2, 1])), 4 / 3 * np.pi * 1000, rtol=3e-3)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("place", [7.0, 7.25, 7.5, 7.9])
def test_half_spaces_along_each_axis_are_exact(axis, place):
    shape = [6, 7, 8]
    shape[axis] = 20
    distance = np.moveaxis(np.broadcast_to(np.arange(20) - place, [n for n in np.delete(shape, axis)] + [20]), 2, axis)
    expected = place * np.prod(np.delete(shape, axis) - 1)
    np.testing.assert_allclose(enclosed_volume(distance, np.diag([1, 1, 1, 1])), expected, rtol=1e-12)
    np.testing.assert_allclose(enclosed_volume(distance, np.diag([0.5, 3, 2, 1])), 3 * expected, rtol=1e-12)


def test_shear_does_not_change_the_volume():
    distance = ball((14, 14, 14), np.full(3, 6.3), 5)
    sheared = np.eye(4)
    sheared[:3, 2] = 0.2, -0.3, 1
    np.testing.assert_allclose(enclosed_volume(distance, sheared), enclosed_volume(distance, np.eye(4)), rtol=2e-3)


def test_one_slice_is_one_voxel_thick():
    distance = ball((26, 26), (12.3, 12.6), 10, (1, 1))[None]
    np.testing.assert_allclose(enclosed_volume(distance, np.diag([1, 1, 2.5, 1])), np.pi * 100 * 2.5, rtol=1e-3)


def test_full_and_empty():
    assert enclosed_volume(np.full((3, 4, 5), -9.0), np.eye(4)) == 2 * 3 * 4
    assert enclosed_volume(np.full((3, 4, 5), 9.0), np.eye(4)) == 0
