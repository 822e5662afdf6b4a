"""DICOM RTSTRUCT (PS3.3 A.19): closed contours of regions of interest, to masks finer than voxels."""

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pydicom
from numpy.typing import NDArray

from gpubspline.ct.contours import Plane, fill
from gpubspline.ct.labels import Labels, Segment, check_frame
from gpubspline.ct.series import UNREADABLE
from gpubspline.ct.volume import Volume
from gpubspline.errors import InputError

Floats = NDArray[np.float64]

FLATNESS = 0.05
"""Greatest rise of a contour out of the volume's slices, in slices."""

SAME_PLANE = 1e-3
"""Slices within which contours lie in one plane."""


def open_rtstruct(path: Path, volume: Volume) -> Labels:
    """Open the regions of interest of a DICOM RTSTRUCT that have closed contours, by number and name.

    Contours of one plane are combined by even and odd, so that one within another is a hole. A slice without contours
    takes those of the nearest plane within half of the distance between planes.

    Raises
    ------
    InputError where it cannot be read, is in another frame of reference than the volume, or lies across its slices.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            dataset = pydicom.dcmread(path)
            names = {int(roi.ROINumber): str(roi.get("ROIName") or "") for roi in dataset.StructureSetROISequence}
            frames = {str(roi.get("ReferencedFrameOfReferenceUID") or "") for roi in dataset.StructureSetROISequence}
            contours = {int(roi.ReferencedROINumber): _closed(roi) for roi in dataset.get("ROIContourSequence") or []}
    except UNREADABLE as error:
        raise InputError(f"cannot read {path.name} as DICOM RTSTRUCT: {_line(error)}") from None
    for frame in sorted(frames):
        check_frame(frame, volume, path.name)

    def read(number: int) -> Segment:
        return Segment(*fill(_planes(contours[number], volume, path), volume.hu.shape))

    return Labels(path.name, {n: name for n, name in names.items() if contours.get(n)}, read)


def _closed(roi: Any) -> list[Floats]:
    """Closed contours (points, 3), LPS mm (PS3.3 C.8.8.6)."""
    kinds = ("CLOSED_PLANAR", "CLOSEDPLANAR_XOR")
    found = [item for item in roi.get("ContourSequence") or [] if item.ContourGeometricType in kinds]
    return [np.array(item.ContourData, dtype=np.float64).reshape(-1, 3) for item in found if len(item.ContourData) > 6]


def _planes(contours: list[Floats], volume: Volume, path: Path) -> list[Plane]:
    """Contours in index coordinates, gathered by planes."""
    indices = [volume.to_indices(contour) for contour in contours]
    for contour in indices:
        if np.ptp(contour[:, 2]) > FLATNESS:
            raise InputError(
                f"expected contours along the slices of the CT, got one in {path.name} that rises through "
                f"{np.ptp(contour[:, 2]):.2g} slices"
            )
    heights = np.array([contour[:, 2].mean() for contour in indices])
    order = np.argsort(heights)
    groups = np.split(order, np.flatnonzero(np.diff(heights[order]) > SAME_PLANE) + 1)
    return [Plane(float(heights[g].mean()), [indices[n][:, :2] for n in g]) for g in groups]


def _line(error: BaseException) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0]
