"""Places of the lattice against the region: shifted by part of an element, and turned."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Floats = NDArray[np.float64]

GOLDEN = 0.8191725133961645
"""Its powers, times the number of the attempt, spread the lattice's offsets evenly. Source: Roberts 2018, R3."""


@dataclass(frozen=True, eq=False)
class Placement:
    """One place of the lattice.

    Attributes
    ----------
    offset: of the lattice against the region, in elements.
    turn_degrees: of the lattice against its given axes: a rotation vector, as long as its angle.
    """

    offset: tuple[float, float, float]
    turn_degrees: tuple[float, float, float]

    def axes(self, given: Floats | None) -> Floats:
        """Columns (3, 3) of the turned lattice's axes; ``given`` are those that it is turned from."""
        turned = Rotation.from_rotvec(np.array(self.turn_degrees), degrees=True).as_matrix()
        return np.asarray(turned if given is None else turned @ given)


def placement(number: int) -> Placement:
    """Give the places in the order in which they are tried: the first as given, then shifted and turned by turns.

    Offsets and rotations each fill the cube of three numbers evenly, and are the same each time.

    Source: rotations from three numbers by Shoemake 1992, Uniform random rotations, Graphics Gems III.
    """
    first, second, third = (round((number * GOLDEN**power) % 1, 4) for power in (1, 2, 3))
    if number % 2 == 0:
        return Placement((first, second, third), (0.0, 0.0, 0.0))
    low, high = np.sqrt(1 - first), np.sqrt(first)
    a, b = 2 * np.pi * second, 2 * np.pi * third
    turn = Rotation.from_quat([low * np.sin(a), low * np.cos(a), high * np.sin(b), high * np.cos(b)])
    x, y, z = (round(float(degrees), 2) for degrees in turn.as_rotvec(degrees=True))
    return Placement((0.0, 0.0, 0.0), (x, y, z))
