"""DICOM SEG (PS3.3 A.51), binary, fractional or as a label map, read by highdicom."""

import warnings
from pathlib import Path
from typing import Any

import numpy as np

from gpubspline.ct.labels import Labels, Segment, check_frame, lay_on
from gpubspline.ct.volume import Volume
from gpubspline.errors import InputError


def open_seg(path: Path, volume: Volume) -> Labels:
    """Open the segments of a DICOM SEG by number and label.

    A fractional one is inside where at least half of its greatest value, and covers each voxel by its part of that.

    Raises
    ------
    InputError where it cannot be read, or is in another frame of reference than the volume.
    """
    import highdicom

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            image = highdicom.seg.segread(path)
            numbers = [int(number) for number in image.segment_numbers]
            names = {number: str(image.get_segment_description(number).segment_label) for number in numbers}
    except Exception as error:  # pydicom and highdicom raise many kinds for a damaged or another file
        raise InputError(f"cannot read {path.name} as DICOM SEG: {_line(error)}") from None
    check_frame(str(image.get("FrameOfReferenceUID") or ""), volume, path.name)

    def read(number: int) -> Segment:
        values, affine = _grid_of(image, number, path)
        if values.dtype.kind == "f":
            covered = lay_on(values.astype(np.float32), affine, volume, path.name)
            return Segment(covered >= 0.5, covered)
        return Segment(lay_on(values != 0, affine, volume, path.name))

    return Labels(path.name, {number: name for number, name in names.items() if number > 0}, read)


def _grid_of(image: Any, number: int, path: Path) -> tuple[Any, Any]:
    """Values (k, j, i) of a segment and the affine of (i, j, k) to LPS mm."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = image.get_volume(segment_numbers=[number])
    except Exception as error:  # and several for frames that make no grid
        raise InputError(f"expected frames on one regular grid in {path.name}, got others: {_line(error)}") from None
    affine = np.array(found.affine, dtype=np.float64)[:, [2, 1, 0, 3]]
    return np.asarray(found.array)[..., 0], affine


def _line(error: BaseException) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0]
