"""The volume's checks, its map to the patient and its crop."""

import numpy as np
import pytest
import SimpleITK as sitk

from gpubspline.ct.volume import Volume
from gpubspline.errors import InputError

SHEARED = np.array([[0.5, 0, 0.1, 3.0], [0, 0.6, 0.4, -2], [0.1, -0.2, 2.0, 7], [0, 0, 0, 1]])


def test_points_and_indices_are_inverse():
    volume = Volume(np.zeros((3, 4, 5), np.int16), SHEARED)
    index = np.random.default_rng(0).normal(size=(7, 2, 3))
    np.testing.assert_allclose(volume.to_indices(volume.to_points(index)), index, atol=1e-12)
    np.testing.assert_allclose(volume.to_points([1, 0, 0]) - volume.to_points([0, 0, 0]), SHEARED[:3, 0])


def test_shape_spacing_and_voxel_volume():
    volume = Volume(np.zeros((3, 4, 5), np.int16), np.diag([0.5, 0.6, -2, 1]))
    assert volume.shape == (5, 4, 3)
    np.testing.assert_allclose(volume.spacing_mm, [0.5, 0.6, 2])
    np.testing.assert_allclose(volume.voxel_mm3, 0.6)


def test_crop_agrees_with_simpleitk():
    samples = np.random.default_rng(1).integers(-1000, 1000, (5, 6, 7)).astype(np.int16)
    image = sitk.GetImageFromArray(samples)
    image.SetSpacing((0.5, 0.6, 2.0))
    image.SetOrigin((1, 2, 3))
    affine = np.diag([0.5, 0.6, 2.0, 1])
    affine[:3, 3] = 1, 2, 3
    cropped, expected = Volume(samples, affine).crop((1, 2, 0), (6, 9, 3)), image[1:6, 2:6, 0:3]
    np.testing.assert_array_equal(cropped.hu, sitk.GetArrayFromImage(expected))
    np.testing.assert_allclose(cropped.affine[:3, 3], expected.GetOrigin())


def test_sheared_crop_keeps_every_voxel_in_place():
    volume = Volume(np.arange(60, dtype=np.int16).reshape(3, 4, 5), SHEARED)
    cropped = volume.crop((2, 1, 1), (4, 3, 3))
    np.testing.assert_allclose(cropped.to_points([0, 0, 0]), volume.to_points([2, 1, 1]))
    assert cropped.hu[0, 0, 0] == volume.hu[1, 1, 2]


@pytest.mark.parametrize(
    ("hu", "affine", "message"),
    [
        (np.zeros((3, 4)), np.eye(4), r"shape \(k, j, i\), got \(3, 4\)"),
        (np.zeros((0, 3, 4)), np.eye(4), r"got \(0, 3, 4\)"),
        (np.full((1, 1, 2), np.nan), np.eye(4), "finite HU everywhere, got NaN or infinity in 2 of 2"),
        (np.zeros((1, 1, 2)), np.diag([1, 1, 0, 1]), "invertible 4x4 affine"),
        (np.zeros((1, 1, 2)), np.eye(3), "invertible 4x4 affine"),
    ],
)
def test_what_is_no_volume_is_an_error(hu, affine, message):
    with pytest.raises(InputError, match=message):
        Volume(hu, affine)


def test_an_empty_crop_is_an_error():
    with pytest.raises(InputError, match=r"crop inside the \(2, 2, 2\) voxels"):
        Volume(np.zeros((2, 2, 2)), np.eye(4)).crop((0, 0, 2), (2, 2, 9))
