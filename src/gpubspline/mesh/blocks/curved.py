"""Blocks curved on to their level set: hyperpatches to sample at any density, hex20 and hex27."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from gpubspline.device import Device
from gpubspline.mesh.bezier import BezierBlocks, bezier_blocks
from gpubspline.mesh.blocks.level_set import SAMPLES, LevelSet
from gpubspline.mesh.blocks.mesher import Blocks
from gpubspline.mesh.movable import one_level, put_level

Floats = NDArray[np.float64]

MOST_BEND = 0.02
"""Largest correction of a sample, in elements: a kink bends more, and is no curvature."""

_SLIDES = 3
"""Times that a point takes the Newton steps of the kernel: enough from a chord's middle."""


def curve(made: Blocks, *, degree: int = 2, floor: float = 0.0, device: Device) -> BezierBlocks:
    """Make each hex a Bezier hyperpatch whose outer faces follow the level set.

    Arguments
    ---------
    degree: 1 to 3.
    floor: least scaled Jacobian inside a block; see ``bezier_blocks``.
    """
    return bezier_blocks(made.mesh, onto(made.level, device), degree, floor)


def onto(level: LevelSet, device: Device) -> Callable[[Floats], Floats]:
    """Projection of points (n, 3), mm, on to the zero level."""
    back = np.linalg.inv(level.to_mm)
    held = put_level(_unbiased(level.phi), np.hstack([np.eye(3) * SAMPLES, np.zeros((3, 1))]), device)

    def project(points: Floats) -> Floats:
        at = points @ back[:3, :3].T + back[:3, 3]
        count = len(at)
        x = device.put(np.ascontiguousarray(at.T))
        slack, levels = device.put(np.zeros(count)), device.put(one_level(count))
        normal = device.empty(3 * count)
        for _ in range(_SLIDES):
            device.launch("optimize.slide", count, x, count, slack, levels, *held.arguments, normal)
        return level.in_mm(np.array(device.get(x)).reshape(3, -1).T)

    return project


def _unbiased(phi: NDArray[np.float32]) -> NDArray[np.float32]:
    """Samples whose trilinear interpolant is right on average: that of a bent field lies a twelfth of its bend off."""
    bend = np.zeros_like(phi)
    for axis in range(3):
        line, out = np.moveaxis(phi, axis, 0), np.moveaxis(bend, axis, 0)
        out[1:-1] += line[2:] - 2 * line[1:-1] + line[:-2]
    return np.asarray(phi - np.clip(bend / np.float32(12), -MOST_BEND, MOST_BEND), dtype=np.float32)
