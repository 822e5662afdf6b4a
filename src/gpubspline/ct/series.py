"""Which files of a folder are one CT series."""

import struct
from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pydicom
from pydicom.dataset import Dataset
from pydicom.errors import BytesLengthException, InvalidDicomError
from pydicom.uid import CTImageStorage, EnhancedCTImageStorage, LegacyConvertedEnhancedCTImageStorage

from gpubspline.ct.traits import KEYWORDS, Choice, traits_of
from gpubspline.errors import InputError

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
    "RescaleType",
    "ModalityLUTSequence",
    "SharedFunctionalGroupsSequence",
    "PerFrameFunctionalGroupsSequence",
    "MultienergyCTCharacteristicsSequence",
    "RealWorldValueMappingSequence",
    *(keyword for keywords in KEYWORDS.values() for keyword in keywords),
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

    def may_be(self, choice: Choice) -> bool:
        """Whether an image of the traits that are chosen may be in the file; frames have theirs each."""
        return self.n_frames > 1 or choice.takes(traits_of(self.dataset.get))


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


def choose_series(
    headers: Sequence[Header], choice: Choice | None = None, told: list[str] | None = None
) -> list[Header]:
    """Take the CT series of the most images, or the one with the given SeriesInstanceUID, of the traits chosen.

    Others that may have been meant, such as another reconstruction, are told in words in ``told``, without their UIDs.

    Raises InputError where no series is CT, saying what came, or where none has the UID, naming those that are there.
    """
    groups: dict[tuple[str, str], list[Header]] = defaultdict(list)
    choice = choice or Choice()
    wanted = [header for header in headers if header.may_be(choice)] if choice.traits else []
    for header in wanted or headers:  # that none is of the traits is told of later
        groups[header.series, header.modality].append(header)
    if choice.uid is not None:
        return _named_series(groups, choice.uid)
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
        there = ", ".join(
            f"{uid or '(empty)'} ({modality}, {len(g)} files{_kernels(g)})" for (uid, modality), g in groups.items()
        )
        raise InputError(f"expected a series among {there}, got {series}")
    for modality, group in chosen:
        if modality == "CT":
            return group
    raise InputError(f"expected a CT series, got {series}, which is {chosen[0][0]}")


def _kernels(group: Sequence[Header]) -> str:
    known = sorted({traits_of(header.dataset.get).get("kernel", "") for header in group} - {""})
    return f", kernel {', '.join(known)}" if known else ""


def _line(error: BaseException) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0]
