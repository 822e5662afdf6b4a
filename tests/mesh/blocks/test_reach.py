"""What the surface of a core can reach, and what it leaves out."""

import numpy as np
import pytest

from gpubspline.mesh.blocks.level_set import SAMPLES, LevelSet
from gpubspline.mesh.blocks.reach import REACH, core_distance, lost_features, within_reach


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
    distance = core_distance(cells, shape)
    middle = 6 * SAMPLES
    assert distance[middle, middle, middle] < -2
    assert distance[middle, middle, 3 * SAMPLES] == pytest.approx(0, abs=0.05)  # the middle of a face of the core
    assert distance[middle, middle, SAMPLES] == pytest.approx(2, abs=0.05)
    far = within_reach(np.full(shape, -9.0, np.float32), cells)
    assert np.array_equal(far, distance - np.float32(REACH))
