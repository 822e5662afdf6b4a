"""Series whose images differ by more than their place: nothing of them is read together without a word."""

import warnings

import numpy as np
import pytest
from pydicom.dataelem import RawDataElement
from pydicom.dataset import Dataset
from pydicom.errors import BytesLengthException
from pydicom.sequence import Sequence
from pydicom.tag import Tag
from pydicom.uid import EnhancedCTImageStorage

from gpubspline.ct.image import read_volume
from gpubspline.ct.traits import traits_of
from gpubspline.errors import GpubsplineWarning, InputError

SOFT, SHARP = {"ConvolutionKernel": "B30f"}, {"ConvolutionKernel": ["Br60d", "3"]}


@pytest.fixture
def two(tmp_path, write_series):
    """Write images of two kinds at their heights; gives what was stored of each."""

    def write(kinds, heights):
        pairs = zip(kinds, heights, strict=True)
        return [write_series(tmp_path / str(n), at, seed=n, **kind) for n, (kind, at) in enumerate(pairs)]

    return write


def same(folder, stored, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        np.testing.assert_array_equal(read_volume(folder, **options).hu, stored - 1024)


@pytest.mark.parametrize("heights", [(range(0, 20, 2), range(1, 21, 2)), (range(0, 20, 2), range(0, 20, 2))])
def test_two_kernels_under_one_uid_are_asked_about(two, tmp_path, heights):
    """Interleaved, every other slice was of another kernel; at one place, nothing said how to read either."""
    soft, sharp = two((SOFT, SHARP), heights)
    words = r"got 2 of one place, kernel B30f \(10 images\) and Br60d/3 \(10 images\): --series kernel=B30f reads one"
    with pytest.raises(InputError, match=words):
        read_volume(tmp_path)
    same(tmp_path, soft, series="kernel=b30F")
    for name in ("kernel=Br60d", r"kernel=Br60d\3", "1.2.826.0.1.3680043.8.498.1,kernel=Br60d/3"):
        same(tmp_path, sharp, series=name)
    with pytest.raises(
        InputError, match=r"expected images of kernel=B80 in the series, got kernel B30f \(10\), .* \(10"
    ):
        read_volume(tmp_path, series="kernel=B80")
    with pytest.raises(InputError, match=r"by one of kernel, kV, .*=VALUE, got 'colour=red'"):
        read_volume(tmp_path, series="colour=red")
    with pytest.raises(InputError, match=r"among 1\.2\.826\S* \(CT, 20 files, kernel B30f, Br60d/3\), got list"):
        read_volume(tmp_path, series="list")


def test_two_energies_are_asked_about(two, tmp_path):
    two(({"KVP": 140}, {"KVP": 80}), (range(0, 20, 2), range(1, 21, 2)))
    with pytest.raises(InputError, match=r"kV 140 \(10 images\) and 80 .*--series kV=140"):
        read_volume(tmp_path)


def test_reconstructions_that_follow_each_other_are_one_volume(two, tmp_path):
    """A neck below a head; they may share a little of their length."""
    soft, sharp = two((SOFT, SHARP), (range(0, 20, 2), range(20, 40, 2)))
    with pytest.warns(GpubsplineWarning, match="that follow each other, kernel B30f .* and Br60d/3 .*one volume"):
        np.testing.assert_array_equal(read_volume(tmp_path).hu, np.concatenate([soft, sharp]) - 1024)


def test_a_kernel_chooses_between_series(tmp_path, write_series):
    soft = write_series(tmp_path / "a", range(4), seed=1, SeriesInstanceUID="1.2", **SOFT)
    write_series(tmp_path / "b", range(9), seed=2, SeriesInstanceUID="1.3", **SHARP)
    same(tmp_path, soft, series="kernel=B30f")


@pytest.mark.parametrize(
    ("kinds", "words", "name"),
    [
        (({"AcquisitionNumber": 1}, {"AcquisitionNumber": 2}), "acquisition 1 and 2", "acquisition=2"),
        (({"TemporalPositionIdentifier": 1}, {"TemporalPositionIdentifier": 2}), "time 1 and 2", "time=2"),
        (
            ({"ImageType": ["ORIGINAL", "PRIMARY"]}, {"ImageType": ["DERIVED", "PRIMARY"]}),
            "type ORIGINAL/",
            "type=DERIVED",
        ),
    ],
)
def test_two_images_of_a_place_are_told_apart(two, tmp_path, kinds, words, name):
    _, second = two(kinds, (range(5), range(5)))
    with pytest.raises(InputError, match=rf"different ones at 0 mm .*: {words}.* reads one"):
        read_volume(tmp_path)
    same(tmp_path, second, series=name)


def test_other_traits_differ_from_slice_to_slice(tmp_path, write_slice, write_series):
    """As of the steps of a scanner that turns and stops, and of those slices that it sums of two."""
    stored = np.concatenate(
        [
            write_series(
                tmp_path / str(z),
                [z],
                seed=z,
                AcquisitionNumber=z,
                ImageType=["ORIGINAL", "PRIMARY", "ADD"[: z % 2 * 3]],
            )
            for z in range(6)
        ]
    )
    same(tmp_path, stored)


def test_traits_that_break_the_standards_rules_are_none():
    """Numbers of three bytes, which no number has: nothing needs them, so no scan is refused for them."""
    image = Dataset()
    for tag, kind, value in ((0x209156, "US", b"abc"), (0x209241, "FL", b"abc"), (0x181210, "SH", b"Br\\3 ")):
        image[tag] = RawDataElement(Tag(tag), kind, len(value), value, 0, False, True)
    with pytest.raises(BytesLengthException):
        image.get("FrameAcquisitionNumber")
    assert traits_of(image.get) == {"kernel": "Br/3"}


MULTI = [
    (
        {"ImageType": ["DERIVED", "PRIMARY", "AXIAL", "EFF_ATOMIC_NUM"]},
        "EFF_ATOMIC_NUM .* effective atomic numbers, not HU",
    ),
    ({"ImageType": ["DERIVED", "PRIMARY", "AXIAL", "MAT_REMOVED"]}, "MAT_REMOVED says that HU were changed"),
    ({"ImageType": ["DERIVED", "PRIMARY", "AXIAL", "VMI"]}, "virtual monoenergetic images: bone has other HU"),
]


@pytest.mark.parametrize(("kind", "words"), MULTI)
def test_images_of_a_spectral_scanner_are_warned_of(tmp_path, write_series, kind, words):
    write_series(tmp_path, range(3), **kind)
    with pytest.warns(GpubsplineWarning, match=words):
        read_volume(tmp_path)


def item(**attributes):
    made = Dataset()
    for keyword, value in attributes.items():
        setattr(made, keyword, value)
    return Sequence([made])


def test_the_energy_and_units_are_found_in_their_sequences(tmp_path, write_series):
    code = item(CodeValue="mg/cm3", CodingSchemeDesignator="UCUM", CodeMeaning="mg/cm3")
    write_series(
        tmp_path,
        range(3),
        MultienergyCTCharacteristicsSequence=item(MonoenergeticEnergyEquivalent=65.0),
        RealWorldValueMappingSequence=item(MeasurementUnitsCodeSequence=code),
    )
    with pytest.warns(GpubsplineWarning) as caught:
        read_volume(tmp_path)
    words = " ".join(str(each.message) for each in caught)
    assert "at 65 keV" in words and "rescaled to mg/cm3, not to HU" in words
    write_series(
        tmp_path / "hu",
        range(3),
        RealWorldValueMappingSequence=item(
            MeasurementUnitsCodeSequence=item(CodeValue="[hnsf'U]", CodingSchemeDesignator="UCUM", CodeMeaning="HU")
        ),
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        read_volume(tmp_path / "hu")


def enhanced(write_slice, path, kernels, stacks, positions, along=(1, 0, 0, 0, 1, 0)):
    frames, stored = [], np.random.default_rng(7).integers(0, 3000, (len(kernels), 4, 5))
    for kernel, stack, position in zip(kernels, stacks, positions, strict=True):
        frame = Dataset()
        frame.PlanePositionSequence = item(ImagePositionPatient=[float(x) for x in position])
        frame.PlaneOrientationSequence = item(
            ImageOrientationPatient=list(along if stack == "1" else (0, 1, 0, 0, 0, -1))
        )
        frame.PixelMeasuresSequence = item(PixelSpacing=[0.5, 0.5])
        frame.PixelValueTransformationSequence = item(RescaleSlope=1, RescaleIntercept=-1024, RescaleType="HU")
        frame.CTReconstructionSequence = item(ConvolutionKernel=kernel)
        frame.FrameContentSequence = item(StackID=stack)
        frames.append(frame)
    gone = {"ImagePositionPatient": None, "ImageOrientationPatient": None, "PixelSpacing": None}
    kind = {"SOPClassUID": EnhancedCTImageStorage, "NumberOfFrames": len(kernels)}
    write_slice(path, stored, (0, 0, 0), **gone, **kind, PerFrameFunctionalGroupsSequence=frames)
    return stored


def test_frames_of_two_kernels_are_asked_about(tmp_path, write_slice):
    places = [(0, 0, z) for z in range(8)]
    stored = enhanced(write_slice, tmp_path / "e.dcm", ["A", "B"] * 4, "11111111", places)
    with pytest.raises(InputError, match=r"kernel A \(4 images\) and B \(4 images\): --series kernel=A"):
        read_volume(tmp_path)
    same(tmp_path / "e.dcm", stored[1::2], series="kernel=B")


def test_one_of_two_stacks_is_read(tmp_path, write_slice):
    """Of one place but other planes, and one above the other with a gap between."""
    places = [(0, 0, z) for z in range(4)] + [(x, 0, 0) for x in range(4)]
    stored = enhanced(write_slice, tmp_path / "e.dcm", "A" * 8, "11112222", places)
    with pytest.raises(InputError, match="expected slices of one orientation, got 2 orientations of 4, 4 images"):
        read_volume(tmp_path / "e.dcm")
    same(tmp_path / "e.dcm", stored[:4], series="stack=1")
    assert read_volume(tmp_path / "e.dcm", series="stack=2").shape == (5, 4, 4)


def test_a_tilted_gantry_in_frames_is_a_shear(tmp_path, write_slice):
    places = [(0, 0.5 * z, 2 * z) for z in range(4)]
    stored = enhanced(write_slice, tmp_path / "e.dcm", "A" * 4, "1111", places)
    volume = read_volume(tmp_path / "e.dcm")
    np.testing.assert_array_equal(volume.hu, stored - 1024)
    np.testing.assert_allclose(volume.affine[:3, 2], [0, 0.5, 2])
