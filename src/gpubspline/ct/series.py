"""Which files of a folder are one CT series, and where each of its slices lies."""

import struct
from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pydicom
from numpy.typing import NDArray
from pydicom.dataset import Dataset
from pydicom.errors import BytesLengthException, InvalidDicomError
from pydicom.uid import CTImageStorage, EnhancedCTImageStorage, LegacyConvertedEnhancedCTImageStorage

from gpubspline.errors import InputError

Floats = NDArray[np.float64]

UNREADABLE = (
    AttributeError,
    BytesLengthException,
    EOFError,
    InvalidDicomError,
    KeyError,
    MemoryError,
    NotImplementedError,
    OSError,
    RuntimeError,
    TypeError,
    ValueError,
    struct.error,
)
"""What pydicom and its decoders raise for damaged files."""

_CT_CLASSES = (CTImageStorage, EnhancedCTImageStorage, LegacyConvertedEnhancedCTImageStorage)
SCOUTS = 3
"""Images of a series that is not taken, up to which it is a localiser's or a report's and not worth a word."""

_DIRECTORY_CLASS = "1.2.840.10008.1.3.10"
_TAGS: list[Any] = [
    "SOPClassUID",
    "Modality",
    "SeriesInstanceUID",
    "FrameOfReferenceUID",
    "ImageType",
    "Rows",
    "Columns",
    "SamplesPerPixel",
    "NumberOfFrames",
    "ImagePositionPatient",
    "ImageOrientationPatient",
    "PixelSpacing",
    "SliceThickness",
    "SpacingBetweenSlices",
    "RescaleSlope",
    "RescaleIntercept",
    "ModalityLUTSequence",
    "SharedFunctionalGroupsSequence",
    "PerFrameFunctionalGroupsSequence",
]


@dataclass(frozen=True)
class Header:
    """One DICOM image file without its pixels."""

    path: Path
    dataset: Dataset

    @property
    def series(self) -> str:
        """SeriesInstanceUID, empty where there is none."""
        return str(self.dataset.get("SeriesInstanceUID") or "")

    @property
    def modality(self) -> str:
        """Modality; where that is missing, CT by the SOP class."""
        named = str(self.dataset.get("Modality") or "")
        return named or ("CT" if _sop_class(self.dataset) in _CT_CLASSES else "unknown modality")

    @property
    def n_frames(self) -> int:
        """Images in the file."""
        return int(self.dataset.get("NumberOfFrames") or 1)


@dataclass(frozen=True)
class Slice:
    """One image of a series and its place.

    Attributes
    ----------
    path, frame: the file and the image's number in it, from 0.
    shape: rows and columns.
    position: (3,) centre of the first pixel, LPS mm (PS3.3 C.7.6.2.1.1).
    along_row, along_column: (3,) unit vectors in which the column index i and the row index j grow.
    spacing_mm: distance between neighbouring pixels along i and j.
    thickness_mm: spacing between slices as stated, else the slice thickness, else 1.
    slope, intercept: from stored values to HU (PS3.3 C.11.1).
    frame_of_reference: UID, empty where there is none (PS3.3 C.7.4.1).
    """

    path: Path
    frame: int
    shape: tuple[int, int]
    position: Floats
    along_row: Floats
    along_column: Floats
    spacing_mm: tuple[float, float]
    thickness_mm: float
    slope: float
    intercept: float
    frame_of_reference: str = ""

    @property
    def normal(self) -> Floats:
        """(3,) unit normal of the image plane, right-handed with i and j."""
        return np.cross(self.along_row, self.along_column)


def _sop_class(dataset: Dataset) -> str:
    meta = getattr(dataset, "file_meta", None)
    return str(dataset.get("SOPClassUID") or (meta.get("MediaStorageSOPClassUID") if meta else None) or "")


def is_dicom(path: Path) -> bool:
    """Whether the file begins like DICOM: the prefix of PS3.10, or a bare data set of group 0002 or 0008."""
    try:
        with path.open("rb") as file:
            start = file.read(132)
    except OSError as error:
        raise InputError(f"cannot open {path.name}: {error.strerror}") from None
    named = start[4:6].isalpha() and start[4:6].isupper()  # a value representation, or the length of a short value
    bare = start[:2] in (b"\2\0", b"\x08\0") and start[3:4] == b"\0" and (named or start[5:8] == b"\0\0\0")
    return start[128:] == b"DICM" or bare


def read_header(path: Path) -> Header | None:
    """Read what sorts an image; None for DICOM objects that are no images (reports, directories, plans).

    Raises InputError where the file ends before its image description.
    """
    try:
        dataset = pydicom.dcmread(path, stop_before_pixels=True, force=True, specific_tags=_TAGS)
        kind = _sop_class(dataset)
        described = bool(dataset.get("Rows")) and bool(dataset.get("Columns"))
    except UNREADABLE as error:
        raise InputError(f"expected a DICOM image, got {path.name}, which is damaged: {_line(error)}") from None
    if described:
        return Header(path, dataset)
    if kind == _DIRECTORY_CLASS or (kind and kind not in _CT_CLASSES):
        return None
    raise InputError(f"expected a DICOM image, got {path.name}, which ends before its image size: copy it again")


def read_headers(paths: Sequence[Path]) -> list[Header]:
    """Read every image header of files and leave out what is not DICOM, unless it is named ``.dcm``.

    Raises InputError where no DICOM image is among the files or one of them is damaged.
    """
    headers = []
    for path in paths:
        if not is_dicom(path):
            if path.suffix.lower() in (".dcm", ".ima"):
                raise InputError(f"expected DICOM in {path.name}, got {path.stat().st_size} bytes that are not DICOM")
            continue
        header = read_header(path)
        if header is not None:
            headers.append(header)
    if not headers:
        raise InputError(f"expected DICOM images, got {len(paths)} files of which none is one")
    return headers


def choose_series(headers: Iterable[Header], series: str | None = None, told: list[str] | None = None) -> list[Header]:
    """Take the CT series of the most images, or the one with the given SeriesInstanceUID.

    Others that may have been meant, such as another reconstruction, are told in words in ``told``, without their UIDs.

    Raises InputError where no series is CT, saying what came, or where none has the UID, naming those that are there.
    """
    groups: dict[tuple[str, str], list[Header]] = defaultdict(list)
    for header in headers:
        groups[header.series, header.modality].append(header)
    if series is not None:
        return _named_series(groups, series)
    sizes = {key: sum(h.n_frames for h in group) for key, group in groups.items()}
    ct = [key for key in groups if key[1] == "CT"]
    if not ct:
        came = Counter[str]()
        for (_, modality), size in sizes.items():
            came[modality] += size
        words = ", ".join(f"{modality} ({size} images)" for modality, size in sorted(came.items()))
        raise InputError(f"expected a CT series, got {len(groups)} series of {words}")
    chosen = max(sorted(ct), key=lambda key: sizes[key])
    others = sorted((sizes[key] for key in ct if key != chosen and sizes[key] > SCOUTS), reverse=True)
    if others and told is not None:
        words = ", ".join(map(str, others))
        told.append(
            f"the CT series of {sizes[chosen]} images is taken, beside others of {words}: --series UID takes another, "
            "--series list names them"
        )
    return groups[chosen]


def _named_series(groups: dict[tuple[str, str], list[Header]], series: str) -> list[Header]:
    chosen = [(modality, group) for (uid, modality), group in groups.items() if uid == series]
    if not chosen:
        there = ", ".join(f"{uid or '(empty)'} ({modality}, {len(g)} files)" for (uid, modality), g in groups.items())
        raise InputError(f"expected a series among {there}, got {series}")
    for modality, group in chosen:
        if modality == "CT":
            return group
    raise InputError(f"expected a CT series, got {series}, which is {chosen[0][0]}")


def slices_of(headers: Sequence[Header], left_out: list[str]) -> list[Slice]:
    """Describe every image of a series but its localisers, sorted by position along the common normal.

    What is left out, or not known, is told in words in ``left_out``.

    Raises InputError where images have no place or differ in size, pixel spacing or orientation.
    """
    slices: list[Slice] = []
    localisers = bare = 0
    for header in headers:
        for frame in range(header.n_frames):
            groups = _functional_groups(header, frame)
            if "LOCALIZER" in _image_type(groups):
                localisers += 1
            else:
                slices.append(_slice(header, frame, groups))
                bare += _attribute(groups, "RescaleIntercept") is None
    if not slices:
        raise InputError(f"expected CT slices, got a series of {localisers} localisers: choose another series")
    if localisers:
        left_out.append(f"left out {localisers} localiser images of the series")
    if bare:  # what scanners store is often HU + 1024
        left_out.append(f"no rescale intercept in {bare} of {len(slices)} images: stored values are taken for HU")
    slices = _one_orientation(slices, left_out)
    _check_one("size", [f"{s.shape[1]}x{s.shape[0]}" for s in slices])
    _check_one("pixel spacing", [f"{s.spacing_mm[0]:.4g}x{s.spacing_mm[1]:.4g} mm" for s in slices])
    normal = slices[0].normal
    return sorted(slices, key=lambda s: float(s.position @ normal))


def _functional_groups(header: Header, frame: int) -> list[Dataset]:
    """Where an attribute of one frame may stand: its own groups, the shared ones, the data set (PS3.3 C.7.6.16)."""
    dataset = header.dataset
    if header.n_frames == 1 and "PerFrameFunctionalGroupsSequence" not in dataset:
        return [dataset]
    own = dataset.get("PerFrameFunctionalGroupsSequence") or []
    if len(own) != header.n_frames:
        raise InputError(
            f"expected the place of each of {header.n_frames} frames in {header.path.name}, got {len(own)}: "
            "only Enhanced CT multi-frame files carry it"
        )
    shared = dataset.get("SharedFunctionalGroupsSequence") or [Dataset()]
    macros = [
        macro.value[0] for group in (own[frame], shared[0]) for macro in group if macro.VR == "SQ" and macro.value
    ]
    return [*macros, dataset]


def _attribute(groups: Sequence[Dataset], keyword: str) -> Any:
    for group in groups:
        value = group.get(keyword)
        if value is not None and value != "":
            return value
    return None


def _image_type(groups: Sequence[Dataset]) -> set[str]:
    kinds = [_attribute(groups, "FrameType"), _attribute(groups, "ImageType")]
    return {str(word).upper() for kind in kinds if kind for word in ([kind] if isinstance(kind, str) else kind)}


def _numbers(header: Header, groups: Sequence[Dataset], keyword: str, count: int) -> Floats:
    value = _attribute(groups, keyword)
    try:
        numbers = np.array(value, dtype=np.float64).reshape(-1)
    except (TypeError, ValueError):
        numbers = np.empty(0)
    if len(numbers) != count or not np.isfinite(numbers).all():
        raise InputError(f"expected {count} numbers of {keyword} in {header.path.name}, got {value!s:.40}")
    return numbers


def _slice(header: Header, frame: int, groups: Sequence[Dataset]) -> Slice:
    dataset, name = header.dataset, header.path.name
    if int(dataset.get("SamplesPerPixel") or 1) != 1:
        raise InputError(f"expected one HU sample a pixel, got the colour image {name}")
    if dataset.get("ModalityLUTSequence"):
        raise InputError(f"expected a rescale slope and intercept in {name}, got a modality look-up table")
    cosines = _numbers(header, groups, "ImageOrientationPatient", 6).reshape(2, 3)
    lengths = np.linalg.norm(cosines, axis=1)
    if np.any(lengths < 0.9) or abs(cosines[0] @ cosines[1]) > 1e-2:
        raise InputError(
            f"expected orthogonal unit vectors of ImageOrientationPatient in {name}, got {cosines.tolist()}"
        )
    along_row, along_column = cosines / lengths[:, None]
    rows_mm, columns_mm = _numbers(header, groups, "PixelSpacing", 2)
    slope = 1.0 if _attribute(groups, "RescaleSlope") is None else float(_numbers(header, groups, "RescaleSlope", 1)[0])
    intercept = _attribute(groups, "RescaleIntercept")
    if slope == 0 or min(rows_mm, columns_mm) <= 0:
        raise InputError(f"expected a positive pixel spacing and a rescale slope in {name}, got zero")
    return Slice(
        path=header.path,
        frame=frame,
        shape=(int(dataset.Rows), int(dataset.Columns)),
        position=_numbers(header, groups, "ImagePositionPatient", 3),
        along_row=along_row,
        along_column=along_column,
        spacing_mm=(float(columns_mm), float(rows_mm)),
        thickness_mm=_thickness(groups),
        slope=slope,
        intercept=0.0 if intercept is None else float(_numbers(header, groups, "RescaleIntercept", 1)[0]),
        frame_of_reference=str(dataset.get("FrameOfReferenceUID") or ""),
    )


def _thickness(groups: Sequence[Dataset]) -> float:
    for keyword in ("SpacingBetweenSlices", "SliceThickness"):
        try:
            value = float(_attribute(groups, keyword))
        except (TypeError, ValueError):
            continue
        if np.isfinite(value) and value > 0:
            return value
    return 1.0


def _one_orientation(slices: list[Slice], left_out: list[str]) -> list[Slice]:
    """Keep the orientation of the most images; a few others are localisers that do not say so."""
    planes: list[list[Slice]] = []
    for item in slices:
        for plane in planes:
            if np.allclose(item.along_row, plane[0].along_row, atol=1e-3) and np.allclose(
                item.along_column, plane[0].along_column, atol=1e-3
            ):
                plane.append(item)
                break
        else:
            planes.append([item])
    planes.sort(key=len, reverse=True)
    others = len(slices) - len(planes[0])
    if others > max(2, len(slices) // 10) or others >= len(planes[0]):
        counts = ", ".join(str(len(plane)) for plane in planes)
        raise InputError(f"expected slices of one orientation, got {len(planes)} orientations of {counts} images")
    if others:
        left_out.append(f"left out {others} images that lie across the other {len(planes[0])}")
    return planes[0]


def _check_one(what: str, values: Sequence[str]) -> None:
    counts = Counter(values)
    if len(counts) > 1:
        words = ", ".join(f"{count} of {value}" for value, count in counts.most_common(4))
        raise InputError(f"expected images of one {what} in the series, got {words}")


def _line(error: BaseException) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0]
