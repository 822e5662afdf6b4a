"""Segmentations made elsewhere, by label, checked to lie on the volume's grid: one door for every format."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gpubspline.ct.image import format_name
from gpubspline.ct.labels import Labels, Segment
from gpubspline.ct.mask_image import open_array, open_image
from gpubspline.ct.series import UNREADABLE, is_dicom
from gpubspline.ct.volume import Volume
from gpubspline.errors import InputError


def read_mask(path: str | Path, volume: Volume, label: int | str | None = None) -> NDArray[np.bool_]:
    """Read a mask or one label of a label file.

    Arguments
    ---------
    path: NIfTI, NRRD (Slicer's ``.seg.nrrd`` too), MetaImage, DICOM SEG or RTSTRUCT in the place of ``volume``, or
        ``.npy`` of its shape (k, j, i).
    label: the number or the name of what is inside; None takes all labels together.

    Returns: (n_k, n_j, n_i) bool.

    Raises
    ------
    InputError where the file cannot be read, lies on another grid or in another frame of reference, or has no voxel of
    the label.
    """
    return read_segment(path, volume, label).inside


def read_segment(path: str | Path, volume: Volume, label: int | str | None = None) -> Segment:
    """Read a mask or one label of a label file, and with it the coverage of each voxel where the format tells it.

    Arguments and errors as of ``read_mask``.
    """
    labels = open_labels(path, volume)
    return labels.all() if label is None else labels.segment(labels.number(label))


def open_labels(path: str | Path, volume: Volume) -> Labels:
    """Open a label file: what labels it has, to be read one by one.

    Raises
    ------
    InputError as ``read_mask``, but for the label.
    """
    path = Path(path)
    if path.is_dir():
        raise InputError(f"expected a mask file, got the folder {path}")
    if not path.is_file():
        raise InputError(f"expected an existing mask file, got {path}")
    if path.suffix.lower() == ".npy":
        return open_array(path, volume)
    if format_name(path):
        return open_image(path, volume)
    if is_dicom(path) or path.suffix.lower() == ".dcm":
        return _open_dicom(path, volume)
    raise InputError(f"expected a mask as NIfTI, NRRD, MetaImage, DICOM SEG, RTSTRUCT or .npy, got {path.name}")


def _open_dicom(path: Path, volume: Volume) -> Labels:
    # pydicom takes a third of a second: only where there is DICOM
    import pydicom

    try:
        modality = str(pydicom.dcmread(path, specific_tags=["Modality"], stop_before_pixels=True).get("Modality"))
    except UNREADABLE as error:
        raise InputError(f"cannot read {path.name} as DICOM: {error}") from None
    if modality == "SEG":
        from gpubspline.ct.mask_seg import open_seg

        return open_seg(path, volume)
    if modality == "RTSTRUCT":
        from gpubspline.ct.mask_rtstruct import open_rtstruct

        return open_rtstruct(path, volume)
    raise InputError(f"expected a DICOM SEG or RTSTRUCT as mask, got {path.name} of the modality {modality}")
