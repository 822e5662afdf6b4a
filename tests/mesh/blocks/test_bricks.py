"""Samples near a surface: what is done in bricks is what SciPy and ITK do to the whole grid."""

import numpy as np
import pytest
import SimpleITK as sitk
from scipy.ndimage import gaussian_filter, label

from gpubspline.mesh.blocks.bricks import EDGE, FAR, bricks_round, bricks_where
from gpubspline.mesh.blocks.runs import runs_of

SHAPE = (49, 61, 40)


def blobs() -> np.ndarray:
    """A smooth field with several bodies and hollows, that stays away from the border."""
    noise = gaussian_filter(np.random.default_rng(2).standard_normal(SHAPE), 2.5)
    k, j, i = (np.abs(index - (n - 1) / 2) / (n / 2 - 6) for index, n in zip(np.indices(SHAPE), SHAPE, strict=True))
    return (0.3 + noise / noise.std() + 30 * np.maximum(np.maximum(k, np.maximum(j, i)) - 1, 0)).astype(np.float32)


def all_bricks(shape=SHAPE):
    near = np.ones([-(-n // EDGE) for n in shape], dtype=bool)
    return bricks_where(near, ~near, shape)


def test_smoothing_is_scipys():
    field = np.pad(blobs()[8:-8, 8:-8, 8:-8], 8)
    found = all_bricks().smoothed(all_bricks().of(field, 0, 0), 1.8)
    assert np.abs(all_bricks().field(found) - gaussian_filter(field, 1.8, truncate=3.0)).max() < 1e-6


def test_depth_is_itks_as_far_as_it_is_asked():
    inside = blobs() < 0
    image = sitk.GetImageFromArray(inside.astype(np.uint8))
    steps = sitk.GetArrayFromImage(sitk.SignedMaurerDistanceMap(image, True, False, False))
    bricks = all_bricks()
    found = bricks.field(bricks.depth(bricks.of(inside, True, False)))
    close = np.abs(steps) <= FAR
    assert np.array_equal(found[close], steps[close]) and np.all(np.abs(found[~close]) > FAR)


def test_only_bricks_near_the_surface_are_kept():
    """A ball in a large grid: what is far keeps its value, and depths are right to the width of a step."""
    k, j, i = np.indices((160, 150, 140)) - 71.0
    field = np.clip(np.sqrt(k**2 + j**2 + i**2) - 55, -9, 9).astype(np.float32)
    bricks = bricks_round(field, 9.0)
    assert 0.1 * bricks.numbers.size < bricks.count < 0.5 * bricks.numbers.size
    values = bricks.of(field, -9, 9)
    assert np.array_equal(bricks.field(values), field)
    turned = bricks.put(-values, field.copy())
    near = bricks.field(np.concatenate([np.ones_like(values[:-2]), np.zeros_like(values[-2:])])) > 0
    assert np.array_equal(turned, np.where(near, -field, field)) and near[np.abs(field) < 9].all()
    found = bricks.field(bricks.depth(values < 0))
    exact = np.sqrt(k**2 + j**2 + i**2) - 55
    assert np.abs(found + exact)[np.abs(exact) < 8].max() < 1.8


def test_cells_are_summed_and_spread():
    """Sums over the samples of a cell; a linear field between the middles of cells comes back."""
    shape = (37, 25, 28)
    bricks, samples = all_bricks(shape), np.random.default_rng(1).random(shape)
    sums = bricks.summed_in_cells(bricks.of(samples, 0, 0), 3)
    expected = samples[:-1, :-1, :-1].reshape(12, 3, 8, 3, 9, 3).sum(axis=(1, 3, 5))
    assert sums == pytest.approx(expected)
    k, j, i = (np.arange(n) for n in (12, 8, 9))
    cells = 2.0 * k[:, None, None] - j[:, None] + 0.5 * i
    found = bricks.field(bricks.between_cells(cells, 3))
    k, j, i = ((np.arange(n) - 1) / 3 for n in shape)
    exact = 2.0 * k[:, None, None] - j[:, None] + 0.5 * i
    inner = (slice(1, -3),) * 3
    assert found[inner] == pytest.approx(exact[inner], abs=1e-5)


@pytest.mark.parametrize("level", [0.0, -0.7])
def test_bodies_are_scipys(level):
    mask = blobs() < level
    numbers, count = label(mask)
    runs = runs_of(mask)
    assert count > 1 and len(runs.sizes) == count
    found = np.zeros(mask.size, dtype=int)
    found[runs.samples(np.ones(len(runs.start), dtype=bool))] = np.repeat(runs.bodies + 1, runs.stop - runs.start)
    assert np.array_equal(found.reshape(SHAPE), numbers)
    assert np.array_equal(runs.sizes, np.bincount(numbers.ravel())[1:])
