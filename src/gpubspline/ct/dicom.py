"""A DICOM CT series to a ``Volume``: decoding, rescale, and slices in their places."""

import os
import warnings
from collections import defaultdict, deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pydicom
from numpy.typing import NDArray
from pydicom.dataset import Dataset
from pydicom.pixels.decoders.base import get_decoder
from pydicom.pixels.utils import pixel_array
from pydicom.uid import HTJ2K, ExplicitVRLittleEndian, HTJ2KLossless, HTJ2KLosslessRPCL, ImplicitVRLittleEndian

from gpubspline.ct.series import UNREADABLE, choose_series, read_headers
from gpubspline.ct.slices import Slice, slices_of
from gpubspline.ct.spacing import describe_spacings, is_uniform, missing_slices, resample_slices, uniform_positions
from gpubspline.ct.traits import SAME_PLACE_MM, difference, parse_choice
from gpubspline.ct.volume import AIR_HU, Volume
from gpubspline.errors import GpubsplineWarning, InputError

AHEAD = 2
"""Files a thread that are decoded before their turn."""

Progress = Callable[[int, int], None]
Floats = NDArray[np.float64]


def read_dicom(
    paths: Sequence[Path], *, series: str | None = None, allow_gaps: bool = False, progress: Progress | None = None
) -> Volume:
    """Read the CT series of a list of files.

    Slices are ordered by position along their normal, so that k grows along i x j. A gantry tilt stays in the third
    column of the affine, as a shear.

    Arguments
    ---------
    paths: files; what is not DICOM among them is left out.
    series: SeriesInstanceUID to read instead of the CT series of the most images, or what its images have, such as
        ``"kernel=B30f"``, or both with a comma between; see ``traits.KEYWORDS``.
    allow_gaps: fill missing slices by interpolation instead of raising.
    progress: called with the number of slices decoded and their total.

    Raises
    ------
    InputError where no CT series is among the files, one is damaged, a slice is missing, images do not match or are of
    several reconstructions of one body.

    Warns
    -----
    GpubsplineWarning where another series may have been meant, localisers or doubled slices were left out, or slices
    were resampled to even spacing.
    """
    found: list[str] = []
    choice = parse_choice(series)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # pydicom's: attributes that break the standard's rules are no concern here
        slices = slices_of(choose_series(read_headers(paths), choice, found), found, choice)
        hu = _decode(slices, progress)
    slices, hu = _drop_doubles(slices, hu, found)
    hu, affine = _place(slices, hu, allow_gaps, found)
    for message in found:
        warnings.warn(message, GpubsplineWarning, stacklevel=3)
    frames = {item.frame_of_reference for item in slices}
    frame = frames.pop() if len(frames) == 1 else None
    return Volume(hu, affine, f"DICOM CT, {len(slices)} slice{'s' if len(slices) > 1 else ''}", frame or None)


def _decode(slices: Sequence[Slice], progress: Progress | None) -> NDArray[Any]:
    """Decode every slice: (n, rows, columns) int16 where all values fit, else float32."""
    files: dict[Path, list[int]] = defaultdict(list)
    for number, item in enumerate(slices):
        files[item.path].append(number)
    hu = np.empty((len(slices), *slices[0].shape), dtype=np.int16)
    done = 0
    for numbers, images in _decoded([[slices[n] for n in numbers] for numbers in files.values()], files.values()):
        for number, image in zip(numbers, images, strict=True):
            if image.dtype != hu.dtype and hu.dtype == np.int16:
                hu = hu.astype(np.float32)
            hu[number] = image
            done += 1
            if progress:
                progress(done, len(slices))
    return hu


def _decoded(
    files: Sequence[Sequence[Slice]], numbers: Iterable[list[int]]
) -> Iterator[tuple[list[int], list[NDArray[Any]]]]:
    """Images of each file beside their numbers; threads decode a few files ahead, so that few are held twice."""
    workers = min(8, os.cpu_count() or 1)
    with ThreadPoolExecutor(workers) as pool:
        waiting: deque[tuple[list[int], Future[list[NDArray[Any]]]]] = deque()
        try:
            for of, file in zip(numbers, files, strict=True):
                waiting.append((of, pool.submit(_decode_file, file)))
                if len(waiting) > AHEAD * workers:
                    first, job = waiting.popleft()
                    yield first, job.result()
            while waiting:
                first, job = waiting.popleft()
                yield first, job.result()
        finally:  # at an error or an interrupt nobody waits for the files that are left
            pool.shutdown(cancel_futures=True)


def _decode_file(slices: Sequence[Slice]) -> list[NDArray[Any]]:
    path = slices[0].path
    try:
        dataset = pydicom.dcmread(path, force=True)
        if "PixelData" not in dataset:
            raise InputError(f"expected pixels in {path.name}, got none: the file may be truncated, copy it again")
        if "TransferSyntaxUID" not in dataset.file_meta:  # a bare data set: what reading it found out
            implicit, _ = dataset.original_encoding
            dataset.file_meta.TransferSyntaxUID = ImplicitVRLittleEndian if implicit else ExplicitVRLittleEndian
        _check_decoder(dataset, path.name)
        return [_to_hu(pixel_array(dataset, index=item.frame), dataset, item) for item in slices]
    except InputError:
        raise
    except UNREADABLE as error:
        reason = (str(error).strip().splitlines() or [type(error).__name__])[0]
        raise InputError(f"cannot decode the pixels of {path.name}, which may be truncated: {reason}") from None


def _check_decoder(dataset: Dataset, name: str) -> None:
    """Raise InputError where nothing decodes the transfer syntax (PS3.5 annex A), or what does is not installed."""
    syntax = dataset.file_meta.TransferSyntaxUID
    try:
        decoder = get_decoder(syntax)
    except NotImplementedError:
        raise InputError(
            f"expected pixels that can be decoded in {name}, got {syntax.name}: convert the series, for example by "
            "gdcmconv --raw"
        ) from None
    if not decoder.is_available:
        package = "pylibjpeg-openjpeg" if syntax in (HTJ2K, HTJ2KLossless, HTJ2KLosslessRPCL) else "python-gdcm"
        raise InputError(f"expected a decoder of {syntax.name}, as {name} is, got none: pip install {package}")


def _to_hu(raw: NDArray[Any], dataset: Dataset, item: Slice) -> NDArray[Any]:
    """Stored values to HU (PS3.3 C.7.6.3 and C.11.1); padding becomes air."""
    if raw.shape != item.shape:
        raise InputError(f"expected {item.shape} rows and columns in {item.path.name}, got {raw.shape}")
    slope, intercept = item.slope, item.intercept
    if dataset.get("PhotometricInterpretation") == "MONOCHROME1":
        # written for a display where the least value is white: GDCM, too, turns it over within the stored bits
        slope, intercept = -slope, intercept + slope * _stored_range_sum(dataset)
    ends = [int(end) * slope + intercept for end in (raw.min(), raw.max())]
    if slope.is_integer() and intercept.is_integer() and min(ends) >= -32768 and max(ends) <= 32767:
        # modulo 2^16 throughout, which does not matter to results that are within
        factor, offset = np.array([slope, intercept]).astype(np.int64).astype(np.int16)
        hu: NDArray[Any] = raw.astype(np.int16)
        hu *= factor
        hu += offset
    else:
        hu = (raw * slope + intercept).astype(np.float32)
    padding = _padding_mask(raw, dataset)
    if padding is not None:
        hu[padding] = AIR_HU
    return hu


def _stored_range_sum(dataset: Dataset) -> int:
    """Least plus greatest stored value."""
    return -1 if dataset.PixelRepresentation == 1 else int(2 ** int(dataset.BitsStored)) - 1


def _padding_mask(raw: NDArray[Any], dataset: Dataset) -> NDArray[np.bool_] | None:
    """Where stored values lie in the padding range (PS3.3 C.7.5.1.1.2); None where there is none."""
    value = dataset.get("PixelPaddingValue")
    if not isinstance(value, int):
        return None
    limit = dataset.get("PixelPaddingRangeLimit")
    ends = [_as_stored(v, dataset) for v in (value, limit if isinstance(limit, int) else value)]
    return np.asarray((raw >= min(ends)) & (raw <= max(ends)))


def _as_stored(value: int, dataset: Dataset) -> int:
    """Read a value written with the other signedness, a common fault of scanners."""
    whole: int = 2 ** int(dataset.BitsAllocated)
    if dataset.PixelRepresentation == 1 and value >= whole // 2:
        return value - whole
    return value + whole if dataset.PixelRepresentation == 0 and value < 0 else value


def _drop_doubles(slices: list[Slice], hu: NDArray[Any], found: list[str]) -> tuple[list[Slice], NDArray[Any]]:
    """Leave out slices that repeat the one before them in place and in every pixel."""
    along = _along(slices)
    doubled = np.flatnonzero(np.diff(along) < SAME_PLACE_MM)
    for k in doubled:
        if not np.array_equal(hu[k], hu[k + 1]):
            raise InputError(
                f"expected one image at each position, got different ones at {along[k]:.4g} mm "
                f"({_image_name(slices[k])}, {_image_name(slices[k + 1])}): "
                + (difference(slices[k].traits, slices[k + 1].traits) or "keep one phase of the series")
            )
    if not len(doubled):
        return slices, hu
    found.append(f"left out {len(doubled)} slices that are there twice")
    kept = np.setdiff1d(np.arange(len(slices)), doubled + 1)
    return [slices[k] for k in kept], hu[kept]


def _along(slices: Sequence[Slice]) -> Floats:
    """(n,) position of each slice along the common normal, mm."""
    normal = slices[0].normal
    return np.array([item.position @ normal for item in slices])


def _place(
    slices: Sequence[Slice], hu: NDArray[Any], allow_gaps: bool, found: list[str]
) -> tuple[NDArray[Any], Floats]:
    """Even spacing, and the affine from the positions themselves: a tilt shows in the step from slice to slice."""
    first, last = slices[0], slices[-1]
    along = _along(slices)
    if len(slices) > 1:
        _check_line(slices, along)
        holes = missing_slices(along)
        if holes and not allow_gaps:
            raise InputError(_describe_holes(slices, along, holes))
        if holes or not is_uniform(along):
            target = uniform_positions(along)
            step = float(target[1] - target[0])
            why = f"filled {len(holes)} gaps by interpolation" if holes else "slices are not evenly spaced"
            found.append(f"{why}: {describe_spacings(along)} resampled to {len(target)} slices {step:.4g} mm apart")
            hu = resample_slices(hu, along, target)
    affine = np.eye(4)
    affine[:3, 0] = first.along_row * first.spacing_mm[0]
    affine[:3, 1] = first.along_column * first.spacing_mm[1]
    steps = len(hu) - 1
    affine[:3, 2] = (last.position - first.position) / steps if steps else first.normal * first.thickness_mm
    affine[:3, 3] = first.position
    return hu, affine


def _check_line(slices: Sequence[Slice], along: Floats) -> None:
    """Raise where slices are shifted in their plane against each other by other than a steady tilt."""
    positions = np.array([item.position for item in slices])
    share = (along - along[0]) / (along[-1] - along[0])
    off = np.linalg.norm(positions - positions[0] - share[:, None] * (positions[-1] - positions[0]), axis=1)
    if off.max() > 0.5 * min(slices[0].spacing_mm):
        worst = int(off.argmax())
        raise InputError(
            f"expected slices in one line, got {slices[worst].path.name} {off[worst]:.3g} mm beside it: "
            "the images were reconstructed around different centres"
        )


def _describe_holes(slices: Sequence[Slice], along: Floats, holes: Sequence[int]) -> str:
    step = float(np.median(np.diff(along)))
    places = "; ".join(
        f"{round((along[k + 1] - along[k]) / step) - 1 or 1} between {_place_name(slices[k])} "
        f"and {_place_name(slices[k + 1])}"
        for k in holes[:3]
    )
    more = f" and at {len(holes) - 3} more places" if len(holes) > 3 else ""
    return (
        f"expected slices {step:.4g} mm apart, got missing slices: {places}{more}; "
        "find them or allow gaps to fill them by interpolation (--allow-gaps)"
    )


def _place_name(item: Slice) -> str:
    x, y, z = item.position
    return f"({x:.1f}, {y:.1f}, {z:.1f}) mm [{_image_name(item)}]"


def _image_name(item: Slice) -> str:
    return item.path.name if item.n_frames == 1 else f"frame {item.frame + 1} of {item.path.name}"
