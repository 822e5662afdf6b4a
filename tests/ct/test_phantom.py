"""Phantoms: exact bodies, their scans, and the DICOM series they are written as."""

from pathlib import Path

import numpy as np
import pydicom
import pytest
import SimpleITK as sitk
from pydicom.uid import CTImageStorage
from scipy.optimize import brentq

from gpubspline.ct.bodies import Body, Layer, cone, ellipsoid, elliptic_tube, smooth_union, sphere
from gpubspline.ct.femur import ADULT, CANCELLOUS_HU, CORTICAL_HU, HEAD_HU, MARROW_HU, WATER_HU
from gpubspline.ct.phantom import PHANTOMS, Phantom, phantom
from gpubspline.ct.phantom_dicom import write_phantom
from gpubspline.ct.region import otsu_threshold, region_from_threshold
from gpubspline.ct.volume import Volume
from gpubspline.errors import InputError
from gpubspline.spline.lattice import control_lattice

SLICES = {"child-femur": 34, "adult-femur": 97, "head": 55}


@pytest.fixture(scope="module")
def child() -> Phantom:
    return phantom("child-femur")


@pytest.fixture(scope="module")
def child_scan(child: Phantom) -> Volume:
    return child.scan()


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    return write_phantom("child-femur", tmp_path_factory.mktemp("phantoms") / "child")


def random_points(low: float, high: float, count: int = 400) -> np.ndarray:
    return np.random.default_rng(2).uniform(low, high, (count, 3))


def test_sphere_and_cone_are_distances() -> None:
    points = random_points(-20, 20)
    far = np.linalg.norm(points - [1, 2, 3], axis=-1)
    np.testing.assert_allclose(sphere(points, (1, 2, 3), 5), far - 5, atol=1e-12)
    along = np.linspace(0, 1, 20001)[:, None]
    axis = np.array([-8.0, 0, 2]) + along * np.array([16.0, 3, 1])
    nearest = np.linalg.norm(points[:, None] - axis[None, ::100], axis=-1).min(axis=1)
    np.testing.assert_allclose(cone(points, (-8, 0, 2), (8, 3, 3), (4, 4)), nearest - 4, atol=0.01)


def test_ellipses_are_zero_on_the_boundary_with_unit_slope() -> None:
    direction = random_points(-1, 1)
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    axes = np.array([7.0, 11, 5])
    surface = direction * axes + 2
    level = ellipsoid(surface, (2, 2, 2), (7, 11, 5))
    np.testing.assert_allclose(level, 0, atol=1e-12)
    normal = direction / axes
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    np.testing.assert_allclose(ellipsoid(surface + 1e-4 * normal, (2, 2, 2), (7, 11, 5)), 1e-4, rtol=1e-3)
    assert ellipsoid(np.array([[2.0, 2, 2]]), (2, 2, 2), (7, 11, 5))[0] < 0
    flat = surface - [2, 2, 0]
    flat[:, :2] /= np.linalg.norm(flat[:, :2] / axes[:2], axis=-1, keepdims=True)
    np.testing.assert_allclose(elliptic_tube(flat, (7.0, 11.0)), 0, atol=1e-12)


def test_smooth_union_is_the_least_level_away_from_the_fillet() -> None:
    first, second = np.array([-3.0, 5, 1, 1]), np.array([4.0, -2, 1, 1.5])
    joined = smooth_union(first, second, 2.0)
    np.testing.assert_array_equal(joined[:2], [-3, -2])
    assert joined[2] == pytest.approx(0.5)
    assert joined[3] < 1


def test_partial_volume_of_a_flat_boundary_is_its_share() -> None:
    half_space = Body((Layer(lambda points: points[..., 0], lambda points: np.full(points.shape[:-1], 100.0)),), -20.0)
    points = np.array([[-2.0, 0, 0], [-0.25, 0, 0], [0, 0, 0], [0.25, 0, 0], [2, 0, 0]])
    np.testing.assert_allclose(half_space.hu(points, cell_mm=1.0), [100, 70, 40, 10, -20])
    np.testing.assert_allclose(half_space.hu(points), [100, 100, -20, -20, -20])


@pytest.mark.parametrize("name", PHANTOMS)
def test_distance_agrees_with_the_boundary_found_along_the_normal(name: str) -> None:
    made = phantom(name)
    box = np.array(made.shape) - 1
    indices = np.random.default_rng(7).uniform(0, 1, (60000, 3)) * box
    points = indices @ made.affine[:3, :3].T + made.affine[:3, 3]
    near = points[np.abs(made.distance_mm(points)) < 0.4][:100]
    assert len(near) > 50
    steps = np.eye(3) * 1e-5
    normals = np.stack([made.level(near + step) - made.level(near - step) for step in steps], axis=-1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    for point, normal, distance in zip(near, normals, made.distance_mm(near), strict=True):
        found = brentq(lambda t, p=point, n=normal: float(made.level(p + t * n)), -2, 2, xtol=1e-9)
        assert distance == pytest.approx(-found, abs=0.06)  # second order in 0.4 mm


def test_femur_has_its_anatomy() -> None:
    adult = phantom("adult-femur")
    head_to_root = np.array(ADULT.head_centre) - [0, 0, ADULT.root]
    neck_angle = np.degrees(np.arccos(head_to_root @ [0, 0, -1] / np.linalg.norm(head_to_root)))
    assert neck_angle == pytest.approx(128)
    assert ADULT.head_centre[0] < -35  # medial of a left femur, whose lateral is +x
    centre = np.array(ADULT.head_centre)
    np.testing.assert_allclose(adult.hu(centre), CANCELLOUS_HU + HEAD_HU)
    np.testing.assert_allclose(adult.hu(np.array([0.0, 0, 20])), MARROW_HU)
    np.testing.assert_allclose(adult.hu(np.array([ADULT.shaft[0] - 3, 0, 20])), CORTICAL_HU)
    np.testing.assert_allclose(adult.hu(np.array([40.0, 30, 20])), WATER_HU)
    assert adult.level(np.array([13.0, 2, ADULT.root + 30])) < 0  # greater trochanter, above the neck's root
    trochanter_top, saddle = (
        brentq(lambda z, x=x: float(adult.level(np.array([x, 2.0, z]))), ADULT.root, ADULT.length) for x in (16.0, -2.0)
    )
    assert trochanter_top > saddle + 1  # a fossa between it and the neck
    head_top = np.array([ADULT.head_centre[0], 0, ADULT.length])
    assert adult.level(head_top) == pytest.approx(0, abs=1e-9)


def test_head_has_its_layers() -> None:
    made = phantom("head")
    column = np.array([[0.0, 6, z] for z in (106.0, 106 + 67, 106 + 69.5, 106 + 76)])
    np.testing.assert_allclose(made.hu(column), [36, 1250, 550, 45])
    assert made.hu(np.array([0.0, -128, 106])) == -1000
    np.testing.assert_allclose(made.level(column * [-1, 1, 1]), made.level(column))


def test_an_unknown_phantom_names_those_there_are() -> None:
    with pytest.raises(InputError, match="expected a phantom of child-femur, adult-femur, head, got 'knee'"):
        phantom("knee")


def test_scan_is_the_same_each_time_and_reports_progress(child: Phantom, child_scan: Volume) -> None:
    steps = []
    again = child.scan(progress=lambda done, total: steps.append((done, total)))
    np.testing.assert_array_equal(again.hu, child_scan.hu)
    assert steps == [(k, 34) for k in range(1, 35)]
    assert child_scan.hu.dtype == np.int16


def test_scan_is_the_exact_hu_away_from_boundaries(child: Phantom, child_scan: Volume) -> None:
    k, j, i = np.indices(child_scan.hu.shape)
    points = child_scan.to_points(np.stack([i, j, k], axis=-1))
    level = child.level(points)
    water = level > 4
    error = child_scan.hu[water] - WATER_HU
    assert abs(error.mean()) < 0.2
    assert error.std() == pytest.approx(child.noise_hu, rel=0.03)
    core = child.body.layers[1].level(points) < -4
    error = child_scan.hu[core] - child.hu(points[core])
    assert abs(error.mean()) < 1
    assert error.std() == pytest.approx(child.noise_hu, rel=0.1)


def test_row_ends_meet_the_exact_boundary_below_a_voxel(child: Phantom, child_scan: Volume) -> None:
    # the iso-level of a blurred edge lies on the edge at half its height, outside it at less: 0.2 mm at Otsu's 429 HU
    region = region_from_threshold(child_scan, otsu_threshold(child_scan))
    lattice = control_lattice(child_scan, region, (20, 40, 34), smoothing=0).points[..., :3]
    distance = child.distance_mm(lattice[[0, -1]])
    assert 0.1 < distance.mean() < 0.3
    assert np.abs(distance).max() < 1.3 * 0.45  # in voxels of 0.45 mm, though slices are 3 mm thick
    inside = child.distance_mm(lattice[5:15, 10:30])
    assert inside.max() < 0


@pytest.mark.parametrize("threshold", [150.0, 300.0])
def test_every_slice_hits_the_bone(child_scan: Volume, threshold: float) -> None:
    assert region_from_threshold(child_scan, threshold).mask.any(axis=(1, 2)).all()


def test_region_has_the_volume_of_the_body_and_of_its_blur(child: Phantom, child_scan: Volume) -> None:
    fine = np.stack(np.meshgrid(np.arange(-48, 26, 0.5), np.arange(-24, 24, 0.5), np.arange(0, 99, 0.5)), axis=-1)
    level = child.level(fine + 0.25)
    exact, half_a_millimetre_more = (np.count_nonzero(level < bound) * 0.125 for bound in (0, 0.5))
    region = region_from_threshold(child_scan, otsu_threshold(child_scan))
    assert exact < region.volume_mm3 < half_a_millimetre_more


def test_pydicom_reads_back_what_was_scanned(written: list[Path], child_scan: Volume) -> None:
    assert [path.name for path in written] == [f"slice_{k:03d}.dcm" for k in range(1, 35)]
    for k in (0, 17, 33):
        dataset = pydicom.dcmread(written[k])
        assert dataset.SOPClassUID == CTImageStorage
        assert dataset.file_meta.MediaStorageSOPInstanceUID == dataset.SOPInstanceUID
        assert dataset.SOPInstanceUID.is_valid
        assert str(dataset.PatientName) == "Phantom"
        assert dataset.PatientBirthDate == ""
        hu = dataset.pixel_array * dataset.RescaleSlope + dataset.RescaleIntercept
        np.testing.assert_array_equal(hu, child_scan.hu[k])
        np.testing.assert_allclose([float(x) for x in dataset.ImagePositionPatient], child_scan.to_points([0, 0, k]))
    uids = {pydicom.dcmread(path, stop_before_pixels=True).SOPInstanceUID for path in written}
    assert len(uids) == 34
    assert len({pydicom.dcmread(path, stop_before_pixels=True).SeriesInstanceUID for path in written}) == 1


def test_simpleitk_reads_back_the_same_volume(written: list[Path], child_scan: Volume) -> None:
    reader = sitk.ImageSeriesReader()
    reader.SetFileNames(reader.GetGDCMSeriesFileNames(str(written[0].parent)))
    image = reader.Execute()
    np.testing.assert_array_equal(sitk.GetArrayFromImage(image), child_scan.hu)
    for index in ((0, 0, 0), (100, 30, 0), (17, 90, 33)):
        np.testing.assert_allclose(image.TransformIndexToPhysicalPoint(index), child_scan.to_points(index), atol=1e-6)


def test_series_is_the_same_each_time(written: list[Path], tmp_path: Path) -> None:
    (tmp_path / "again").mkdir()  # an empty folder will do
    again = write_phantom("child-femur", tmp_path / "again")
    assert [path.read_bytes() for path in again] == [path.read_bytes() for path in written]


def test_folders_that_will_not_do(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="expected an existing folder to make child in"):
        write_phantom("child-femur", tmp_path / "nowhere" / "child")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "note.txt").write_text("kept")
    with pytest.raises(InputError, match="expected a new or an empty folder"):
        write_phantom("child-femur", tmp_path / "full")
    with pytest.raises(InputError, match="expected a folder to make, got the file"):
        write_phantom("child-femur", tmp_path / "full" / "note.txt")
    assert (tmp_path / "full" / "note.txt").read_text() == "kept"


def test_folder_appears_whole_or_not_at_all(tmp_path: Path) -> None:
    def stop(done: int, total: int) -> None:
        if done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_phantom("child-femur", tmp_path / "child", progress=stop)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
@pytest.mark.parametrize("name", PHANTOMS)
def test_every_phantom_is_written_and_hit_in_every_slice(name: str, tmp_path: Path) -> None:
    files = write_phantom(name, tmp_path / name)
    assert len(files) == SLICES[name]
    reader = sitk.ImageSeriesReader()
    reader.SetFileNames(reader.GetGDCMSeriesFileNames(str(tmp_path / name)))
    image = reader.Execute()
    affine = np.eye(4)
    affine[:3, :3] = np.diag(image.GetSpacing())
    affine[:3, 3] = image.GetOrigin()
    volume = Volume(sitk.GetArrayFromImage(image).astype(np.int16), affine)
    np.testing.assert_allclose(affine, phantom(name).affine, atol=1e-6)
    region = region_from_threshold(volume, otsu_threshold(volume))
    assert region.mask.any(axis=(1, 2)).all()
    lattice = control_lattice(volume, region, (20, 24, 30), smoothing=0).points[..., :3]
    # a voxel, and the partial volume of thick slices under the rounded top
    assert np.abs(phantom(name).distance_mm(lattice[[0, -1]])).max() < 1.3 * volume.spacing_mm[0]
