"""Means over balls: exact for what a ball cannot change, near direct sums for the rest."""

import numpy as np
import pytest

from gpubspline.analysis.local_mean import local_mean
from gpubspline.errors import InputError


def block(step=0.25, size=(8, 6, 10)):
    """Middles of the cells of a box about the origin, and the volume of each."""
    axes = [np.arange(-n / 2 + step / 2, n / 2, step) for n in size]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    return points, np.full(len(points), step**3)


def filled(values, radius=1.5, points=None, volume=None):
    if points is None:
        points, volume = block()
    mean = local_mean(points, radius)
    for part in np.array_split(np.arange(len(points)), 5):
        mean.add(points[part], volume[part], values[part])
    return mean


@pytest.mark.parametrize("radius", [1.5, 2.2])
def test_a_ball_has_the_volume_of_its_radius(radius):
    mean = local_mean(block()[0], radius)
    volume = mean._ball([40, 40, 40]).sum() * mean.step_mm**3
    assert volume == pytest.approx(4 / 3 * np.pi * radius**3, rel=0.02)


def test_a_constant_is_its_own_mean_everywhere_and_sums_are_kept():
    points, _ = block()
    mean = filled(np.full(len(points), 7.0))
    assert mean.volume.sum() == pytest.approx(480, rel=1e-12) and mean.total.sum() == pytest.approx(7 * 480, rel=1e-12)
    means, _ = mean.at(np.random.default_rng(0).uniform(-3, 3, (50, 3)))
    np.testing.assert_allclose(means, 7, rtol=1e-10)


def test_a_linear_field_is_its_own_mean_where_the_ball_lies_inside():
    """The ball is symmetric and sharing keeps the first moment: 5 % of a grid step is all that places may be off by."""
    points, _ = block()
    slope = np.array([2.0, -3, 1])
    mean = filled(5 + points @ slope)
    places = np.random.default_rng(1).uniform([-2, -1, -3], [2, 1, 3], (50, 3))
    means, _ = mean.at(places)
    np.testing.assert_allclose(means, 5 + places @ slope, atol=0.05 * mean.step_mm * np.linalg.norm(slope))


def test_balls_are_full_inside_half_full_at_a_side_and_a_quarter_at_an_edge():
    points, _ = block()
    _, share = filled(np.ones(len(points))).at(np.array([[0.0, 0, 0], [4, 0, 0], [4, 3, 0], [4, 3, 5]]))
    np.testing.assert_allclose(share, [1, 0.5, 0.25, 0.125], rtol=0.03)


def test_means_are_near_the_direct_sums():
    """Points anywhere, each with a volume of its own; the ball's surface is one grid step soft."""
    random = np.random.default_rng(2)
    points, volume = random.uniform(-4, 4, (40_000, 3)), random.uniform(0.5, 1.5, 40_000)
    values = np.sin(points[:, 0]) + points[:, 1] ** 2
    places = random.uniform(-4, 4, (30, 3))
    means, _ = filled(values, 1.5, points, volume).at(places)
    inside = np.linalg.norm(points[None] - places[:, None], axis=2) <= 1.5
    direct = (inside * volume * values).sum(axis=1) / (inside * volume).sum(axis=1)
    np.testing.assert_allclose(means, direct, atol=0.02 * np.ptp(values))


def test_a_ball_too_small_for_the_body_is_refused():
    with pytest.raises(InputError, match=r"at least 0\.\d+ mm to average over in a body of 8 x 6 x 10 mm, got 0.001"):
        local_mean(np.array([[-4.0, -3, -5], [4, 3, 5]]), 0.001)
