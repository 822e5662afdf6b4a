"""Regions with formulas for their sections."""

import numpy as np
import pytest

from gpubspline.ct.region import Region
from gpubspline.ct.volume import Volume

SHAPE = (24, 60, 70)


def region_of(level, steps=None, shape=SHAPE):
    """Region where ``level(x, y, z)`` (about mm) is negative, on a grid round the origin."""
    affine = np.eye(4)
    affine[:3, :3] = np.eye(3) if steps is None else steps
    middle = (np.array(shape[::-1]) - 1) / 2
    affine[:3, 3] = -affine[:3, :3] @ middle
    k, j, i = np.indices(shape)
    points = np.stack([i, j, k], axis=-1) @ affine[:3, :3].T + affine[:3, 3]
    values = level(*np.moveaxis(points, -1, 0)).astype(np.float32)
    values = np.where(values == 0, np.float32(1e-4), values)
    return Region(values < 0, values, affine)


def ellipse(a=24.0, b=16.0):
    """Level of an upright elliptical cylinder, to first order the distance."""

    def level(x, y, z):
        f = np.hypot(x / a, y / b)
        return (f - 1) * f / np.maximum(np.hypot(x / a**2, y / b**2), 1e-9)

    return level


@pytest.fixture(scope="session")
def cylinder():
    """Elliptical cylinder of half axes 24 and 16, cut at both ends, 23 mm long."""
    return region_of(ellipse())


@pytest.fixture(scope="session")
def linear_ct(cylinder):
    """HU linear in place: 2 x - y + 3 z + 100."""
    k, j, i = np.indices(SHAPE)
    x, y, z = np.moveaxis(np.stack([i, j, k], axis=-1) + cylinder.affine[:3, 3], -1, 0)
    return Volume((2 * x - y + 3 * z + 100).astype(np.float32), cylinder.affine)


@pytest.fixture(scope="session")
def make_region():
    return region_of


@pytest.fixture(scope="session")
def ellipse_level():
    return ellipse
