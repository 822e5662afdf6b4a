"""The camera's axes, and the sides that pictures are taken from."""

import numpy as np
import pytest

from gpubspline.report.camera import OBLIQUE, Camera, facing_a_plane, seen_from

LEFT, POSTERIOR, SUPERIOR = np.eye(3)


@pytest.mark.parametrize("toward", [OBLIQUE, LEFT, -POSTERIOR, SUPERIOR, -SUPERIOR, (1, 2, -3), (0.3, 0.1, 5)])
def test_axes_are_orthonormal_and_right_handed(toward: np.ndarray) -> None:
    camera = Camera.looking(toward)
    axes = np.stack([camera.right, camera.up, camera.toward])
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(axes) == pytest.approx(1.0)
    np.testing.assert_allclose(camera.toward, np.divide(toward, np.linalg.norm(toward)))


def test_left_of_the_patient_is_right_of_the_picture_from_the_front() -> None:
    camera = Camera.looking(-POSTERIOR)
    picture, near = camera.project(np.array([LEFT, SUPERIOR, -POSTERIOR]))
    np.testing.assert_allclose(picture, [[1, 0], [0, 1], [0, 0]], atol=1e-15)
    np.testing.assert_allclose(near, [0, 0, 1], atol=1e-15)


@pytest.mark.parametrize(
    ("normal", "seen_from", "right", "up"),
    [
        (SUPERIOR, -SUPERIOR, LEFT, -POSTERIOR),  # axial: from the feet, nose up, the patient's left on the right
        (POSTERIOR, -POSTERIOR, LEFT, SUPERIOR),  # coronal: from the front
        (-LEFT, LEFT, POSTERIOR, SUPERIOR),  # sagittal: from the left, nose on the left
    ],
)
def test_slices_are_seen_as_radiology_sees_them(
    normal: np.ndarray, seen_from: np.ndarray, right: np.ndarray, up: np.ndarray
) -> None:
    for sign in (1, -1):
        camera = Camera.looking(facing_a_plane(sign * normal))
        np.testing.assert_allclose([camera.toward, camera.right, camera.up], [seen_from, right, up], atol=1e-15)


def test_sides_are_the_patients() -> None:
    """In LPS: x to the left, y to the back, z to the head."""
    for side, place in (("L", LEFT), ("P", POSTERIOR), ("S", SUPERIOR), ("aI", -POSTERIOR - SUPERIOR)):
        np.testing.assert_array_equal(seen_from(side), place)
    np.testing.assert_allclose(Camera.looking(seen_from("I")).right, LEFT, atol=1e-15)
