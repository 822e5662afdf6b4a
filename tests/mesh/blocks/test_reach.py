"""What the surface of a core can reach, and what it leaves out."""

import numpy as np
import pytest

from gpubspline.mesh.blocks.level_set import SAMPLES, LevelSet
from gpubspline.mesh.blocks.reach import EXACT, REACH, core_distance, lost_features, within_reach


def test_lost_features_by_hand():
    """Two bodies outside the core's reach, the farthest first; a third stands out too little."""
    phi, reached = np.ones((10, 12, 14), np.float32), np.full((10, 12, 14), -1, np.float32)
    for at, out in (((2, 3, slice(4, 8)), [0.2, 0.9, 1.4, 0.6]), ((7, 8, 9), 2.0), ((5, 5, 5), 0.3)):
        phi[at], reached[at] = -1, out
    found = lost_features(LevelSet(phi, 2.0, np.diag([2.0, 2, 2, 1])), reached)
    assert [feature.out_mm for feature in found] == pytest.approx([4.0, 2.8])
    assert found[0].place_mm == pytest.approx((6, 16 / 3, 14 / 3))
    assert found[1].place_mm == pytest.approx((4, 2, 4 / 3))


def test_a_level_set_is_clamped_to_the_core():
    cells = np.zeros((12, 12, 12), dtype=bool)
    cells[3:9, 3:9, 3:9] = True
    shape = (12 * SAMPLES + 1,) * 3
    core = core_distance(cells)
    distance, middle = core.field, 6 * SAMPLES
    assert distance.shape == shape and distance[middle, middle, middle] < -2
    assert distance[middle, middle, 3 * SAMPLES] == pytest.approx(0, abs=0.05)  # the middle of a face of the core
    assert distance[middle, middle, SAMPLES] == pytest.approx(2, abs=0.05)
    found = within_reach(np.full(shape, -9.0, np.float32), core)
    close = distance < EXACT
    assert np.array_equal(found[close], distance[close] - np.float32(REACH))
    steps = np.abs(np.indices(shape) / SAMPLES - 6) - 3
    exact = np.linalg.norm(np.maximum(steps, 0), axis=0) - REACH
    assert np.abs(found - exact)[~close].max() < 1e-5


def test_what_is_far_from_the_core_is_measured_too():
    """A needle that the core does not follow: how far it stands out is the way to the nearest cell."""
    cells = np.zeros((8, 9, 40), dtype=bool)
    cells[2:6, 2:7, 3:7] = True
    phi = np.full((25, 28, 121), 3.0, np.float32)
    phi[6:19, 6:22, 9:22] = -1
    phi[12, 12, 20:100] = -0.2
    core = core_distance(cells)
    reached = within_reach(phi, core)
    assert reached[12, 12, 99] == pytest.approx(33 - 7 - REACH)
    found = lost_features(LevelSet(phi, 1.0, np.eye(4)), reached)
    assert [feature.out_mm for feature in found] == pytest.approx([33 - 7 - REACH])
    assert np.all(reached[(phi == 3) & (core.field > 3)] == 3)
