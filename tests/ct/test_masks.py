"""Masks are taken on the volume's grid or not at all."""

import numpy as np
import pytest
import SimpleITK as sitk

from gpubspline.ct.image import read_volume
from gpubspline.ct.masks import read_mask
from gpubspline.ct.volume import Volume
from gpubspline.errors import InputError

AFFINE = np.array([[0.7, 0, 0, 5.0], [0, 0.8, 0, -3], [0, 0, 2, 1], [0, 0, 0, 1]])


@pytest.fixture
def volume():
    return Volume(np.zeros((4, 5, 6), np.int16), AFFINE)


def write(path, labels, origin=(5.0, -3.0, 1.0), spacing=(0.7, 0.8, 2.0)):
    image = sitk.GetImageFromArray(labels)
    image.SetSpacing(spacing)
    image.SetOrigin(origin)
    sitk.WriteImage(image, str(path))
    return path


def labels():
    values = np.zeros((4, 5, 6), np.uint8)
    values[1:3, 1:4, 2:5] = 3
    values[0, 0, 0] = 7
    return values


@pytest.mark.parametrize("extension", [".nii.gz", ".nrrd", ".mha"])
def test_labels_and_whole_masks(tmp_path, volume, extension):
    path = write(tmp_path / f"m{extension}", labels())
    np.testing.assert_array_equal(read_mask(path, volume), labels() > 0)
    np.testing.assert_array_equal(read_mask(path, volume, label=3), labels() == 3)
    assert read_mask(path, volume).dtype == bool


def test_arrays(tmp_path, volume):
    np.save(tmp_path / "m.npy", labels() > 0)
    np.testing.assert_array_equal(read_mask(tmp_path / "m.npy", volume), labels() > 0)
    np.save(tmp_path / "m.npy", labels()[1:])
    with pytest.raises(InputError, match=r"grid of 6x5x4 voxels, got 6x5x3 in m\.npy"):
        read_mask(tmp_path / "m.npy", volume)


def test_a_mask_on_another_grid_is_an_error_that_says_both(tmp_path, volume):
    with pytest.raises(InputError, match=r"grid of 6x5x4 voxels, got 5x5x4 in m\.nii"):
        read_mask(write(tmp_path / "m.nii", labels()[:, :, 1:]), volume)
    with pytest.raises(InputError, match=r"origin \(5, -3, 1\).*m\.nii with origin \(5, -3, 1.2\).* 0\.2 mm away"):
        read_mask(write(tmp_path / "m.nii", labels(), origin=(5, -3, 1.2)), volume)
    with pytest.raises(InputError, match=r"spacing \(0.7, 0.8, 2.5\) mm"):
        read_mask(write(tmp_path / "m.nii", labels(), spacing=(0.7, 0.8, 2.5)), volume)


def test_rounded_matrices_are_tolerated(tmp_path, volume):
    path = write(tmp_path / "m.nii", labels(), origin=(5.01, -3.01, 1.01), spacing=(0.701, 0.8, 2.0))
    assert read_mask(path, volume, label=7).sum() == 1


def test_absent_labels_and_empty_masks_are_errors(tmp_path, volume):
    path = write(tmp_path / "m.nii", labels())
    with pytest.raises(InputError, match=r"expected one of the labels 3, 7 of m\.nii, got 5"):
        read_mask(path, volume, label=5)
    with pytest.raises(InputError, match="every voxel is zero"):
        read_mask(write(tmp_path / "z.nii", labels() * 0), volume)
    with pytest.raises(InputError, match="existing mask file"):
        read_mask(tmp_path / "none.nii", volume)
    (tmp_path / "m.stl").write_text("solid")
    with pytest.raises(InputError, match=r"NIfTI, NRRD, MetaImage, DICOM SEG, RTSTRUCT or \.npy, got m\.stl"):
        read_mask(tmp_path / "m.stl", volume)


@pytest.mark.parametrize("extension", [".nrrd", ".npy"])  # of NIfTI the header's reader says it
def test_masks_of_anything_but_labels_are_refused(tmp_path, volume, extension):
    def keep(values):
        path = tmp_path / f"m{extension}"
        np.save(path, values) if extension == ".npy" else write(path, values)
        return path

    wild = labels().astype(np.float32)
    wild[0, 0, 1] = np.nan
    with pytest.raises(InputError, match=r"got NaN or infinity in 1 of 120 voxels"):
        read_mask(keep(wild), volume)
    soft = np.linspace(0, 1, 120, dtype=np.float32).reshape(4, 5, 6)
    with pytest.raises(InputError, match=r"whole numbers as labels in m\..*, got 119 values such as 0\.0084"):
        read_mask(keep(soft), volume)
    scaled = (labels() > 0) * np.float32(0.5)
    np.testing.assert_array_equal(read_mask(keep(scaled), volume, label=1), labels() > 0)
    with pytest.raises(InputError, match=r"one of the labels 3, 7 of m\..*, got \u00b2"):
        read_mask(keep(labels()), volume, label="\u00b2")


def test_vertebra_labels_lie_on_their_ct(data):
    volume = read_volume(data / "vertebra" / "sub-ct_label-22_ct.nii.gz")
    path = data / "vertebra" / "sub-ct_seg-vert_label-22_msk.nii.gz"
    mask = read_mask(path, volume, label=22)
    np.testing.assert_array_equal(mask, sitk.GetArrayFromImage(sitk.ReadImage(str(path))) == 22)
    assert volume.hu[mask].mean() > volume.hu[~mask].mean() + 100  # bone within flesh
    with pytest.raises(InputError, match=r"expected one of the labels .*22.*, got 1\b"):
        read_mask(path, volume, label=1)
