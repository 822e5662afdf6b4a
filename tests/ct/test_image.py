"""Every format through one door, against SimpleITK's own physical points."""

import gzip
import struct

import numpy as np
import pytest
import SimpleITK as sitk

from gpubspline.ct.image import read_volume
from gpubspline.errors import GpubsplineWarning, InputError

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
    with pytest.raises(InputError, match=r"finite HU everywhere in a\.nii.*, got NaN or infinity in 1 of 24 voxels"):
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


def nifti(path, *, codes, rows=None, sizes=(1.0, 1.0, 1.0), units=2, order="<"):
    """An image of 4 x 3 x 2 voxels whose qform is of 1 mm at (1, 2, 3) RAS; by hand, since ITK writes what it reads."""
    content = bytearray(352)
    for form, at, values in (
        ("i", 0, [348]),
        ("8h", 40, [3, 4, 3, 2, 1, 1, 1, 1]),
        ("2h", 70, [4, 16]),
        ("8f", 76, [1, *sizes, 0, 0, 0, 0]),
        ("f", 108, [352]),
        ("b", 123, [units]),
        ("2h", 252, codes),
        ("3f", 268, [1, 2, 3]),
        ("12f", 280, [2, 0, 0, 10, 0, 2, 0, 20, 0, 0, 2, 30] if rows is None else rows),
    ):
        struct.pack_into(order + form, content, at, *values)
    content[344:348] = b"n+1\0"
    path.write_bytes(bytes(content) + np.arange(24).astype(f"{order}i2").tobytes())
    return path


@pytest.mark.parametrize("form", [0, 1])  # quaternions and rows
@pytest.mark.parametrize("turn", range(5))
def test_each_form_of_nifti_alone_is_simpleitks(tmp_path, form, turn):
    """Half turns are where the quaternion has no real part."""
    path, image = tmp_path / "a.nii", sitk.GetImageFromArray(np.zeros((3, 4, 5), np.int16))
    axes = [np.diag(signs) for signs in ((1, 1, 1), (-1, -1, 1), (1, -1, -1))]
    axes += [np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0] for seed in (1, 2)]
    image.SetDirection((axes[turn] * [1, 1, np.linalg.det(axes[turn])]).ravel().tolist())
    image.SetSpacing((0.4, 0.5, 3))
    image.SetOrigin((312.5, -420.25, 1030.125))
    sitk.WriteImage(image, str(path))
    content = bytearray(path.read_bytes())
    struct.pack_into("<h", content, 254 if form == 0 else 252, 0)
    path.write_bytes(content)
    points = [image.TransformIndexToPhysicalPoint(index) for index in ((0, 0, 0), (4, 0, 0), (0, 3, 0), (4, 3, 2))]
    volume = read_volume(path)
    np.testing.assert_allclose(volume.to_points([(0, 0, 0), (4, 0, 0), (0, 3, 0), (4, 3, 2)]), points, atol=1e-4)


@pytest.mark.parametrize(
    ("codes", "size", "origin"),
    [((1, 1), 2, 10), ((1, 2), 1, 1), ((1, 4), 1, 1), ((2, 1), 2, 10), ((2, 4), 1, 1)],
)
@pytest.mark.parametrize("order", "<>")
def test_forms_of_nifti_that_differ_are_warned_of(tmp_path, codes, size, origin, order):
    """The one that ITK chooses, by its codes; its size is its own, not pixdim's."""
    path = nifti(tmp_path / "a.nii", codes=codes, order=order)
    with pytest.warns(GpubsplineWarning, match=r"the qform and the sform of a\.nii are up to 36\.4 mm apart"):
        volume = read_volume(path)
    np.testing.assert_allclose(volume.spacing_mm, size)
    assert volume.affine[0, 3] == -origin == sitk.ReadImage(str(path)).GetOrigin()[0]
    np.testing.assert_array_equal(volume.hu.ravel(), np.arange(24))


def test_a_registration_is_not_taken_for_the_scanner(tmp_path):
    """A sheared sform that leads to a template, beside the scanner's qform: bones must keep their size."""
    path = nifti(tmp_path / "a.nii", codes=(1, 4), rows=[1.2, 0, 0.3, 1, 0, 1.2, 0, 2, 0, 0, 1.2, 3])
    with pytest.warns(GpubsplineWarning, match="the qform is taken"):
        np.testing.assert_allclose(read_volume(path).spacing_mm, 1)


def test_nifti_sizes_and_units(tmp_path):
    rows = nifti(tmp_path / "a.nii", codes=(0, 2))
    np.testing.assert_allclose(read_volume(rows).spacing_mm, 2)
    metres = nifti(tmp_path / "b.nii", codes=(1, 0), sizes=[0.001] * 3, units=1)
    np.testing.assert_allclose(read_volume(metres).affine[:3], [[-1, 0, 0, -1e3], [0, -1, 0, -2e3], [0, 0, 1, 3e3]])
    bare = nifti(tmp_path / "c.nii", codes=(0, 0), sizes=(1, 2, 3))
    with pytest.warns(GpubsplineWarning, match=r"c\.nii says nothing of its orientation"):
        np.testing.assert_allclose(read_volume(bare).affine, np.diag([1, 2, 3, 1]))


@pytest.mark.parametrize(
    ("wanted", "words"),
    [
        ({"codes": (1, 0), "sizes": (1, 1, 0)}, "sizes of voxels above 0 mm in a.nii, got 1 x 1 x 0"),
        ({"codes": (1, 0), "sizes": (-1, 1, 1)}, "got -1 x 1 x 1"),
        ({"codes": (0, 1), "rows": [np.nan] * 12}, "an invertible orientation in a.nii"),
        ({"codes": (0, 1), "rows": [0, 0, 0, 1, 0, 2, 0, 1, 0, 0, 2, 1]}, "an invertible orientation in a.nii"),
    ],
)
def test_nifti_without_a_place_is_refused(tmp_path, capfd, wanted, words):
    with pytest.raises(InputError, match=words):
        read_volume(nifti(tmp_path / "a.nii", **wanted))
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(("slope", "intercept"), [(0.5, -1024.0), (1.0, -1024.0), (-1.0, 3.0), (np.nan, np.nan)])
def test_stored_values_of_nifti_are_scaled_as_simpleitk_does(tmp_path, slope, intercept):
    path = nifti(tmp_path / "a.nii", codes=(1, 0))
    content = bytearray(path.read_bytes())
    struct.pack_into("<2f", content, 112, slope, intercept)
    path.write_bytes(content)
    np.testing.assert_array_equal(read_volume(path).hu, sitk.GetArrayFromImage(sitk.ReadImage(str(path))))


def test_a_slope_of_zero_scales_nothing_in_nifti(tmp_path):
    """As nifti1.h says, where ITK adds the intercept: bone would be 1,024 HU off."""
    path = nifti(tmp_path / "a.nii", codes=(1, 0))
    content = bytearray(path.read_bytes())
    struct.pack_into("<2f", content, 112, 0, -1024)
    path.write_bytes(content)
    np.testing.assert_array_equal(read_volume(path).hu.ravel(), np.arange(24))


def test_nifti_2_is_read_as_nifti_1_of_the_same_fields(tmp_path):
    """Which ITK does not know: its fields are wider and elsewhere (nifti2.h)."""
    one = read_volume(nifti(tmp_path / "a.nii", codes=(0, 1)))
    content = bytearray(544)
    for form, at, values in (
        ("i8s", 0, [540, b"n+2\0\r\n\x1a\n"]),
        ("2h", 12, [4, 16]),
        ("8q", 16, [3, 4, 3, 2, 1, 1, 1, 1]),
        ("8d", 104, [1, 1, 1, 1, 0, 0, 0, 0]),
        ("q", 168, [544]),
        ("2d", 176, [1, -5]),
        ("2i", 344, [0, 1]),
        ("12d", 400, [2, 0, 0, 10, 0, 2, 0, 20, 0, 0, 2, 30]),
        ("i", 500, [2]),
    ):
        struct.pack_into("<" + form, content, at, *values)
    (tmp_path / "b.nii").write_bytes(bytes(content) + np.arange(24).astype("<i2").tobytes())
    two = read_volume(tmp_path / "b.nii")
    np.testing.assert_array_equal(two.hu, one.hu - 5)
    np.testing.assert_array_equal(two.affine, one.affine)


def test_whether_nifti_is_compressed_is_seen_and_not_taken_from_the_name(tmp_path):
    plain = nifti(tmp_path / "a.nii.gz", codes=(1, 0)).read_bytes()
    (tmp_path / "b.nii").write_bytes(gzip.compress(plain))
    np.testing.assert_array_equal(read_volume(tmp_path / "a.nii.gz").hu, read_volume(tmp_path / "b.nii").hu)


@pytest.mark.parametrize(("kind", "words"), [(32, "got complex"), (128, "got RGB"), (5, "got the data type 5")])
def test_nifti_of_other_than_one_number_a_voxel_is_refused(tmp_path, kind, words):
    path = nifti(tmp_path / "a.nii", codes=(1, 0))
    content = bytearray(path.read_bytes())
    struct.pack_into("<h", content, 70, kind)
    path.write_bytes(content)
    with pytest.raises(InputError, match=f"expected one value a voxel, {words} in a.nii"):
        read_volume(path)


@pytest.mark.parametrize(("extension", "field"), [(".mha", "ElementSpacing"), (".nrrd", "space directions")])
def test_images_that_do_not_tell_their_size_are_refused(tmp_path, extension, field):
    """ITK takes 1 mm."""
    path = tmp_path / f"a{extension}"
    sitk.WriteImage(sitk.GetImageFromArray(np.zeros((3, 4, 5), np.int16)), str(path))
    assert read_volume(path).shape == (5, 4, 3)
    lines = path.read_bytes().split(b"\n")
    path.write_bytes(b"\n".join(line for line in lines if not line.startswith(field.encode())))
    assert sitk.ReadImage(str(path)).GetSpacing() == (1, 1, 1)
    with pytest.raises(InputError, match=rf"the size of voxels in a\{extension}"):
        read_volume(path)


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
