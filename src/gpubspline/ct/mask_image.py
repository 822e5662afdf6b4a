"""Label images: NIfTI, NRRD, MetaImage and ``.npy``, with the names of their labels where the file carries them.

Names come from the fields ``Segment0_Name`` and ``Segment0_LabelValue`` of Slicer's ``.seg.nrrd``, whose grid may be a
part of the CT's and whose layers may overlap, and from the label table in the header extension of NIfTI that
TotalSegmentator and Connectome Workbench write.
"""

import re
import struct
from pathlib import Path
from typing import Any

import numpy as np
import SimpleITK as sitk
from numpy.typing import NDArray

from gpubspline.ct.image import format_name, image_affine, load_array, quiet_itk, read_image
from gpubspline.ct.labels import MOST_LABELS, PLACE_TOLERANCE, Labels, Segment, lay_on, place
from gpubspline.ct.nifti import nifti_files, opened
from gpubspline.ct.volume import Volume
from gpubspline.errors import InputError

_MOST_EXTENSION = 1 << 22
"""Bytes of a NIfTI header extension that are looked at."""


def open_array(path: Path, volume: Volume) -> Labels:
    """Open a ``.npy`` of the volume's shape (k, j, i); raises InputError where it is another."""
    values = load_array(path)
    _check_size(values, volume, path)
    return _of_values([values], {}, path)


def open_image(path: Path, volume: Volume) -> Labels:
    """Open a label image; raises InputError where it cannot be read or does not lie on the volume's grid."""
    fields = _segment_fields(path) if format_name(path) == "NRRD" else {}
    if fields:
        return _open_slicer(path, volume, fields)
    values, affine = read_image(path)
    _check_size(values, volume, path)
    off = _corner_distance(affine, volume)
    if off > PLACE_TOLERANCE * float(volume.spacing_mm.min()):
        raise InputError(
            f"expected a mask in the volume's place (origin {place(volume.affine)}, spacing "
            f"{place(volume.spacing_mm)} mm), got {path.name} with origin {place(affine)}, spacing "
            f"{place(np.linalg.norm(affine[:3, :3], axis=0))} mm, up to {off:.3g} mm away"
        )
    return _of_values([values], _nifti_names(path) if format_name(path) == "NIfTI" else {}, path)


def label_names(path: Path) -> dict[int, str]:
    """Names of the numbers of a label image, where its file carries them."""
    names = _nifti_names(path) if path.is_file() and format_name(path) == "NIfTI" else {}
    return {number: name for (_, number), name in names.items()}


def _check_size(values: NDArray[Any], volume: Volume, path: Path) -> None:
    if values.shape != volume.hu.shape:
        sizes = ("x".join(map(str, shape)) for shape in (volume.shape, values.shape[::-1]))
        raise InputError("expected a mask on the volume's grid of {} voxels, got {} in ".format(*sizes) + path.name)


def _corner_distance(affine: NDArray[np.float64], volume: Volume) -> float:
    """Greatest distance between corner voxels of the two grids, mm."""
    last = np.array(volume.shape) - 1
    corners = np.array([[i, j, k, 1] for i in (0, last[0]) for j in (0, last[1]) for k in (0, last[2])], dtype=float)
    return float(np.linalg.norm((corners @ (affine - volume.affine).T)[:, :3], axis=1).max())


def _of_values(layers: list[NDArray[Any]], names: dict[tuple[int, int], str], path: Path) -> Labels:
    """Labels of layers of values; ``names`` by layer and value. Values of further layers are numbered on."""
    where: dict[int, tuple[int, float]] = {}
    titles: dict[int, str] = {}
    for layer, values in enumerate(layers):
        for value in _values_of(values, path):
            wanted = int(value) if float(value).is_integer() else 1  # of a scaled mask, the one value
            number = wanted if wanted not in where else max(where) + 1
            where[number] = (layer, value)
            titles[number] = names.get((layer, wanted), "")
    if where and min(where) < 0 and len(where) > MOST_LABELS:
        raise InputError(
            f"expected labels in {path.name}, got {len(where)} values from {min(where)} to {max(where)}, as a CT has"
        )

    def read(number: int) -> Segment:
        layer, value = where[number]
        return Segment(np.asarray(layers[layer] == value))

    return Labels(path.name, titles, read, lambda: Segment(np.logical_or.reduce([values != 0 for values in layers])))


def _values_of(values: NDArray[Any], path: Path) -> NDArray[Any]:
    """Values that occur, but for 0: whole numbers, or one other, as of a mask that was scaled.

    Raises InputError where one is NaN or infinite, or where they are parts: a probability above 0 is not all inside.
    """
    if values.dtype.kind in "iu" and values.dtype.itemsize <= 2:  # counted, not sorted
        least = int(values.min())
        return np.asarray(
            [v + least for v in np.flatnonzero(np.bincount(values.ravel() - np.int32(least))) if v + least]
        )
    found = np.unique(values)
    found = found[found != 0]
    if not np.isfinite(found).all():
        bad = int(np.count_nonzero(~np.isfinite(values)))
        raise InputError(f"expected labels in {path.name}, got NaN or infinity in {bad} of {values.size} voxels")
    parts = found[found != np.rint(found)]
    if len(parts) and len(found) > 1:
        raise InputError(
            f"expected whole numbers as labels in {path.name}, got {len(found)} values such as {parts[0]:g}: if they "
            "are probabilities or an interpolated mask, threshold them first, at 0.5 for example"
        )
    return np.asarray(found)


def _segment_fields(path: Path) -> dict[str, str]:
    """Fields of Slicer's segments in an NRRD header; empty where it has none."""
    reader = sitk.ImageFileReader()
    reader.SetFileName(str(path))
    try:
        with quiet_itk():
            reader.ReadImageInformation()
    except RuntimeError:  # what is wrong is said where the image is read
        return {}
    keys = [key for key in reader.GetMetaDataKeys() if re.match(r"Segment\d+_", key)]
    return {key: reader.GetMetaData(key) for key in keys}


def _open_slicer(path: Path, volume: Volume, fields: dict[str, str]) -> Labels:
    try:
        with quiet_itk():
            image = sitk.ReadImage(str(path))
    except RuntimeError as error:
        raise InputError(f"cannot read {path.name} as NRRD: {str(error).splitlines()[-1]}") from None
    if image.GetDimension() != 3:
        raise InputError(f"expected a three-dimensional segmentation in {path.name}, got size {image.GetSize()}")
    samples = sitk.GetArrayFromImage(image)
    parts = np.moveaxis(samples, -1, 0) if samples.ndim == 4 else samples[None]
    layers = [lay_on(part, image_affine(image), volume, path.name) for part in parts]
    names = {}
    for key, name in fields.items():
        if key.endswith("_Name"):
            start = key[: -len("Name")]
            layer, value = (int(fields.get(start + end, default)) for end, default in (("Layer", 0), ("LabelValue", 1)))
            names[layer, value] = name
    return _of_values(layers, names, path)


def _nifti_names(path: Path) -> dict[tuple[int, int], str]:
    """Names of labels from the header extension of a NIfTI file (nifti1.h: the bytes after 348), by (0, value)."""
    with opened(nifti_files(path)[0]) as file:
        start = file.read(552)
        size = 348 if struct.unpack("<i", start[:4])[0] == 348 or struct.unpack(">i", start[:4])[0] == 348 else 540
        if len(start) < size + 12 or start[size] == 0:
            return {}
        text = (start + file.read(_MOST_EXTENSION))[size + 12 :].decode("utf-8", errors="replace")
    table = text.partition("</LabelTable>")[0]
    found = re.findall(r'<Label\b[^>]*\bKey="(\d+)"[^>]*>(.*?)</Label>', table, flags=re.DOTALL)
    return {(0, int(key)): re.sub(r"^\s*<!\[CDATA\[|\]\]>\s*$", "", name).strip() for key, name in found}
