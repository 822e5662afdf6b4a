"""DICOM SEG and RTSTRUCT by highdicom and pydicom, Slicer's NRRD, named NIfTI: back as the mask they were made of."""

import struct
from pathlib import Path
from typing import Any

import highdicom as hd
import numpy as np
import pydicom
import pytest
import SimpleITK as sitk
from numpy.typing import NDArray
from pydicom.dataset import Dataset, FileMetaDataset
from pydicom.sr.codedict import codes
from pydicom.uid import ExplicitVRLittleEndian, RTStructureSetStorage, generate_uid
from scipy import ndimage

from gpubspline.ct.contours import Plane, fill
from gpubspline.ct.image import read_volume
from gpubspline.ct.labels import lay_on
from gpubspline.ct.masks import open_labels, read_mask, read_segment
from gpubspline.ct.phantom_dicom import write_phantom
from gpubspline.ct.region import region_from_mask
from gpubspline.ct.volume import Volume
from gpubspline.errors import GpubsplineWarning, InputError

Mask = NDArray[np.bool_]


@pytest.fixture(scope="module")
def series(tmp_path_factory: pytest.TempPathFactory) -> tuple[list[Dataset], Volume]:
    """The child femur phantom as DICOM: its data sets, and the volume."""
    folder = tmp_path_factory.mktemp("seg") / "ct"
    files = write_phantom("child-femur", folder)
    images = [pydicom.dcmread(path) for path in files]
    for image in images:
        image.PatientName = "Phantom^"  # highdicom warns of names of one part
    return images, read_volume(folder)


@pytest.fixture(scope="module")
def j2k(data: Path) -> tuple[list[Dataset], Volume]:
    """Real CT, its missing SOP class filled in, which a SEG must refer to."""
    folder = data / "dicom_j2k"
    images = [pydicom.dcmread(path, force=True) for path in sorted(folder.rglob("*")) if path.is_file()]
    images = [image for image in images if "PixelData" in image]
    for image in images:
        image.SOPClassUID = pydicom.uid.CTImageStorage
        image.file_meta.MediaStorageSOPClassUID = image.SOPClassUID
        for keyword in ("PatientID", "PatientName", "StudyID", "AccessionNumber", "PatientBirthDate", "PatientSex"):
            setattr(image, keyword, image.get(keyword, ""))
        for keyword in ("StudyDate", "StudyTime", "ReferringPhysicianName", "FrameOfReferenceUID", "StudyInstanceUID"):
            if keyword not in image:
                setattr(image, keyword, images[0].get(keyword, generate_uid() if keyword.endswith("UID") else ""))
    return images, read_volume(folder)


def two_labels(volume: Volume) -> dict[str, Mask]:
    """Dense and less dense parts: with holes and in several pieces."""
    smooth = ndimage.gaussian_filter(volume.hu.astype(np.float32), 1)
    return {"Cortex": smooth > 700, "Marrow": (smooth > 150) & (smooth <= 700)}


def write_seg(path: Path, images: list[Dataset], masks: dict[str, NDArray[Any]], kind: str = "BINARY") -> Path:
    """Write a SEG of the masks (k, j, i), whose k runs as the sorted images do."""
    normal = np.cross(*np.array(images[0].ImageOrientationPatient, dtype=float).reshape(2, 3))
    images = sorted(images, key=lambda image: float(np.array(image.ImagePositionPatient, dtype=float) @ normal))
    described = [
        hd.seg.SegmentDescription(
            segment_number=number,
            segment_label=name,
            segmented_property_category=codes.SCT.Tissue,
            segmented_property_type=codes.SCT.Bone,
            algorithm_type=hd.seg.SegmentAlgorithmTypeValues.MANUAL,
        )
        for number, name in enumerate(masks, start=1)
    ]
    made = hd.seg.Segmentation(
        source_images=images,
        pixel_array=np.stack(list(masks.values()), axis=-1).astype(np.float32 if kind == "FRACTIONAL" else np.uint8),
        segmentation_type=kind,
        segment_descriptions=described,
        series_instance_uid=generate_uid(),
        series_number=9,
        sop_instance_uid=generate_uid(),
        instance_number=1,
        manufacturer="tests",
        manufacturer_model_name="tests",
        software_versions="1",
        device_serial_number="1",
    )
    made.save_as(path)
    return path


def outlines(mask: NDArray[np.bool_]) -> list[NDArray[np.float64]]:
    """Closed polygons (i, j) along the edges of the pixels of a slice, each pixel edge once, holes on their own."""
    padded = np.pad(mask, 1)
    follow: dict[tuple[int, int], list[tuple[int, int]]] = {}
    steps = {(0, -1): ((0, 0), (1, 0)), (1, 0): ((1, 0), (1, 1)), (0, 1): ((1, 1), (0, 1)), (-1, 0): ((0, 1), (0, 0))}
    for j, i in np.argwhere(padded):
        for (di, dj), (start, end) in steps.items():
            if not padded[j + dj, i + di]:
                follow.setdefault((i + start[0], j + start[1]), []).append((i + end[0], j + end[1]))
    found = []
    while follow:
        first = at = next(iter(follow))
        points = []
        while True:
            points.append(at)
            ends = follow[at]
            at = ends.pop()
            if not ends:
                del follow[points[-1]]
            if at == first:
                break
        found.append(np.array(points, dtype=float) - 1.5)  # the padding, and corners half a pixel off centres
    return found


def write_rtstruct(path: Path, volume: Volume, masks: dict[str, NDArray[np.bool_]], frame: str, step: int = 1) -> Path:
    """Write an RTSTRUCT of the masks, every ``step``-th slice of them."""
    dataset = Dataset()
    dataset.file_meta = FileMetaDataset()
    dataset.file_meta.TransferSyntaxUID = ExplicitVRLittleEndian
    dataset.file_meta.MediaStorageSOPClassUID = dataset.SOPClassUID = RTStructureSetStorage
    dataset.file_meta.MediaStorageSOPInstanceUID = dataset.SOPInstanceUID = generate_uid()
    dataset.Modality, dataset.StructureSetLabel = "RTSTRUCT", "tests"
    dataset.StructureSetROISequence, dataset.ROIContourSequence = [], []
    for number, (name, mask) in enumerate(masks.items(), start=1):
        roi, drawn = Dataset(), Dataset()
        roi.ROINumber, roi.ROIName, roi.ReferencedFrameOfReferenceUID = number, name, frame
        drawn.ReferencedROINumber, drawn.ContourSequence = number, []
        for k in range(0, len(mask), step):
            for outline in outlines(mask[k]):
                item = Dataset()
                points = volume.to_points(np.column_stack([outline, np.full(len(outline), k)]))
                item.ContourGeometricType, item.NumberOfContourPoints = "CLOSED_PLANAR", len(points)
                item.ContourData = [f"{value:.6g}" for value in points.ravel()]
                drawn.ContourSequence.append(item)
        dataset.StructureSetROISequence.append(roi)
        dataset.ROIContourSequence.append(drawn)
    dataset.save_as(path, enforce_file_format=True)
    return path


def _middle(volume: Volume) -> NDArray[np.bool_]:
    """A quarter of each slice, which keeps the test short."""
    part = np.zeros(volume.hu.shape, dtype=bool)
    part[:, 190:320, 190:320] = True
    return part


@pytest.mark.parametrize("kind", ["BINARY", "LABELMAP"])
def test_seg_of_a_phantom(series: tuple[list[Dataset], Volume], tmp_path: Path, kind: str) -> None:
    images, volume = series
    masks = two_labels(volume)
    pixels = masks if kind == "BINARY" else {name: mask.astype(np.uint8) for name, mask in masks.items()}
    path = write_seg(tmp_path / "seg.dcm", images, pixels, kind)
    assert open_labels(path, volume).names == {1: "Cortex", 2: "Marrow"}
    for number, (name, mask) in enumerate(masks.items(), start=1):
        np.testing.assert_array_equal(read_mask(path, volume, name), mask)
        np.testing.assert_array_equal(read_mask(path, volume, str(number)), mask)
    np.testing.assert_array_equal(read_mask(path, volume), masks["Cortex"] | masks["Marrow"])


def test_seg_and_rtstruct_of_a_real_scan(j2k: tuple[list[Dataset], Volume], tmp_path: Path) -> None:
    """JPEG 2000 CT: bone by threshold, in hundreds of pieces with holes."""
    images, volume = j2k
    masks = {name: mask & _middle(volume) for name, mask in two_labels(volume).items()}
    path = write_seg(tmp_path / "seg.dcm", images, masks)
    for name, mask in masks.items():
        np.testing.assert_array_equal(read_mask(path, volume, name), mask)
    path = write_rtstruct(tmp_path / "rs.dcm", volume, masks, volume.frame_of_reference or "")
    for name, mask in masks.items():
        np.testing.assert_array_equal(read_mask(path, volume, name), mask)


def test_seg_that_leaves_out_slices_and_pixels(series: tuple[list[Dataset], Volume], tmp_path: Path) -> None:
    images, volume = series
    mask = np.zeros(volume.hu.shape, dtype=bool)
    mask[5:9, 10:20, 8:15] = mask[14, 3:9, 4:8] = True
    path = write_seg(tmp_path / "seg.dcm", images, {"Part": mask})
    np.testing.assert_array_equal(read_mask(path, volume, "part"), mask)
    cut = volume.crop((6, 12, 3), (20, 30, 12))
    np.testing.assert_array_equal(read_mask(path, cut, 1), mask[3:12, 12:30, 6:20])


def test_fractional_seg_covers_voxels(series: tuple[list[Dataset], Volume], tmp_path: Path) -> None:
    images, volume = series
    part = np.clip((volume.hu.astype(np.float32) - 100) / 400, 0, 1)
    path = write_seg(tmp_path / "seg.dcm", images, {"Bone": part}, "FRACTIONAL")
    found = read_segment(path, volume, "Bone")
    assert found.coverage is not None
    np.testing.assert_allclose(found.coverage, part, atol=0.5 / 255 + 1e-6)
    np.testing.assert_array_equal(found.inside, found.coverage >= 0.5)


def test_rtstruct_of_the_vertebra(data: Path, tmp_path: Path) -> None:
    """A grid that is not axial; holes; named regions."""
    volume = read_volume(data / "vertebra" / "sub-ct_label-22_ct.nii.gz")
    labels = open_labels(data / "vertebra" / "sub-ct_seg-subreg_label-22_msk.nii.gz", volume)
    masks = {f"part {number}": labels.segment(number).inside for number in list(labels.names)[:4]}
    path = write_rtstruct(tmp_path / "rs.dcm", volume, masks, "")
    for name, mask in masks.items():
        np.testing.assert_array_equal(read_mask(path, volume, name.upper()), mask)
    np.testing.assert_array_equal(read_mask(path, volume), np.logical_or.reduce(list(masks.values())))


def test_contours_on_every_second_slice_fill_the_others(tmp_path: Path) -> None:
    volume = Volume(np.zeros((9, 20, 20), np.int16), np.diag([0.5, 0.5, 2.0, 1.0]))
    mask = np.zeros(volume.hu.shape, dtype=bool)
    mask[:, 5:12, 4:15] = True
    path = write_rtstruct(tmp_path / "rs.dcm", volume, {"block": mask}, "", step=2)
    np.testing.assert_array_equal(read_mask(path, volume, "block"), mask)


def circle(radius: float, centre: tuple[float, float], n: int = 400) -> NDArray[np.float64]:
    angle = np.linspace(0, 2 * np.pi, n, endpoint=False)
    return np.stack([centre[0] + radius * np.cos(angle), centre[1] + radius * np.sin(angle)], axis=1)


def test_coverage_is_finer_than_voxels() -> None:
    """The area of a ring: pi (9.3^2 - 4.1^2) pixels, within 1e-3; by whole pixels it is 20 times worse."""
    plane = Plane(0.0, [circle(9.3, (12.2, 13.4)), circle(4.1, (12.9, 13.1))])
    inside, covered = fill([plane], (1, 27, 26))
    exact = np.pi * (9.3**2 - 4.1**2)
    assert covered.sum() == pytest.approx(exact, rel=1e-3)
    j, i = np.nonzero(inside[0])
    assert np.all(np.hypot(i - 12.2, j - 13.4) < 9.301) and np.all(np.hypot(i - 12.9, j - 13.1) > 4.09)
    assert covered.max() <= 1 and np.all(covered[inside] > 0.2) and np.all(covered[~inside] < 0.8)


def test_a_cylinder_of_contours_has_its_volume(tmp_path: Path) -> None:
    """Contours of a circle of 6.3 mm on voxels of 1 mm: the volume within 0.6 %."""
    volume = Volume(np.zeros((12, 20, 20), np.int16), np.eye(4))
    planes = [Plane(float(k), [circle(6.3, (9.6, 9.3))]) for k in range(12)]
    inside, covered = fill(planes, volume.hu.shape)
    region = region_from_mask(volume, inside, coverage=covered)
    assert region.volume_mm3 == pytest.approx(np.pi * 6.3**2 * 11, rel=6e-3)


def test_contours_through_the_centres_hold_them() -> None:
    """Some programs draw through the centres of the outermost pixels."""
    plane = Plane(0.0, [np.array([[3.0, 2.0], [8.0, 2.0], [8.0, 6.0], [3.0, 6.0]])])
    inside, _ = fill([plane], (1, 10, 12))
    expected = np.zeros((10, 12), dtype=bool)
    expected[2:7, 3:9] = True
    np.testing.assert_array_equal(inside[0], expected)


def test_other_frame_of_reference_is_refused(series: tuple[list[Dataset], Volume], tmp_path: Path) -> None:
    images, volume = series
    mask = two_labels(volume)["Cortex"]
    assert volume.frame_of_reference
    path = write_rtstruct(tmp_path / "rs.dcm", volume, {"Cortex": mask}, "1.2.3.4")
    with pytest.raises(
        InputError, match=r"frame of reference .*, got rs\.dcm in 1\.2\.3\.4: it belongs to another scan"
    ):
        read_mask(path, volume)
    others = [pydicom.dcmread(Path(image.filename)) for image in images]
    for image in others:
        image.FrameOfReferenceUID, image.PatientName = "1.2.3.5", "Phantom^"
    path = write_seg(tmp_path / "seg.dcm", others, {"Cortex": mask})
    with pytest.raises(InputError, match=r"got seg\.dcm in 1\.2\.3\.5") as error:
        read_mask(path, volume)
    assert "\n" not in str(error.value)


def test_a_frame_that_cannot_be_checked_is_warned_of(tmp_path: Path) -> None:
    volume = Volume(np.zeros((4, 9, 9), np.int16), np.eye(4))
    mask = np.zeros(volume.hu.shape, dtype=bool)
    mask[1:3, 2:6, 2:6] = True
    path = write_rtstruct(tmp_path / "rs.dcm", volume, {"block": mask}, "1.2.3")
    with pytest.warns(GpubsplineWarning, match=r"rs\.dcm has a frame of reference and the CT states none"):
        np.testing.assert_array_equal(read_mask(path, volume, "block"), mask)


def test_what_is_no_segment_is_said(series: tuple[list[Dataset], Volume], tmp_path: Path) -> None:
    images, volume = series
    masks = two_labels(volume)
    path = write_seg(tmp_path / "seg.dcm", images, masks)
    with pytest.raises(InputError, match=r"labels 1 \(Cortex\), 2 \(Marrow\) of seg\.dcm, got femur"):
        read_mask(path, volume, "femur")
    moved = Volume(volume.hu, volume.affine + _shift(0.3), "moved", volume.frame_of_reference)
    with pytest.raises(InputError, match=r"on the voxels of the CT .* beside them"):
        read_mask(path, moved, "Cortex")
    with pytest.raises(InputError, match=r"a DICOM SEG or RTSTRUCT as mask, got .* of the modality CT"):
        read_mask(Path(images[0].filename), volume)
    broken = tmp_path / "broken.dcm"
    broken.write_bytes(path.read_bytes()[:900])
    with pytest.raises(InputError, match=r"broken\.dcm"):
        read_mask(broken, volume)
    with pytest.raises(InputError, match="got the folder"):
        read_mask(tmp_path, volume)


def _shift(mm: float) -> NDArray[np.float64]:
    shift = np.zeros((4, 4))
    shift[0, 3] = mm
    return shift


def test_contours_across_the_slices_are_refused(tmp_path: Path) -> None:
    upright = Volume(np.zeros((9, 9, 9), np.int16), np.eye(4))
    mask = np.zeros((9, 9, 9), dtype=bool)
    mask[2:6, 2:6, 2:6] = True
    path = write_rtstruct(tmp_path / "rs.dcm", upright, {"block": mask}, "")
    lying = Volume(np.zeros((9, 9, 9), np.int16), np.eye(4)[[2, 0, 1, 3]])
    with pytest.raises(InputError, match="contours along the slices of the CT"):
        read_mask(path, lying, "block")


def test_slicer_nrrd_with_names_layers_and_a_part_of_the_grid(tmp_path: Path) -> None:
    affine = np.diag([0.7, 0.8, 2.0, 1.0])
    affine[:3, 3] = (5, -3, 1)
    volume = Volume(np.zeros((6, 12, 10), np.int16), affine)
    layers = np.zeros((3, 5, 4, 2), np.uint8)
    layers[1, 1:4, 1:3, 0] = 1
    layers[2, :, :, 0] = 2
    layers[:, 2, 2, 1] = 1
    image = sitk.GetImageFromArray(layers, isVector=True)
    image.SetSpacing((0.7, 0.8, 2.0))
    image.SetOrigin(tuple(volume.to_points((3, 4, 2))))
    rows = [("Segment0", "Femur", "1", "0"), ("Segment1", "Implant", "2", "0"), ("Segment2", "Screw", "1", "1")]
    for key, name, value, layer in rows:
        for end, text in (("Name", name), ("LabelValue", value), ("Layer", layer)):
            image.SetMetaData(f"{key}_{end}", text)
    path = tmp_path / "s.seg.nrrd"
    sitk.WriteImage(image, str(path))
    labels = open_labels(path, volume)
    assert sorted(labels.names.values()) == ["Femur", "Implant", "Screw"]
    expected = np.zeros((6, 12, 10), dtype=bool)
    expected[3, 5:8, 4:6] = True
    np.testing.assert_array_equal(read_mask(path, volume, "femur"), expected)
    screw = np.zeros((6, 12, 10), dtype=bool)
    screw[2:5, 6, 5] = True
    np.testing.assert_array_equal(read_mask(path, volume, "Screw"), screw)


def test_nifti_with_a_label_table(tmp_path: Path) -> None:
    """The header extension of TotalSegmentator, put in by hand."""
    volume = Volume(np.zeros((4, 5, 6), np.int16), np.eye(4))
    values = np.zeros((4, 5, 6), np.uint8)
    values[1:3, 1:4, 2:5], values[0, 0, 0] = 25, 26
    plain = tmp_path / "plain.nii"
    sitk.WriteImage(sitk.GetImageFromArray(values), str(plain))
    table = (
        b'<?xml version="1.0"?><CaretExtension><VolumeInformation Index="0"><LabelTable>'
        b'<Label Key="25" Red="0" Green="0" Blue="0" Alpha="1"><![CDATA[sacrum]]></Label>'
        b'<Label Key="26" Red="1" Green="0" Blue="0" Alpha="1"><![CDATA[vertebrae_S1]]></Label>'
        b"</LabelTable></VolumeInformation></CaretExtension>"
    )
    table += b" " * (-(len(table) + 8) % 16)
    content = bytearray(plain.read_bytes())
    content[108:112] = struct.pack("<f", 352 + 8 + len(table))
    extended = content[:348] + b"\1\0\0\0" + struct.pack("<ii", 8 + len(table), 0) + table + content[352:]
    path = tmp_path / "named.nii"
    path.write_bytes(bytes(extended))
    assert open_labels(path, volume).names == {25: "sacrum", 26: "vertebrae_S1"}
    np.testing.assert_array_equal(read_mask(path, volume, "Sacrum"), values == 25)
    np.testing.assert_array_equal(read_mask(plain, volume, 26), values == 26)


@pytest.mark.parametrize("turn", [(0, 1, 2), (1, 0, 2), (2, 0, 1)])
@pytest.mark.parametrize("flips", [(1, 1, 1), (1, -1, 1), (-1, 1, -1)])
def test_axes_exchanged_and_turned_round(turn: tuple[int, ...], flips: tuple[int, ...]) -> None:
    """The same samples with their axes in another order and direction, and a part of them."""
    rng = np.random.default_rng(1)
    affine = np.eye(4)
    affine[:3, :3] = np.diag([0.5, 0.7, 1.1]) @ np.array([[1, 0, 0], [0, 0.8, -0.6], [0, 0.6, 0.8]])
    volume = Volume(rng.integers(0, 99, (6, 7, 8)).astype(np.int16), affine)
    other = np.zeros((4, 4))
    other[3, 3] = 1
    values = volume.hu.T  # (i, j, k)
    origin = np.array([0, 0, 0])
    for axis, source in enumerate(turn):
        other[:3, axis] = affine[:3, source] * flips[axis]
        if flips[axis] < 0:
            values = np.flip(values, source)
            origin[source] = volume.shape[source] - 1
    other[:3, 3] = affine[:3, :3] @ origin
    turned = np.transpose(values, turn)[1:]
    other[:3, 3] += other[:3, 0]
    laid = lay_on(turned.T, other, volume, "turned")
    cut = [slice(None)] * 3
    cut[turn[0]] = slice(1, None) if flips[0] > 0 else slice(None, -1)
    expected = np.zeros_like(volume.hu)
    expected.T[tuple(cut)] = volume.hu.T[tuple(cut)]
    np.testing.assert_array_equal(laid, expected)
