"""Simple points by labelling, and where the topology of cells is not that of samples."""

import numpy as np
import pytest
from scipy import ndimage

from gpubspline.mesh.blocks.core import euler_characteristic
from gpubspline.mesh.blocks.level_set import SAMPLES
from gpubspline.mesh.blocks.topology import deform, differences, is_simple, on_samples


def test_simple_points_by_labelling():
    """By scipy's labels of the 26 points inside, and of the 18 outside."""
    rng = np.random.default_rng(0)
    cubes = rng.random((3000, 27)) < rng.random((3000, 1))
    found = is_simple((cubes @ (1 << np.arange(27))).astype(np.int32))
    away = np.abs(np.indices((3, 3, 3)) - 1).sum(axis=0)
    for cube, simple in zip(cubes.reshape(-1, 3, 3, 3), found, strict=True):
        bodies = ndimage.label(cube & (away > 0), np.ones((3, 3, 3)))[1]
        outside = ndimage.label(~cube & (away > 0) & (away < 3))[0]
        touching = np.unique(outside[(away == 1) & (outside > 0)])
        assert simple == (bodies == 1 and len(touching) == 1)
    assert 500 < np.count_nonzero(found) < 2500


def test_a_simple_flip_keeps_the_euler_characteristic():
    """And any noise is taken to a ball of it, or to none, where all that is left is not simple."""
    rng = np.random.default_rng(1)
    noise, nothing = np.zeros((2, 14, 15, 16), dtype=bool)
    noise[1:-1, 1:-1, 1:-1] = ndimage.gaussian_filter(rng.normal(size=(12, 13, 14)), 1.0) < 0
    left = deform(noise, nothing)
    assert euler_characteristic(left) == euler_characteristic(noise) and 0 < left.sum() < 0.2 * noise.sum()
    assert np.array_equal(deform(left, nothing), left) and not (left & ~noise).any()


def block(hole: bool = False, cavity: bool = False, split: bool = False) -> np.ndarray:
    """Cells of a block: with a tunnel along k, with a cavity, or a ring that is cut."""
    cells = np.zeros((9, 11, 13), dtype=bool)
    cells[2:7, 2:9, 2:11] = True
    if hole:
        cells[:, 5, 6] = False
    if cavity:
        cells[4, 4, 4] = False
    if split:
        cells[:, :5, 6] = False
    return cells


@pytest.mark.parametrize(
    ("cells", "region", "what", "euler", "at"),
    [
        ({}, {"hole": True}, "closes a tunnel", -1, (6.5, 5.5)),
        ({"hole": True}, {}, "pierces a wall", 1, (6.5, 5.5)),
        ({"hole": True, "split": True}, {"hole": True}, "cuts a bridge", -1, (6.5, 3.5)),
        ({"hole": True}, {"hole": True, "split": True}, "fills a gap", 1, (6.5, 3.5)),
        ({}, {"cavity": True}, "fills a gap", 1, (4.5, 4.5)),
    ],
)
def test_each_kind_of_difference_is_found_where_it_is(cells, region, what, euler, at):
    """Also where samples of the region are a layer fewer all around, which is no difference."""
    wanted = on_samples(block(**region))
    thinner = wanted & ~ndimage.binary_dilation(on_samples(~block()), np.ones((3, 3, 3)))
    for inside in (wanted, thinner):
        (found,) = differences(block(**cells), inside)
        assert found.what == what and found.euler == euler
        assert np.abs(found.at[:2] - at).max() <= 1.5
    lacks = euler_characteristic(on_samples(block(**region))) - euler_characteristic(block(**cells))
    assert lacks == euler
    assert differences(block(**region), wanted) == () == differences(block(**region), thinner)


def test_two_differences_that_cancel_are_both_found():
    """A tunnel closed and a cavity filled: Euler characteristics are equal."""
    both = block(cavity=True)
    both[:, 5, 9] = False
    inside = on_samples(both)
    assert euler_characteristic(inside) == euler_characteristic(block()) == 1
    assert sorted(place.euler for place in differences(block(), inside)) == [-1, 1]
    assert inside.shape == tuple(SAMPLES * n + 1 for n in block().shape)


def test_a_tunnel_that_has_moved_is_no_difference_unless_it_went_far():
    inside = block(hole=True)
    for step, count in ((1, 0), (2, 0), (3, 2)):
        moved = block()
        moved[:, 5, 6 + step] = False
        assert len(differences(moved, on_samples(inside))) == count
