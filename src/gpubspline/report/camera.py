"""Where a picture is taken from: an orthographic camera in the patient's frame."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpubspline.errors import InputError

Floats = NDArray[np.float64]

OBLIQUE = (0.54, -0.76, 0.36)
"""From the patient's front, left and above: the face, a flank and the top of a body are all seen."""

SUPERIOR, ANTERIOR = (0.0, 0.0, 1.0), (0.0, -1.0, 0.0)


SIDES = {"L": (1, 0, 0), "R": (-1, 0, 0), "A": (0, -1, 0), "P": (0, 1, 0), "S": (0, 0, 1), "I": (0, 0, -1)}
"""From the body to a viewer at the patient's left, right, front, back, above, below, in LPS."""


def seen_from(sides: str) -> tuple[float, float, float]:
    """Direction from the body to a viewer at some of ``SIDES``, such as ``"A"``, or ``"als"`` for between them.

    Raises
    ------
    InputError for other letters, or where they cancel.
    """
    known = [SIDES[letter] for letter in sides.upper() if letter in SIDES]
    x, y, z = (float(sum(each[axis] for each in known)) for axis in range(3))
    if len(known) != len(sides) or x == y == z == 0:
        raise InputError(f"expected letters of {', '.join(SIDES)} to see a body from, such as A or ALS, got {sides!r}")
    return x, y, z


@dataclass(frozen=True, eq=False)
class Camera:
    """An orthographic camera.

    Attributes
    ----------
    right, up, toward: (3,) unit vectors in LPS: the picture's axes, and from the body to the viewer.
    """

    right: Floats
    up: Floats
    toward: Floats

    @staticmethod
    def looking(toward: ArrayLike) -> "Camera":
        """Place the viewer in a direction (3,) from the body; superior is up, or anterior where that is end-on."""
        direction = np.asarray(toward, dtype=np.float64) / np.linalg.norm(toward)
        above = ANTERIOR if abs(direction @ SUPERIOR) > 0.8 else SUPERIOR
        right = np.cross(above, direction)
        right /= np.linalg.norm(right)
        return Camera(right, np.cross(direction, right), direction)

    def project(self, points: ArrayLike) -> tuple[Floats, Floats]:
        """Picture coordinates (..., 2) in mm and nearness to the viewer (...,) of points (..., 3) in mm."""
        points = np.asarray(points, dtype=np.float64)
        return points @ np.stack([self.right, self.up], axis=-1), points @ self.toward


def facing_a_plane(normal: ArrayLike) -> Floats:
    """Side of a plane that radiology looks from: axial from below, coronal from the front, sagittal from the left.

    Arguments
    ---------
    normal: (3,) normal of the plane in LPS, of either sign.

    Returns
    -------
    (3,) the normal with the sign that points to the viewer.
    """
    direction = np.asarray(normal, dtype=np.float64)
    main = int(np.argmax(np.abs(direction)))
    sign = np.sign(direction[main]) * (1.0, -1.0, -1.0)[main]
    return np.asarray(direction * sign)
