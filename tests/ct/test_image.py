"""Every format through one door, against SimpleITK's own physical points."""

import struct

import numpy as np
import pytest
import SimpleITK as sitk

from gpubspline.ct.image import read_volume
from gpubspline.errors import InputError

REAL = ["head/ct_example.nii.gz", "vertebra/sub-ct_label-22_ct.nii.gz", "hips/example_ct.nii.gz"]


@pytest.mark.parametrize("name", REAL)
def test_affine_gives_simpleitks_physical_points(data, name):
    volume, image = read_volume(data / name), sitk.ReadImage(str(data / name))
    index = np.random.default_rng(0).uniform(-5, 300, (50, 3))
    points = [image.TransformContinuousIndexToPhysicalPoint(i) for i in index.tolist()]
    np.testing.assert_allclose(volume.to_points(index), points, atol=1e-9)
    np.testing.assert_allclose(volume.to_indices(points), index, atol=1e-9)
    np.testing.assert_array_equal(volume.hu, sitk.GetArrayFromImage(image))
    assert volume.hu.dtype == np.int16
    assert volume.shape == image.GetSize()


def oblique_image(samples):
    image = sitk.GetImageFromArray(samples)
    axes, _ = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))
    axes[:, 0] *= np.sign(np.linalg.det(axes)) or 1
    image.SetDirection((axes * [1, 1, -1]).ravel().tolist())  # left-handed
    image.SetSpacing((0.7, 0.8, 2.5))
    image.SetOrigin((10, -20, 30))
    return image


@pytest.mark.parametrize("extension", [".nii", ".nii.gz", ".nrrd", ".nhdr", ".mha", ".mhd"])
def test_formats_keep_values_and_oblique_left_handed_places(tmp_path, extension):
    samples = np.random.default_rng(4).integers(-1024, 3000, (5, 6, 7)).astype(np.int16)
    image = oblique_image(samples)
    sitk.WriteImage(image, str(tmp_path / f"ct{extension}"))
    volume = read_volume(tmp_path / f"ct{extension}")
    np.testing.assert_array_equal(volume.hu, samples)
    for index in ((0, 0, 0), (6, 5, 4), (3, 0, 2)):
        expected = image.TransformIndexToPhysicalPoint(index)
        np.testing.assert_allclose(volume.to_points(index), expected, atol=1e-4)  # NIfTI stores float32
    if not extension.startswith(".nii"):
        assert np.linalg.det(volume.affine[:3, :3]) < 0


@pytest.mark.parametrize(
    ("dtype", "highest", "expected"),
    [
        (np.uint8, 255, np.int16),
        (np.uint16, 32767, np.int16),
        (np.uint16, 32768, np.float32),
        (np.int32, -2000, np.int16),
        (np.float64, 3, np.float32),
    ],
)
def test_integers_that_fit_become_int16_and_the_rest_float32(tmp_path, dtype, highest, expected):
    samples = np.zeros((2, 3, 4), dtype=dtype)
    samples[1, 2, 3] = highest
    sitk.WriteImage(sitk.GetImageFromArray(samples), str(tmp_path / "a.nrrd"))
    volume = read_volume(tmp_path / "a.nrrd")
    assert volume.hu.dtype == expected
    np.testing.assert_array_equal(volume.hu, samples)


def test_a_two_dimensional_image_is_one_slice(tmp_path):
    image = sitk.GetImageFromArray(np.arange(12, dtype=np.int16).reshape(3, 4))
    image.SetSpacing((0.5, 0.6))
    sitk.WriteImage(image, str(tmp_path / "a.mha"))
    volume = read_volume(tmp_path / "a.mha")
    assert volume.shape == (4, 3, 1)
    np.testing.assert_allclose(np.diag(volume.affine), [0.5, 0.6, 1, 1])


def test_arrays_take_the_given_spacing(tmp_path):
    samples = np.arange(24, dtype=np.int64).reshape(2, 3, 4)
    np.save(tmp_path / "a.npy", samples)
    volume = read_volume(tmp_path / "a.npy", spacing_mm=(0.5, 0.6, 2))
    np.testing.assert_array_equal(volume.hu, samples)
    np.testing.assert_allclose(volume.to_points([3, 2, 1]), [1.5, 1.2, 2])
    with pytest.raises(InputError, match=r"expected the spacing of a\.npy in mm along i, j, k"):
        read_volume(tmp_path / "a.npy")
    with pytest.raises(InputError, match="three positive spacings"):
        read_volume(tmp_path / "a.npy", spacing_mm=(1, 0, 1))


def test_a_spacing_for_a_file_that_has_one_is_an_error(data):
    with pytest.raises(InputError, match=r"expected a spacing for \.npy only"):
        read_volume(data / REAL[0], spacing_mm=(1, 1, 1))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("name", ["a.npy", "a.mha"])
def test_nan_and_infinite_hu_are_errors(tmp_path, bad, name):
    samples = np.zeros((2, 3, 4), dtype=np.float32)
    samples[1, 1, 1] = bad
    np.save(tmp_path / "a.npy", samples)
    sitk.WriteImage(sitk.GetImageFromArray(samples), str(tmp_path / "a.mha"))
    with pytest.raises(InputError, match="finite HU everywhere, got NaN or infinity in 1 of 24 voxels"):
        read_volume(tmp_path / name, spacing_mm=(1, 1, 1) if name == "a.npy" else None)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("extension", [".nii", ".nii.gz"])
def test_nan_and_infinite_hu_of_nifti_are_errors_though_itk_makes_them_zero(tmp_path, bad, dtype, extension):
    samples = np.zeros((2, 3, 4), dtype=dtype)
    samples[1, 1, 1] = bad
    sitk.WriteImage(sitk.GetImageFromArray(samples), str(tmp_path / f"a{extension}"))
    with pytest.raises(InputError, match=r"finite HU everywhere in a\.nii.*, got NaN or infinity in 1 voxels"):
        read_volume(tmp_path / f"a{extension}")


@pytest.mark.parametrize("spoil", ["cut", "lost", "compressed"])
def test_samples_that_a_metaimage_lacks_are_told_in_one_line(tmp_path, capfd, spoil):
    image = sitk.GetImageFromArray(np.random.default_rng(1).integers(-1000, 1000, (5, 6, 7)).astype(np.int16))
    header, samples = tmp_path / "ct.mhd", tmp_path / ("ct.zraw" if spoil == "compressed" else "ct.raw")
    sitk.WriteImage(image, str(header), useCompression=spoil == "compressed")
    if spoil == "lost":
        samples.unlink()
    else:
        samples.write_bytes(samples.read_bytes()[:-9])
    expected = "got no such file" if spoil == "lost" else r"bytes of samples, got \d+: copy again"
    with pytest.raises(InputError, match=expected):
        read_volume(header)
    assert capfd.readouterr().err == ""  # ITK's own words go there past Python


@pytest.mark.parametrize("name", ["a.nrrd", "a.npy"])
def test_a_series_is_of_dicom_only(tmp_path, name):
    samples = np.zeros((2, 3, 4), dtype=np.int16)
    np.save(tmp_path / "a.npy", samples)
    sitk.WriteImage(sitk.GetImageFromArray(samples), str(tmp_path / "a.nrrd"))
    with pytest.raises(InputError, match=f"expected DICOM to take the series 1.2.3 from, got {name}"):
        read_volume(tmp_path / name, series="1.2.3")


@pytest.mark.parametrize("extension", [".nii", ".nii.gz", ".nrrd", ".mha"])
@pytest.mark.parametrize("share", [0.02, 0.6])
def test_truncated_images_get_one_line(tmp_path, extension, share):
    path = tmp_path / f"ct{extension}"
    samples = np.random.default_rng(5).integers(-1024, 3000, (9, 30, 30)).astype(np.int16)
    sitk.WriteImage(oblique_image(samples), str(path))
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(InputError, match=f"cannot read ct{extension} as") as caught:
        read_volume(path)
    assert "\n" not in str(caught.value)


def test_a_sheared_nifti_keeps_its_shear(tmp_path):
    """A gantry tilt in an sform, which ITK refuses; the rows are RAS."""
    path = tmp_path / "tilt.nii"
    samples = np.arange(60, dtype=np.int16).reshape(3, 4, 5)
    sitk.WriteImage(sitk.GetImageFromArray(samples), str(path))
    content = bytearray(path.read_bytes())
    rows = [0.5, 0, 0, 1, 0, 0.6, 0.7, 2, 0, 0, 2, 3]
    struct.pack_into("<hh", content, 252, 0, 1)
    struct.pack_into("<12f", content, 280, *rows)
    path.write_bytes(content)
    volume = read_volume(path)
    expected = np.reshape(rows, (3, 4)) * [[-1], [-1], [1]]
    np.testing.assert_allclose(volume.affine[:3], expected, rtol=1e-6)
    np.testing.assert_array_equal(volume.hu, samples)


def test_truncated_and_pickled_arrays_are_errors(tmp_path):
    path = tmp_path / "a.npy"
    np.save(path, np.zeros((20, 20, 20)))
    path.write_bytes(path.read_bytes()[:5000])
    with pytest.raises(InputError, match=r"cannot read a\.npy"):
        read_volume(path, spacing_mm=(1, 1, 1))
    np.save(path, np.array([{"a": 1}], dtype=object), allow_pickle=True)
    with pytest.raises(InputError, match=r"cannot read a\.npy"):
        read_volume(path, spacing_mm=(1, 1, 1))
    np.save(path, np.zeros(7))
    with pytest.raises(InputError, match=r"expected numbers of shape \(k, j, i\) in a\.npy, got \(7,\)"):
        read_volume(path, spacing_mm=(1, 1, 1))


def test_colour_and_time_series_are_errors(tmp_path):
    sitk.WriteImage(sitk.GetImageFromArray(np.zeros((2, 3, 4, 3), np.uint8), isVector=True), str(tmp_path / "c.mha"))
    with pytest.raises(InputError, match=r"one value a voxel, got vector of 8-bit unsigned integer in c\.mha"):
        read_volume(tmp_path / "c.mha")
    series = sitk.GetImageFromArray(np.zeros((2, 2, 3, 4), np.int16), isVector=False)
    sitk.WriteImage(series, str(tmp_path / "t.nii"))
    with pytest.raises(InputError, match=r"three-dimensional image in t\.nii, got size \(4, 3, 2, 2\)"):
        read_volume(tmp_path / "t.nii")
    sitk.WriteImage(series[..., :1], str(tmp_path / "one.nii"))
    assert read_volume(tmp_path / "one.nii").shape == (4, 3, 2)


def test_folders_without_dicom_are_errors(tmp_path):
    with pytest.raises(InputError, match="which is empty"):
        read_volume(tmp_path)
    (tmp_path / "LICENSE").write_text("text")
    with pytest.raises(InputError, match=r"expected a folder of DICOM files, got .* with 1 other files"):
        read_volume(tmp_path)
    (tmp_path / "a.dcm").write_bytes(b"")
    with pytest.raises(InputError, match=r"expected DICOM in a\.dcm, got 0 bytes that are not DICOM"):
        read_volume(tmp_path)


def test_missing_and_unknown_files_are_errors(tmp_path):
    with pytest.raises(InputError, match=r"expected an existing file or folder, got .*nothing"):
        read_volume(tmp_path / "nothing")
    (tmp_path / "a.txt").write_text("text")
    with pytest.raises(InputError, match=r"expected DICOM or one of .*, got a\.txt"):
        read_volume(tmp_path / "a.txt")
    with pytest.raises(InputError, match="at least one file"):
        read_volume([])


def test_lists_and_single_files_are_read(data):
    files = sorted((data / "dicom_j2k").glob("CT*"))
    assert read_volume(files[:3]).shape == (512, 512, 3)
    assert read_volume(files[:1]).shape == read_volume(str(files[0])).shape == (512, 512, 1)
    assert read_volume([data / REAL[0]]).shape == (256, 256, 26)
