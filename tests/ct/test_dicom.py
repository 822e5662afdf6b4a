"""DICOM series: values and places against what was written, and against SimpleITK/GDCM on real scanners' files."""

import shutil
import tracemalloc
import warnings

import gdcm
import numpy as np
import pydicom
import pytest
import SimpleITK as sitk
from pydicom.dataset import Dataset
from pydicom.pixels.decoders.base import get_decoder
from pydicom.sequence import Sequence
from pydicom.uid import EnhancedCTImageStorage, ImplicitVRLittleEndian, JPEGLSLossless, RLELossless
from scipy.interpolate import interp1d

from gpubspline.ct.image import read_volume
from gpubspline.errors import GpubsplineWarning, InputError

SERIES = "1.2.826.0.1.3680043.8.498.1"


def slices(folder):
    return sorted(p for p in folder.iterdir() if p.name != "LICENSE")


@pytest.mark.parametrize("name", ["dicom_j2k", "dicom_tilt"])
def test_every_voxel_lies_where_simpleitk_puts_it(data, name):
    """SimpleITK reads each slice alone, so tilt and spacing cannot confuse it."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", GpubsplineWarning)
        volume = read_volume(data / name)
    for path in slices(data / name):
        image = sitk.ReadImage(str(path))
        for i, j in ((0, 0), (511, 0), (100, 411), (511, 511)):
            index = volume.to_indices(image.TransformIndexToPhysicalPoint((i, j, 0)))
            # across the slices: exact; along them, a slice of the uneven series lies between two of the even one
            np.testing.assert_allclose(index[:2], (i, j), atol=2e-3)
            assert -1e-3 <= index[2] <= volume.shape[2] - 1 + 1e-3


def test_jpeg_2000_values_agree_with_gdcm(data):
    volume = read_volume(data / "dicom_j2k")
    assert volume.hu.dtype == np.int16
    assert volume.source == "DICOM CT, 20 slices"
    places = []
    for path in slices(data / "dicom_j2k"):
        image = sitk.ReadImage(str(path))
        k = volume.to_indices(image.GetOrigin())[2]
        places.append(k)
        np.testing.assert_array_equal(volume.hu[round(k)], sitk.GetArrayFromImage(image)[0])
    np.testing.assert_allclose(sorted(places), np.arange(20), atol=1e-6)


def test_tilted_head_agrees_with_slices_read_one_by_one(data):
    """SciPy's interpolation between SimpleITK's slices, whose origins differ in z alone; 0.5 HU for rounding."""
    with pytest.warns(GpubsplineWarning, match=r"13 x 4.002, 1 x 1.081, 13 x 6.999 mm resampled to 37 slices"):
        volume = read_volume(data / "dicom_tilt")
    images = [sitk.ReadImage(str(path)) for path in slices(data / "dicom_tilt")]
    origins = np.array([image.GetOrigin() for image in images])
    assert np.ptp(origins[:, :2], axis=0).max() == 0
    pixels = np.maximum([sitk.GetArrayFromImage(image)[0, ::7, ::5] for image in images], -1024.0)
    z = volume.to_points([[0, 0, k] for k in range(volume.shape[2])])[:, 2]
    expected = interp1d(origins[:, 2], pixels, axis=0)(np.clip(z, *origins[[0, -1], 2]))
    np.testing.assert_allclose(volume.hu[:, ::7, ::5], expected, atol=0.501)


def test_tilted_head_has_the_extents_of_its_slices(data):
    """Left-right and front-back extents of the skin, in LPS mm, within a voxel of SimpleITK's slices."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", GpubsplineWarning)
        volume = read_volume(data / "dicom_tilt")
    mine, theirs = [], []
    for path in slices(data / "dicom_tilt"):
        image = sitk.ReadImage(str(path))
        j, i = np.nonzero(sitk.GetArrayFromImage(image)[0] > -200)
        theirs += [image.TransformIndexToPhysicalPoint((int(a), int(b), 0)) for a, b in zip(i, j, strict=True)]
    k, j, i = np.nonzero(volume.hu > -200)
    mine = volume.to_points(np.stack([i, j, k], axis=1))
    for find in (np.min, np.max):
        np.testing.assert_allclose(find(mine, axis=0)[:2], find(np.array(theirs), axis=0)[:2], atol=0.489)


def test_slices_are_sorted_by_place_and_not_by_name_or_number(tmp_path, write_slice):
    heights = [5.0, -2.0, 12.0, 19.0, -9.0]
    for number, height in enumerate(heights):
        write_slice(tmp_path / f"{number}.dcm", np.full((4, 5), height + 100), (0, 0, height), InstanceNumber=number)
    volume = read_volume(tmp_path)
    np.testing.assert_array_equal(volume.hu[:, 0, 0], np.sort(heights) + 100 - 1024)
    np.testing.assert_allclose(volume.affine, [[0.7, 0, 0, 0], [0, 0.8, 0, 0], [0, 0, 7, -9], [0, 0, 0, 1]])


@pytest.mark.parametrize("signed", [False, True])
@pytest.mark.parametrize("bits", [12, 16])
def test_signed_and_unsigned_values_of_12_and_16_bits(tmp_path, write_slice, signed, bits):
    low = -(2 ** (bits - 1)) if signed else 0
    stored = np.linspace(low, low + 2**bits - 1, 20).round().astype(int).reshape(4, 5)
    write_slice(tmp_path / "a.dcm", stored, (0, 0, 0), signed=signed, bits=bits, RescaleIntercept=-10)
    hu = read_volume(tmp_path).hu
    np.testing.assert_array_equal(hu[0], stored - 10)
    assert hu.dtype == (np.float32 if bits == 16 else np.int16)  # 16 bits less 10 leave the range of int16


def test_bits_above_those_stored_are_ignored(tmp_path, write_slice):
    stored = np.arange(20).reshape(4, 5)
    write_slice(tmp_path / "a.dcm", stored + (7 << 12), (0, 0, 0))
    np.testing.assert_array_equal(read_volume(tmp_path).hu[0], stored - 1024)


def test_each_slice_has_its_own_rescale(tmp_path, write_slice):
    stored = np.arange(20).reshape(4, 5)
    for k, (slope, intercept) in enumerate([(1, -1024), (2, -1000), (0.5, 3.25)]):
        write_slice(tmp_path / f"{k}", stored, (0, 0, k), RescaleSlope=slope, RescaleIntercept=intercept)
    hu = read_volume(tmp_path).hu
    assert hu.dtype == np.float32
    np.testing.assert_array_equal(hu, [stored - 1024, 2 * stored - 1000, stored / 2 + 3.25])


@pytest.mark.parametrize("signed", [False, True])
def test_monochrome1_is_turned_over_as_gdcm_does(tmp_path, write_slice, signed):
    stored = np.arange(-10 if signed else 0, 190 if signed else 200).reshape(10, 20)
    path = write_slice(tmp_path / "a.dcm", stored, (0, 0, 0), signed=signed, PhotometricInterpretation="MONOCHROME1")
    hu = read_volume(path).hu
    np.testing.assert_array_equal(hu[0], (-1 if signed else 4095) - stored - 1024)
    if not signed:
        np.testing.assert_array_equal(hu, sitk.GetArrayFromImage(sitk.ReadImage(str(path))))


def test_padding_becomes_air(tmp_path, write_slice):
    stored = np.array([[-1500, 0, 40], [7, -1500, 3000]])
    write_slice(tmp_path / "a", stored, (0, 0, 0), signed=True, bits=16, RescaleIntercept=0, PixelPaddingValue=-1500)
    np.testing.assert_array_equal(read_volume(tmp_path).hu[0], [[-1024, 0, 40], [7, -1024, 3000]])


def test_padding_range_becomes_air(tmp_path, write_slice):
    stored = np.array([[0, 1, 40], [7, 2, 3000]])
    write_slice(tmp_path / "a", stored, (0, 0, 0), RescaleIntercept=0, PixelPaddingValue=0, PixelPaddingRangeLimit=2)
    np.testing.assert_array_equal(read_volume(tmp_path).hu[0], [[-1024, -1024, 40], [7, -1024, 3000]])


def transcode(source, target, syntax):
    """Encode with GDCM."""
    reader = gdcm.ImageReader()
    reader.SetFileName(str(source))
    assert reader.Read()
    change = gdcm.ImageChangeTransferSyntax()
    change.SetTransferSyntax(gdcm.TransferSyntax(syntax))
    change.SetInput(reader.GetImage())
    assert change.Change()
    writer = gdcm.ImageWriter()
    writer.SetFileName(str(target))
    writer.SetFile(reader.GetFile())
    writer.SetImage(change.GetOutput())
    assert writer.Write()


def compress(source, target, syntax):
    """Encode with pydicom's plug-ins."""
    dataset = pydicom.dcmread(source)
    dataset.compress(syntax)
    dataset.save_as(target)


ENCODERS = {
    "RLE": lambda a, b: compress(a, b, RLELossless),
    "JPEG-LS": lambda a, b: compress(a, b, JPEGLSLossless),
    "JPEG lossless": lambda a, b: transcode(a, b, gdcm.TransferSyntax.JPEGLosslessProcess14_1),
    "JPEG 2000": lambda a, b: transcode(a, b, gdcm.TransferSyntax.JPEG2000Lossless),
}


@pytest.mark.parametrize("encoding", ENCODERS)
@pytest.mark.parametrize("signed", [False, True])
def test_compressed_slices_decode_to_what_was_written(tmp_path, write_slice, encoding, signed):
    stored = np.random.default_rng(1).integers(-2048 if signed else 0, 2048, (16, 24))
    bits = 16 if signed else 12
    plain = write_slice(tmp_path / "plain.dcm", stored, (0, 0, 0), signed=signed, bits=bits, RescaleIntercept=-3)
    coded = tmp_path / "coded.dcm"
    ENCODERS[encoding](plain, coded)
    assert pydicom.dcmread(coded).file_meta.TransferSyntaxUID.is_compressed
    np.testing.assert_array_equal(read_volume(coded).hu[0], stored - 3)


def test_what_nothing_decodes_is_named(tmp_path, write_slice, monkeypatch):
    """And is not called truncated, as what a decoder fails at may be."""
    path = write_slice(tmp_path / "a.dcm", np.zeros((4, 5)), (0, 0, 0))
    compress(path, path, JPEGLSLossless)
    content = path.read_bytes()
    path.write_bytes(content.replace(JPEGLSLossless.encode(), b"1.2.840.10008.1.2.4.99"))
    with pytest.raises(InputError, match=r"can be decoded in a\.dcm, got 1\.2\.840\.10008\.1\.2\.4\.99: convert"):
        read_volume(path)
    path.write_bytes(content)
    monkeypatch.setattr(type(get_decoder(JPEGLSLossless)), "is_available", False)
    with pytest.raises(InputError, match=r"a decoder of JPEG-LS .*, as a\.dcm is, got none: pip install pyth"):
        read_volume(path)


@pytest.mark.parametrize("encoding", [None, *ENCODERS])
@pytest.mark.parametrize("share", [0.03, 0.4, 0.9])
def test_a_truncated_file_is_named(tmp_path, write_series, encoding, share):
    write_series(tmp_path / "plain", range(5), (40, 40))
    broken = tmp_path / "plain" / "003.dcm"
    if encoding:
        ENCODERS[encoding](broken, tmp_path / "coded")
        shutil.move(tmp_path / "coded", broken)
    whole = broken.read_bytes()
    broken.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(InputError, match=r"003\.dcm"):
        read_volume(tmp_path / "plain")


def test_oblique_and_flipped_orientations_keep_every_pixel_in_place(tmp_path, write_slice):
    rng = np.random.default_rng(2)
    for number in range(4):
        axes, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        orientation = np.concatenate([axes[0], -axes[1] if number % 2 else axes[1]])
        folder = tmp_path / str(number)
        folder.mkdir()
        for k, away in enumerate(rng.permutation(5)):
            position = np.array([1.0, 2.0, 3.0]) + 1.7 * away * axes[2]
            write_slice(folder / f"{k}", np.full((3, 4), 10 * away), position, orientation=orientation)
        volume = read_volume(folder)
        for path in folder.iterdir():
            image = sitk.ReadImage(str(path))
            index = volume.to_indices(image.TransformIndexToPhysicalPoint((3, 2, 0)))
            np.testing.assert_allclose(index, index.round(), atol=1e-6)
            i, j, k = index.round().astype(int)
            assert (i, j) == (3, 2)
            assert volume.hu[k, j, i] == sitk.GetArrayFromImage(image)[0, 2, 3]


def test_gantry_tilt_is_a_shear_of_the_affine(tmp_path, write_slice):
    angle = np.deg2rad(18.5)
    orientation = (1, 0, 0, 0, np.cos(angle), -np.sin(angle))
    for k in range(6):
        write_slice(tmp_path / f"{k}", np.full((3, 4), k), (1, 2, 5 * k), orientation=orientation)
    volume = read_volume(tmp_path)
    np.testing.assert_allclose(volume.affine[:3, 2], [0, 0, 5], atol=1e-9)
    np.testing.assert_allclose(volume.affine[:3, 1], 0.8 * np.array(orientation[3:]), atol=1e-9)
    np.testing.assert_allclose(volume.voxel_mm3, 0.7 * 0.8 * 5 * np.cos(angle), rtol=1e-9)


def test_uneven_slices_are_resampled_between_their_neighbours(tmp_path, write_slice):
    """A ramp in z is reproduced exactly, wherever slices lie."""
    heights = np.array([0, 2, 4, 6, 8, 11, 14, 17, 20.0])
    for k, height in enumerate(heights):
        write_slice(tmp_path / f"{k}", np.full((3, 4), 100 + 10 * height), (0, 0, height), RescaleIntercept=0)
    with pytest.warns(GpubsplineWarning, match="4 x 2, 4 x 3 mm resampled to 11 slices 2 mm apart"):
        volume = read_volume(tmp_path)
    z = volume.to_points([[0, 0, k] for k in range(volume.shape[2])])[:, 2]
    np.testing.assert_allclose(z, np.arange(0, 21, 2))
    np.testing.assert_array_equal(volume.hu[:, 1, 2], 100 + 10 * z)


def test_a_missing_slice_is_an_error_that_says_where(tmp_path, write_series):
    write_series(tmp_path, [0, 2.5, 5, 10, 12.5, 15])
    with pytest.raises(InputError, match=r"1 between \(-3.0, 4.0, 5.0\) mm \[002.dcm\] and \(-3.0, 4.0, 10.0\) mm"):
        read_volume(tmp_path)


def test_a_missing_slice_is_filled_when_allowed(tmp_path, write_series):
    stored = write_series(tmp_path, [0, 2.5, 5, 10, 12.5, 15])
    with pytest.warns(GpubsplineWarning, match="filled 1 gaps by interpolation"):
        volume = read_volume(tmp_path, allow_gaps=True)
    kept = [0, 1, 2, 4, 5, 6]
    np.testing.assert_array_equal(volume.hu[kept], stored - 1024)
    np.testing.assert_array_equal(volume.hu[3], np.rint((stored[2] + stored[3]) / 2 - 1024))


def test_a_slice_that_is_there_twice_is_dropped(tmp_path, write_series):
    stored = write_series(tmp_path, [0, 1, 2])
    shutil.copy(tmp_path / "001.dcm", tmp_path / "copy.dcm")
    with pytest.warns(GpubsplineWarning, match="left out 1 slices that are there twice"):
        np.testing.assert_array_equal(read_volume(tmp_path).hu, stored - 1024)


def test_different_slices_at_one_place_are_an_error(tmp_path, write_series):
    write_series(tmp_path, [0, 1, 2, 1])
    with pytest.raises(InputError, match=r"different ones at 1 mm \(001.dcm, 003.dcm\)"):
        read_volume(tmp_path)


def test_slices_beside_the_line_are_an_error(tmp_path, write_slice):
    for k in range(5):
        write_slice(tmp_path / f"{k}", np.zeros((3, 4)), (3.0 * (k == 2), 0, k))
    with pytest.raises(InputError, match=r"in one line, got 2 3 mm beside it"):
        read_volume(tmp_path)


def test_stored_values_without_an_intercept_are_warned_of(tmp_path, write_series):
    """Scanners store HU + 1024: all bone would be a thousand too dense."""
    stored = write_series(tmp_path, [0, 2, 4], RescaleIntercept=None, RescaleSlope=None)
    with pytest.warns(GpubsplineWarning, match="no rescale intercept in 3 of 3 images"):
        np.testing.assert_array_equal(read_volume(tmp_path).hu, stored)


def test_a_map_of_another_quantity_is_warned_of(tmp_path, write_series):
    """A spectral CT's map of iodine is of the modality CT, too."""
    stored = write_series(tmp_path, [0, 2, 4], RescaleType="MGML")
    with pytest.warns(GpubsplineWarning, match="rescaled to MGML, not to HU"):
        np.testing.assert_array_equal(read_volume(tmp_path).hu, stored - 1024)


def test_decoded_slices_are_held_once(tmp_path, write_series, monkeypatch):
    """With what threads decode ahead of its turn, a few slices."""
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    write_series(tmp_path, range(120), shape=(128, 128))
    read_volume(tmp_path)  # what is imported on the way
    tracemalloc.start()
    volume = read_volume(tmp_path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 1.7 * volume.hu.nbytes


def test_the_largest_ct_series_is_read_unless_another_is_named(tmp_path, write_series):
    small = write_series(tmp_path / "small", range(3), seed=1, SeriesInstanceUID="1.1")
    large = write_series(tmp_path / "large", range(5), seed=2, SeriesInstanceUID="1.2")
    write_series(tmp_path / "mr", range(9), seed=3, SeriesInstanceUID="1.3", Modality="MR")
    np.testing.assert_array_equal(read_volume(tmp_path).hu, large - 1024)
    np.testing.assert_array_equal(read_volume(tmp_path, series="1.1").hu, small - 1024)
    with pytest.raises(InputError, match=r"expected a CT series, got 1\.3, which is MR"):
        read_volume(tmp_path, series="1.3")
    with pytest.raises(InputError, match=r"among 1\.2 \(CT, 5 files\), 1\.3 \(MR, 9 files\), 1\.1 .*, got 1\.9"):
        read_volume(tmp_path, series="1.9")


def test_another_reconstruction_that_may_have_been_meant_is_warned_of(tmp_path, write_series):
    """By its number of images, not its UID; a localiser's series is not worth a word."""
    write_series(tmp_path / "scout", range(2), SeriesInstanceUID="1.1")
    soft = write_series(tmp_path / "soft", range(5), seed=1, SeriesInstanceUID="1.2")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        np.testing.assert_array_equal(read_volume(tmp_path).hu, soft - 1024)
    bone = write_series(tmp_path / "bone", range(5), seed=2, SeriesInstanceUID="1.3")
    with pytest.warns(GpubsplineWarning, match=r"^the CT series of 5 images is taken, beside others of 5: --series"):
        np.testing.assert_array_equal(read_volume(tmp_path).hu, soft - 1024)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        np.testing.assert_array_equal(read_volume(tmp_path, series="1.3").hu, bone - 1024)


def test_series_without_a_ct_say_what_came(tmp_path, write_series):
    write_series(tmp_path / "a", range(3), SeriesInstanceUID="1.1", Modality="MR")
    write_series(tmp_path / "b", range(2), SeriesInstanceUID="1.2", Modality="PT")
    with pytest.raises(InputError, match=r"expected a CT series, got 2 series of MR \(3 images\), PT \(2 images\)"):
        read_volume(tmp_path)


def test_ct_is_known_by_its_class_where_the_modality_is_missing(tmp_path, write_series):
    stored = write_series(tmp_path, range(3), Modality=None)
    np.testing.assert_array_equal(read_volume(tmp_path).hu, stored - 1024)


def test_images_of_differing_size_are_an_error(tmp_path, write_series, write_slice):
    write_series(tmp_path, range(4))
    write_slice(tmp_path / "other.dcm", np.zeros((9, 8)), (-3, 4, 4))
    with pytest.raises(InputError, match="images of one size in the series, got 4 of 7x9, 1 of 8x9"):
        read_volume(tmp_path)


def test_localisers_are_left_out(tmp_path, write_series, write_slice):
    stored = write_series(tmp_path, range(6))
    scout = {"orientation": (0, 1, 0, 0, 0, -1)}
    write_slice(tmp_path / "s.dcm", np.zeros((30, 8)), (0, 0, 9), ImageType=["ORIGINAL", "PRIMARY", "LOCALIZER"])
    with pytest.warns(GpubsplineWarning, match="left out 1 localiser"):
        np.testing.assert_array_equal(read_volume(tmp_path).hu, stored - 1024)
    write_slice(tmp_path / "s.dcm", np.zeros((30, 8)), (0, 0, 9), **scout)
    with pytest.warns(GpubsplineWarning, match="left out 1 images that lie across the other 6"):
        np.testing.assert_array_equal(read_volume(tmp_path).hu, stored - 1024)


def test_an_enhanced_multi_frame_file_is_a_series(tmp_path, write_slice):
    heights = [4.0, 0.0, 2.0]
    stored = np.random.default_rng(5).integers(0, 4000, (3, 4, 5))
    shared, frames = Dataset(), []
    shared.PixelMeasuresSequence = Sequence([Dataset()])
    shared.PixelMeasuresSequence[0].PixelSpacing = [0.5, 0.6]
    shared.PlaneOrientationSequence = Sequence([Dataset()])
    shared.PlaneOrientationSequence[0].ImageOrientationPatient = [1, 0, 0, 0, 1, 0]
    for number, height in enumerate(heights):
        frame = Dataset()
        frame.PlanePositionSequence = Sequence([Dataset()])
        frame.PlanePositionSequence[0].ImagePositionPatient = [1, 2, height]
        frame.PixelValueTransformationSequence = Sequence([Dataset()])
        frame.PixelValueTransformationSequence[0].RescaleSlope = 1
        frame.PixelValueTransformationSequence[0].RescaleIntercept = -1000 - number
        frames.append(frame)
    gone = {"ImagePositionPatient": None, "ImageOrientationPatient": None, "PixelSpacing": None}
    kind = {"SOPClassUID": EnhancedCTImageStorage, "NumberOfFrames": 3}
    groups = {"SharedFunctionalGroupsSequence": [shared], "PerFrameFunctionalGroupsSequence": frames}
    path = write_slice(tmp_path / "e.dcm", stored, (0, 0, 0), **gone, **kind, **groups)
    volume = read_volume(path)
    expected = [stored[n] - 1000 - n for n in (1, 2, 0)]
    np.testing.assert_array_equal(volume.hu, expected)
    np.testing.assert_allclose(volume.affine, [[0.6, 0, 0, 1], [0, 0.5, 0, 2], [0, 0, 2, 0], [0, 0, 0, 1]])


def test_a_multi_frame_file_without_places_is_an_error(tmp_path, write_slice):
    path = write_slice(tmp_path / "m.dcm", np.zeros((3, 4, 5)), (0, 0, 0), NumberOfFrames=3)
    with pytest.raises(InputError, match=r"the place of each of 3 frames in m\.dcm, got 0"):
        read_volume(path)


@pytest.mark.parametrize(
    ("attributes", "message"),
    [
        ({"ImagePositionPatient": None}, "3 numbers of ImagePositionPatient in a.dcm, got None"),
        ({"PixelSpacing": None}, "2 numbers of PixelSpacing"),
        ({"PixelSpacing": [0, 1]}, "positive pixel spacing"),
        ({"orientation": (1, 0, 0, 1, 0, 0)}, "orthogonal unit vectors of ImageOrientationPatient in a.dcm"),
        ({"SamplesPerPixel": 3}, "got the colour image a.dcm"),
        ({"RescaleSlope": 0}, "rescale slope in a.dcm, got zero"),
    ],
)
def test_images_without_place_or_scale_are_errors(tmp_path, write_slice, attributes, message):
    path = write_slice(tmp_path / "a.dcm", np.zeros((4, 5)), (0, 0, 0), **attributes)
    with pytest.raises(InputError, match=message):
        read_volume(path)


def test_values_that_break_the_standards_rules_are_read_without_a_word(tmp_path, write_series):
    """A UID of letters and an unknown character set: pydicom warns, and here a warning is an error."""
    stored = write_series(tmp_path, range(3), SpecificCharacterSet="ISO_IR 100")
    for path in slices(tmp_path):
        content = path.read_bytes().replace(SERIES.encode(), SERIES[:-1].encode() + b"x")
        path.write_bytes(content.replace(b"ISO_IR 100", b"ISO_XY 100"))
        with pytest.warns(UserWarning, match="Invalid value for VR UI|Unknown encoding"):
            str(pydicom.dcmread(path))
    np.testing.assert_array_equal(read_volume(tmp_path).hu, stored - 1024)


def test_files_without_a_preamble_are_known_by_their_first_group(tmp_path, write_slice):
    stored = np.arange(20).reshape(4, 5)
    path = write_slice(tmp_path / "a.dcm", stored, (0, 0, 0))
    path.write_bytes(path.read_bytes()[132:])
    np.testing.assert_array_equal(read_volume(path).hu[0], stored - 1024)
    dataset = pydicom.dcmread(path, force=True)
    dataset.file_meta.TransferSyntaxUID = ImplicitVRLittleEndian
    dataset.save_as(tmp_path / "b.dcm")
    bare = (tmp_path / "b.dcm").read_bytes()
    (tmp_path / "b.dcm").write_bytes(bare[bare.index(b"\x08\0\x16\0") :])  # no meta group: implicit little endian
    np.testing.assert_array_equal(read_volume(tmp_path / "b.dcm").hu[0], stored - 1024)


def test_progress_counts_slices_and_nothing_tells_who_the_patient_is(tmp_path, write_series):
    write_series(tmp_path, range(4))
    calls = []
    volume = read_volume(tmp_path, progress=lambda done, total: calls.append((done, total)))
    assert calls == [(1, 4), (2, 4), (3, 4), (4, 4)]
    assert volume.source == "DICOM CT, 4 slices"
    assert "Secret" not in repr(volume)


def test_one_slice_takes_its_thickness_from_the_header(tmp_path, write_slice):
    volume = read_volume(write_slice(tmp_path / "a.dcm", np.zeros((4, 5)), (1, 2, 3)))
    assert volume.shape == (5, 4, 1)
    np.testing.assert_allclose(volume.affine[:, 2], [0, 0, 2.5, 0])
