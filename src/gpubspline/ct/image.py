"""One door for every CT format: DICOM, NIfTI, Analyze, NRRD, MetaImage and NumPy arrays to a ``Volume``."""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import SimpleITK as sitk
from numpy.typing import NDArray

from gpubspline.ct.dicom import Progress, read_dicom
from gpubspline.ct.metaimage import check_metaimage
from gpubspline.ct.nifti import patient_affine
from gpubspline.ct.nifti_samples import read_nifti
from gpubspline.ct.nrrd import check_nrrd
from gpubspline.ct.series import is_dicom
from gpubspline.ct.volume import Volume
from gpubspline.errors import InputError

Floats = NDArray[np.float64]
FORMATS = {
    ".nii": "NIfTI",
    ".nii.gz": "NIfTI",
    ".hdr": "NIfTI",
    ".img": "NIfTI",
    ".hdr.gz": "NIfTI",
    ".img.gz": "NIfTI",
    ".nrrd": "NRRD",
    ".nhdr": "NRRD",
    ".mha": "MetaImage",
    ".mhd": "MetaImage",
}
"""Extensions of images, and what they are of; but for NIfTI, SimpleITK reads them."""


def read_volume(
    source: str | Path | Sequence[str | Path],
    *,
    series: str | None = None,
    allow_gaps: bool = False,
    spacing_mm: tuple[float, float, float] | None = None,
    progress: Progress | None = None,
) -> Volume:
    """Read a CT volume.

    Arguments
    ---------
    source: a folder of DICOM files (subfolders too), a list of them, or one file: DICOM, NIfTI or either file of
        an Analyze or NIfTI pair, NRRD, MetaImage or ``.npy`` of shape (k, j, i).
    series: SeriesInstanceUID to read from DICOM instead of the largest CT series, or traits of its images, such as
        ``"kernel=B30f"``.
    allow_gaps: fill missing DICOM slices by interpolation instead of raising.
    spacing_mm: distances between voxel centres along i, j, k; for ``.npy``, which does not carry them.
    progress: called with the number of DICOM slices decoded and their total.

    Raises
    ------
    InputError where the source is missing, of another format or damaged, or does not hold one CT volume.
    """
    if isinstance(source, np.ndarray) or not isinstance(source, str | Path | Iterable):
        kind = type(source).__name__
        raise InputError(f"expected the path of a CT, or several, got {kind}: Volume(hu, affine) takes an array")
    if not isinstance(source, str | Path):
        paths = [Path(item) for item in source]
        if len(paths) != 1:
            return read_dicom(_existing(paths), series=series, allow_gaps=allow_gaps, progress=progress)
        source = paths[0]
    path = _existing([Path(source)])[0]
    if series is not None and (path.suffix.lower() == ".npy" or format_name(path)):
        raise InputError(f"expected DICOM to take the series {series} from, got {path.name}")
    if path.suffix.lower() == ".npy":
        return _read_npy(path, spacing_mm)
    if spacing_mm is not None:
        raise InputError(f"expected a spacing for .npy only, got one for {path.name}, which carries its own")
    if path.is_dir():
        return _read_folder(path, series, allow_gaps, progress)
    if format_name(path):
        hu, affine = read_image(path)
        return Volume(hu, affine, f"{format_name(path)} image, {len(hu)} slice{'s' if len(hu) > 1 else ''}")
    if is_dicom(path) or path.suffix.lower() == ".dcm":
        return read_dicom([path], series=series, allow_gaps=allow_gaps, progress=progress)
    known = ", ".join([*FORMATS, ".npy"])
    raise InputError(f"expected DICOM or one of {known}, got {path.name}, which is none of them")


def format_name(path: Path) -> str | None:
    """Name of the format that SimpleITK reads, by extension; None for others."""
    name = path.name.lower()
    return next((kind for extension, kind in FORMATS.items() if name.endswith(extension)), None)


def read_image(path: Path) -> tuple[NDArray[Any], Floats]:
    """Read samples (k, j, i), int16 where integers fit, and the affine to LPS mm of an image file.

    A two-dimensional image is one slice. ITK's physical space is LPS already.

    Raises InputError where the file is damaged, or not one scalar value on a two- or three-dimensional grid.
    """
    if format_name(path) == "NIfTI":
        samples, header = read_nifti(path)
        return narrow(samples), patient_affine(header, path.name)
    check = {"MetaImage": check_metaimage, "NRRD": check_nrrd}.get(str(format_name(path)))
    if check is not None:
        check(path)
    try:
        with quiet_itk():
            image = sitk.ReadImage(str(path))
    except RuntimeError as error:
        raise InputError(f"cannot read {path.name} as {format_name(path)}: {_reason(error)}") from None
    if image.GetNumberOfComponentsPerPixel() != 1 or "complex" in image.GetPixelIDTypeAsString():
        raise InputError(f"expected one value a voxel, got {image.GetPixelIDTypeAsString()} in {path.name}")
    while image.GetDimension() > 3 and image.GetSize()[-1] == 1:
        image = image[..., 0]
    if image.GetDimension() not in (2, 3):
        raise InputError(f"expected a three-dimensional image in {path.name}, got size {image.GetSize()}")
    samples = sitk.GetArrayFromImage(image)
    return narrow(samples if samples.ndim == 3 else samples[None]), image_affine(image)


@contextmanager
def quiet_itk() -> Iterator[None]:
    """Let ITK say nothing on stderr meanwhile."""
    display = sitk.ProcessObject.GetGlobalWarningDisplay()
    sitk.ProcessObject.SetGlobalWarningDisplay(False)
    try:
        yield
    finally:
        sitk.ProcessObject.SetGlobalWarningDisplay(display)


def narrow(samples: NDArray[Any]) -> NDArray[Any]:
    """Integers as int16 where they fit, everything else as float32."""
    integers = samples.size > 0 and samples.dtype.kind in "biu"
    if integers and int(samples.min()) >= -32768 and int(samples.max()) <= 32767:
        return samples.astype(np.int16, copy=False)
    with np.errstate(over="ignore"):
        return samples.astype(np.float32, copy=False)


def image_affine(image: sitk.Image) -> Floats:
    """Affine (4, 4) of an ITK image, index (i, j, k) to LPS mm; ITK's physical space is LPS already."""
    n = image.GetDimension()
    affine = np.eye(4)
    affine[:n, :n] = np.reshape(image.GetDirection(), (n, n)) * np.asarray(image.GetSpacing())
    affine[:n, 3] = image.GetOrigin()
    return affine


def _reason(error: RuntimeError) -> str:
    """Last line of ITK's many, without its file and line numbers."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return lines[-1].split("): ", 1)[-1][:200] if lines else "no reason given"


def _existing(paths: Sequence[Path]) -> list[Path]:
    if not paths:
        raise InputError("expected at least one file, got an empty list")
    for path in paths:
        if not path.exists():
            raise InputError(f"expected an existing file or folder, got {path}")
    return list(paths)


def _read_folder(path: Path, series: str | None, allow_gaps: bool, progress: Progress | None) -> Volume:
    files = sorted(item for item in path.rglob("*") if item.is_file() and not item.name.startswith("."))
    if not files:
        raise InputError(f"expected a folder of DICOM files, got {path}, which is empty")
    if not any(is_dicom(item) or item.suffix.lower() == ".dcm" for item in files):
        raise InputError(f"expected a folder of DICOM files, got {path} with {len(files)} other files")
    return read_dicom(files, series=series, allow_gaps=allow_gaps, progress=progress)


def _read_npy(path: Path, spacing_mm: tuple[float, float, float] | None) -> Volume:
    if spacing_mm is None:
        raise InputError(f"expected the spacing of {path.name} in mm along i, j, k (--spacing), got none")
    spacing = np.asarray(spacing_mm, dtype=np.float64)
    if spacing.shape != (3,) or not np.isfinite(spacing).all() or np.any(spacing <= 0):
        raise InputError(f"expected three positive spacings in mm, got {spacing_mm}")
    samples = load_array(path)
    return Volume(narrow(samples), np.diag([*spacing, 1.0]), f"NumPy array, {len(samples)} slices")


def load_array(path: Path) -> NDArray[Any]:
    """Read a numeric array (k, j, i) from ``.npy``; two dimensions are one slice.

    Raises InputError where the file is damaged or holds something else.
    """
    try:
        samples = np.load(path, allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise InputError(f"cannot read {path.name} as .npy: {str(error).splitlines()[0]}") from None
    if not isinstance(samples, np.ndarray) or samples.dtype.kind not in "biuf" or samples.ndim not in (2, 3):
        raise InputError(f"expected numbers of shape (k, j, i) in {path.name}, got {getattr(samples, 'shape', '?')}")
    return samples if samples.ndim == 3 else samples[None]
