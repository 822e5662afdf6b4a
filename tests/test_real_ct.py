"""Real CT from the command line's own pipeline: every data set gives a mesh without an inverted element."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import SimpleITK as sitk

from gpubspline.clock import Clock
from gpubspline.device import Device
from gpubspline.errors import GpubsplineWarning
from gpubspline.material.registry import law
from gpubspline.pipeline import fit_patch, sample_patch, summarise
from gpubspline.recipe import Fitted, Model, Sampling, Shaping, Source


def model(source: Source, control: Any, nodes: Any, device: Device) -> tuple[Fitted, Model]:
    fitted = fit_patch(source, Shaping(control=control), device, Clock())
    return fitted, sample_patch(fitted.fit.patch, Sampling(law(), nodes), device, Clock(), fitted.body)


def test_head(data: Path, device: Device) -> None:
    source = Source(data / "head" / "ct_example.nii.gz", threshold_hu=-200)
    fitted, made = model(source, (20, 80, 26), (20, 80, 28), device)
    figures = summarise(made, device, Clock(), fitted)
    assert made.mesh.n_elements == 40527
    assert made.counted.quality.inverted == 0 and made.counted.quality.fraction_above_0_5 >= 0.97
    assert figures["surface_distance_mm"]["mean"] < 0.5
    assert figures["volume_mm3"]["mesh"] == pytest.approx(figures["volume_mm3"]["region"], rel=0.01)


@pytest.mark.parametrize("slice_index", [0, 8, 13, 25])
def test_head_slice(data: Path, device: Device, slice_index: int) -> None:
    source = Source(data / "head" / "ct_example.nii.gz", threshold_hu=-200, slice_index=slice_index)
    _, made = model(source, None, (140, 140), device)
    assert made.mesh.n_elements == 19321
    assert made.counted.quality.inverted == 0 and made.counted.quality.fraction_above_0_5 >= 0.97


def test_jpeg_2000_series(data: Path, device: Device) -> None:
    fitted, made = model(Source(data / "dicom_j2k", threshold_hu=-200), None, (20, 24, 20), device)
    assert made.counted.quality.inverted == 0
    assert made.mesh.volume_mm3 == pytest.approx(fitted.region.volume_mm3, rel=0.05)


@pytest.mark.parametrize("label", [49, 50])
def test_vertebral_body_by_label(data: Path, device: Device, label: int) -> None:
    folder = data / "vertebra"
    mask = folder / "sub-ct_seg-subreg_label-22_msk.nii.gz"
    source = Source(folder / "sub-ct_label-22_ct.nii.gz", mask=mask, label=label)
    with pytest.warns(GpubsplineWarning, match="of the mask is left out"):
        _, made = model(source, None, (12, 14, 14), device)
    assert made.counted.quality.inverted == 0
    image = sitk.ReadImage(mask)  # its neighbours have the same labels: the largest of them is meant
    parts = sitk.RelabelComponent(sitk.ConnectedComponent(image == label))
    shape = sitk.LabelShapeStatisticsImageFilter()
    shape.Execute(parts)
    assert np.linalg.norm(made.mesh.points.mean(axis=0) - shape.GetCentroid(1)) < 3


HIP = (-146.0, -66.0, -190.0, -100.0, 94.0, 160.0)  # the proximal femur without metal, with its socket


@pytest.mark.parametrize("threshold_hu", [150, 250])
def test_proximal_femur_by_box(data: Path, device: Device, threshold_hu: float) -> None:
    source = Source(data / "hips" / "example_ct.nii.gz", threshold_hu=threshold_hu, box_mm=HIP)
    _, made = model(source, None, (14, 18, 20), device)
    assert made.counted.quality.inverted == 0
    low, high = made.mesh.points.min(axis=0), made.mesh.points.max(axis=0)
    assert np.all(low >= np.array(HIP[::2]) - 1e-3) and np.all(high <= np.array(HIP[1::2]) + 1e-3)


def test_tilted_head_is_unsheared(data: Path, device: Device) -> None:
    with pytest.warns(GpubsplineWarning, match="not evenly spaced"):
        _, made = model(Source(data / "dicom_tilt", threshold_hu=-200), None, (20, 40, 37), device)
    assert made.counted.quality.inverted == 0
    low, high = extent_of_tilted_head(data / "dicom_tilt")
    voxel = 1.0
    points = made.mesh.points
    assert np.all(np.abs(points.min(axis=0)[:2] - low) < voxel) and np.all(
        np.abs(points.max(axis=0)[:2] - high) < voxel
    )


def extent_of_tilted_head(folder: Path) -> tuple[Any, Any]:
    """Left-right and front-back extent (2,), (2,) of the largest body above -200 HU, by SimpleITK alone.

    Every slice is placed by its own header; slices are joined for the labels only, so that no stacking can shear them.
    """
    images = [sitk.ReadImage(path) for path in sorted(folder.glob("*.dcm"))]
    images.sort(key=lambda image: image.GetOrigin()[2])
    plain = [sitk.Extract(image, (*image.GetSize()[:2], 0), (0, 0, 0)) for image in images]
    for image in plain:  # one grid for the labels
        image.SetOrigin((0, 0))
        image.SetDirection((1, 0, 0, 1))
    parts = sitk.RelabelComponent(sitk.ConnectedComponent(sitk.JoinSeries([image > -200 for image in plain])))
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    for labels, image in zip(sitk.GetArrayFromImage(parts), images, strict=True):
        j, i = np.nonzero(labels == 1)
        corners = [(int(a), int(b), 0) for a in (i.min(), i.max()) for b in (j.min(), j.max())]
        points = np.array([image.TransformIndexToPhysicalPoint(corner)[:2] for corner in corners])
        low, high = np.minimum(low, points.min(axis=0)), np.maximum(high, points.max(axis=0))
    return low, high
