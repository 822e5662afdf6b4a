"""Where each image of a DICOM series lies, and what makes HU of its stored values."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydicom.dataset import Dataset

from gpubspline.ct.series import Header
from gpubspline.ct.traits import Choice, Traits, check_one_reconstruction, multi_energy_words, traits_of
from gpubspline.errors import InputError

Floats = NDArray[np.float64]


_HU_TYPES = {"HU", "HU_MOD", "US"}
"""Rescale types (PS3.3 C.11.1.1.2) of HU, of HU that were modified, and of what nobody says, as old scanners wrote."""


@dataclass(frozen=True)
class Slice:
    """One image of a series and its place.

    Attributes
    ----------
    path, frame, n_frames: the file, the image's number in it, from 0, and how many it has.
    shape: rows and columns.
    position: (3,) centre of the first pixel, LPS mm (PS3.3 C.7.6.2.1.1).
    along_row, along_column: (3,) unit vectors in which the column index i and the row index j grow.
    spacing_mm: distance between neighbouring pixels along i and j.
    thickness_mm: spacing between slices as stated, else the slice thickness, else 1.
    slope, intercept: from stored values to HU (PS3.3 C.11.1).
    frame_of_reference: UID, empty where there is none (PS3.3 C.7.4.1).
    traits: kernel, voltage and what else images of one series may differ by.
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
    n_frames: int = 1
    traits: Traits = field(default_factory=dict)

    @property
    def normal(self) -> Floats:
        """(3,) unit normal of the image plane, right-handed with i and j."""
        return np.cross(self.along_row, self.along_column)


def slices_of(headers: Sequence[Header], left_out: list[str], choice: Choice | None = None) -> list[Slice]:
    """Describe every image of a series but its localisers, sorted by position along the common normal.

    What is left out, or not known, is told in words in ``left_out``. Of a choice with traits only its images are there.

    Raises InputError where images have no place or differ in size, pixel spacing or orientation, are of several
    reconstructions of one place, or none is of the choice.
    """
    slices: list[Slice] = []
    localisers = bare = 0
    types, others = set[str](), Counter[str]()
    for header in headers:
        for frame in range(header.n_frames):
            groups = _functional_groups(header, frame)
            if "LOCALIZER" in _image_type(groups):
                localisers += 1
                continue
            traits = traits_of(partial(_attribute, groups))
            if choice is None or choice.takes(traits):
                slices.append(replace(_slice(header, frame, groups), traits=traits))
                bare += _attribute(groups, "RescaleIntercept") is None
                types.add(_unit(groups))
            else:
                others[" ".join(f"{name} {traits.get(name, '-')}" for name in choice.traits)] += 1
    if others and not slices and choice is not None:
        there = ", ".join(f"{words} ({count})" for words, count in sorted(others.items()))
        raise InputError(f"expected images of {choice.words} in the series, got {there}")
    if not slices:
        raise InputError(f"expected CT slices, got a series of {localisers} localisers: choose another series")
    if localisers:
        left_out.append(f"left out {localisers} localiser images of the series")
    if bare:  # what scanners store is often HU + 1024
        left_out.append(f"no rescale intercept in {bare} of {len(slices)} images: stored values are taken for HU")
    if types - _HU_TYPES:  # such as maps of iodine or of electron density, of spectral scanners
        units = ", ".join(sorted(types - _HU_TYPES))
        left_out.append(f"the series is rescaled to {units}, not to HU: its values are taken for HU")
    left_out += multi_energy_words([item.traits for item in slices])
    slices = _one_orientation(slices, left_out)
    _check_one("size", [f"{s.shape[1]}x{s.shape[0]}" for s in slices])
    _check_one("pixel spacing", [f"{s.spacing_mm[0]:.4g}x{s.spacing_mm[1]:.4g} mm" for s in slices])
    along = np.array([item.position @ slices[0].normal for item in slices])
    check_one_reconstruction(along, [item.traits for item in slices], left_out)
    return [slices[n] for n in np.argsort(along, kind="stable")]


def _functional_groups(header: Header, frame: int) -> list[Dataset]:
    """Where an attribute of one frame may stand: its own groups, the shared ones, the data set (PS3.3 C.7.6.16)."""
    dataset = header.dataset
    if header.n_frames == 1 and "PerFrameFunctionalGroupsSequence" not in dataset:
        return [dataset, *(dataset.get("MultienergyCTCharacteristicsSequence") or [])[:1]]
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


def _unit(groups: Sequence[Dataset]) -> str:
    """What stored values are rescaled to, or else what their real-world values are (PS3.3 C.7.6.16.2.11)."""
    named = _attribute(groups, "RescaleType")
    mapped = _attribute(groups, "RealWorldValueMappingSequence")
    for mapping in [*(mapped or []), *groups] if named is None else []:
        for code in mapping.get("MeasurementUnitsCodeSequence") or []:
            value = str(code.get("CodeValue") or "")
            return "HU" if "hnsf" in value.lower() else value
    return str(named or "HU").upper()


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
        n_frames=header.n_frames,
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
