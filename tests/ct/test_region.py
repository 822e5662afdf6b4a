"""Regions from thresholds and labels: which voxels, where the boundary, how much volume."""

import numpy as np
import pytest
import scipy.ndimage as ndimage
import SimpleITK as sitk

from gpubspline.ct.image import read_volume
from gpubspline.ct.masks import read_mask
from gpubspline.ct.region import (
    Region,
    fill_holes,
    largest_component,
    otsu_threshold,
    region_from_mask,
    region_from_threshold,
)
from gpubspline.ct.volume import Volume
from gpubspline.errors import InputError


def ellipsoid(shape=(26, 40, 44), axes=(14.0, 11.0, 8.0), steps=(0.7, 0.7, 1.0)):
    """Points relative to the middle, a function that is 1 on the ellipsoid, and the affine."""
    affine = np.diag([*steps, 1.0])
    k, j, i = np.indices(shape)
    index = np.stack([i, j, k], axis=-1) - (np.array(shape[::-1]) / 2 + [0.1, -0.3, 0.2])
    return np.linalg.norm(index * steps / np.array(axes), axis=-1), affine


def test_threshold_region_of_an_ellipsoid_has_its_volume():
    """HU linear across the boundary; 0.1 % of 4/3 pi a b c."""
    radius, affine = ellipsoid()
    volume = Volume((1000 * (1 - radius)).astype(np.float32), affine)
    region = region_from_threshold(volume, 0.0)
    np.testing.assert_array_equal(region.mask, radius <= 1)
    np.testing.assert_array_equal(region.distance_mm < 0, region.mask)
    np.testing.assert_allclose(region.volume_mm3, 4 / 3 * np.pi * 14 * 11 * 8, rtol=1.5e-3)
    middle = volume.to_points(np.array([44, 40, 26]) / 2 + [0.1, -0.3, 0.2])
    np.testing.assert_allclose(region.centroid_mm, middle, atol=0.05)


def test_boundary_moves_with_the_threshold_by_less_than_a_voxel():
    """On a ramp of 100 HU/mm the plane at a threshold lies at threshold / 100 mm."""
    hu = np.broadcast_to(2000 - 100 * np.arange(30.0), (5, 6, 30)).astype(np.float32)
    for threshold in (500.0, 512.5, 590.0):
        region = region_from_threshold(Volume(hu, np.eye(4)), threshold)
        np.testing.assert_allclose(region.distance_mm[2, 3], np.arange(30) - (2000 - threshold) / 100, atol=2e-3)


def two_bodies():
    hu = np.full((12, 20, 30), -1000, dtype=np.int16)
    hu[2:10, 3:17, 3:17] = 50
    hu[4:8, 8:12, 8:12] = -900  # a hole closed in 3-D
    hu[2:10, 5:7, 5:7] = -900  # a canal open at both ends
    hu[3:9, 4:9, 20:26] = 50  # a smaller body
    return Volume(hu, np.eye(4))


def test_largest_body_and_holes():
    volume = two_bodies()
    body = np.zeros(volume.hu.shape, dtype=bool)
    body[2:10, 3:17, 3:17] = True
    canal = np.zeros_like(body)
    canal[2:10, 5:7, 5:7] = True
    np.testing.assert_array_equal(region_from_threshold(volume, -200).mask, body)
    np.testing.assert_array_equal(region_from_threshold(volume, -200, fill="volume").mask, body & ~canal)
    np.testing.assert_array_equal(region_from_threshold(volume, -200, fill="slice", fill_axis=0).mask, body & ~canal)
    plain = region_from_threshold(volume, -200, fill="none").mask
    np.testing.assert_array_equal(plain, (volume.hu > 0) & body)
    np.testing.assert_array_equal(region_from_threshold(volume, -200, largest=False, fill="none").mask, volume.hu > 0)


def test_filled_holes_have_no_boundary_and_end_halfway():
    """Along k the filled canal meets air, whose HU says nothing of the boundary."""
    region = region_from_threshold(two_bodies(), -200)
    assert (region.distance_mm[5, 8:12, 8:12] < -2).all()
    above, below = region.distance_mm[1, 6, 6], region.distance_mm[2, 6, 6]
    np.testing.assert_allclose(above / (above - below), 0.5, atol=0.05)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_holes_filled_by_slices_agree_with_scipy(axis):
    mask = ndimage.gaussian_filter(np.random.default_rng(6).normal(size=(20, 22, 24)), 1.2) > 0
    expected = np.stack([ndimage.binary_fill_holes(m) for m in np.moveaxis(mask, 2 - axis, 0)])
    np.testing.assert_array_equal(fill_holes(mask, "slice", axis), np.moveaxis(expected, 0, 2 - axis))
    np.testing.assert_array_equal(fill_holes(mask, "volume"), ndimage.binary_fill_holes(mask))


def test_largest_component_agrees_with_scipy():
    mask = ndimage.gaussian_filter(np.random.default_rng(7).normal(size=(20, 22, 24)), 1) > 0.07
    labels, _ = ndimage.label(mask)
    largest = 1 + np.argmax(np.bincount(labels.ravel())[1:])
    assert labels.max() > 3
    np.testing.assert_array_equal(largest_component(mask), labels == largest)


def test_nothing_above_the_threshold_is_an_error_with_the_range():
    with pytest.raises(InputError, match=r"at or above the threshold 3000, got -1000 to 50"):
        region_from_threshold(two_bodies(), 3000)


def test_otsu_parts_two_classes():
    rng = np.random.default_rng(8)
    hu = np.where(
        np.indices((10, 40, 40))[2] < 15, rng.normal(-1000, 30, (10, 40, 40)), rng.normal(40, 30, (10, 40, 40))
    )
    volume = Volume(hu.astype(np.int16), np.eye(4))
    assert -900 < otsu_threshold(volume) < -50
    np.testing.assert_array_equal(hu > otsu_threshold(volume), hu > -500)


@pytest.mark.parametrize("padding", [-2000, -3024])
def test_otsu_takes_the_corners_of_a_round_field_of_view_for_air(padding):
    """With them as a class of its own, all that was scanned was the body."""
    j, i = np.indices((40, 40)) - 19.5
    rows = np.where(np.hypot(j, i) < 9, 40, -1000) + np.random.default_rng(8).normal(0, 20, (40, 40))
    slices = [np.where(np.hypot(j, i) < 19, rows, hu)[None].astype(np.int16) for hu in (-1000, padding)]
    plain, padded = (Volume(hu, np.eye(4)) for hu in slices)
    for volume in (plain, padded):
        np.testing.assert_array_equal(volume.hu[0] > otsu_threshold(volume), rows > -500)


def test_threshold_smoothing_removes_noise():
    radius, affine = ellipsoid()
    noise = np.random.default_rng(9).normal(0, 400, radius.shape)
    volume = Volume((1000 * (radius < 1) - 500 + noise).astype(np.float32), affine)
    rough = region_from_threshold(volume, 0.0).mask != (radius < 1)
    smooth = region_from_threshold(volume, 0.0, smoothing_mm=0.7).mask != (radius < 1)
    assert smooth.sum() < 0.5 * rough.sum()


def test_label_boundary_is_smooth_and_within_half_a_voxel():
    """Of the exact distance within a voxel of the boundary, the smoothed label keeps 0.15 voxels of error, rms."""
    k, j, i = np.indices((36, 36, 36))
    exact = np.sqrt((k - 17.3) ** 2 + (j - 17.6) ** 2 + (i - 17.0) ** 2) - 12
    mask = exact < 0
    near = np.abs(exact) < 1
    errors = {}
    for smoothing in (None, 0.0):
        region = region_from_mask(np.eye(4), mask, smoothing_mm=smoothing)
        np.testing.assert_array_equal(region.mask, mask)
        np.testing.assert_array_equal(region.distance_mm < 0, mask)
        errors[smoothing] = np.sqrt(np.mean((region.distance_mm - exact)[near] ** 2))
    assert errors[None] < 0.15 < errors[0.0]
    np.testing.assert_allclose(region_from_mask(np.eye(4), mask).volume_mm3, mask.sum(), rtol=0.015)


def test_smoothing_never_deletes_thin_parts():
    mask = np.zeros((16, 16, 30), dtype=bool)
    mask[8, 8, 2:28] = True  # a needle of one voxel
    mask[4:12, 4:12, 2:8] = True
    for smoothing in (None, 3.0):
        region = region_from_mask(np.eye(4), mask, smoothing_mm=smoothing)
        np.testing.assert_array_equal(region.distance_mm < 0, mask)


def test_masks_of_another_shape_or_empty_are_errors():
    volume = two_bodies()
    with pytest.raises(InputError, match=r"volume's shape \(12, 20, 30\)"):
        region_from_mask(volume, np.ones((12, 20, 29), bool))
    with pytest.raises(InputError, match="at least one voxel inside"):
        region_from_mask(volume, np.zeros((12, 20, 30), bool))
    with pytest.raises(InputError, match="smoothing of 0 mm or more"):
        region_from_mask(volume, np.ones((12, 20, 30), bool), smoothing_mm=-1)
    with pytest.raises(InputError, match="fill of slice, volume or none"):
        region_from_threshold(volume, 0, fill="all")
    with pytest.raises(InputError, match="one shape"):
        Region(np.ones((2, 2, 2), bool), np.zeros((2, 2, 3), np.float32), np.eye(4))


def test_one_slice_is_a_region():
    radius, affine = ellipsoid(shape=(1, 40, 44), axes=(14.0, 11.0, 50.0))
    region = region_from_threshold(Volume((1000 * (1 - radius)).astype(np.float32), affine), 0.0)
    np.testing.assert_allclose(region.volume_mm3, np.pi * 14 * 11 * 1.0, rtol=2e-3)
    labelled = region_from_mask(affine, region.mask)
    np.testing.assert_allclose(labelled.volume_mm3, region.mask.sum() * 0.49, rtol=0.01)


def test_box_holds_the_mask_and_no_more():
    region = region_from_threshold(two_bodies(), -200)
    assert region.box == ((3, 3, 2), (17, 17, 10))
    assert region.shape == (30, 20, 12)


def test_outermost_centres_reach_as_far_as_all_do():
    """In a sheared scan, along any direction."""
    rng = np.random.default_rng(0)
    mask, affine = rng.random((7, 9, 11)) < 0.1, np.eye(4)
    affine[:3] = rng.normal(size=(3, 4))
    region = Region(mask, np.where(mask, -1, 1).astype(np.float32), affine)
    inside = np.argwhere(mask)[:, ::-1] @ affine[:3, :3].T + affine[:3, 3]
    ways = rng.normal(size=(3, 50))
    np.testing.assert_allclose((region.outermost_mm @ ways).max(axis=0), (inside @ ways).max(axis=0), rtol=1e-12)
    np.testing.assert_allclose(region.centroid_mm, inside.mean(axis=0), rtol=1e-12)


def test_head_region_is_the_one_simpleitk_finds(data):
    """Same voxels as SimpleITK's pipeline; volume within 1 % of its voxel count, less half a slice at each end."""
    volume = read_volume(data / "head" / "ct_example.nii.gz")
    region = region_from_threshold(volume, -200.0)
    image = sitk.ReadImage(str(data / "head" / "ct_example.nii.gz"))
    labels = sitk.RelabelComponent(sitk.ConnectedComponent(image >= -200))
    expected = np.stack([ndimage.binary_fill_holes(m) for m in sitk.GetArrayFromImage(labels) == 1])
    np.testing.assert_array_equal(region.mask, expected)
    np.testing.assert_array_equal(region.distance_mm < 0, expected)
    counted = expected.sum() - 0.5 * (expected[0].sum() + expected[-1].sum())
    np.testing.assert_allclose(region.volume_mm3, counted * volume.voxel_mm3, rtol=0.01)


def test_vertebra_body_region(data):
    volume = read_volume(data / "vertebra" / "sub-ct_label-22_ct.nii.gz")
    path = data / "vertebra" / "sub-ct_seg-subreg_label-22_msk.nii.gz"
    labels, counts = np.unique(sitk.GetArrayFromImage(sitk.ReadImage(str(path))), return_counts=True)
    body = int(labels[1:][counts[1:].argmax()])
    mask = read_mask(path, volume, label=body)
    region = region_from_mask(volume, mask)
    np.testing.assert_array_equal(region.mask, largest_component(mask))
    np.testing.assert_allclose(region.volume_mm3, region.mask.sum() * volume.voxel_mm3, rtol=0.03)
    image = sitk.ReadImage(str(path)) == body
    shape = sitk.LabelShapeStatisticsImageFilter()
    shape.Execute(sitk.RelabelComponent(sitk.ConnectedComponent(image)) == 1)
    np.testing.assert_allclose(region.centroid_mm, shape.GetCentroid(1), atol=1e-6)
