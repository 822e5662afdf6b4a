"""By what images of one DICOM series differ beside their place: two reconstructions, energies, phases under one UID.

Where the images of one kind lie between or on those of another, reading them together gives a volume whose every other
slice is of another kernel. dcm2niix (1.0.20260724) asks for no kernel: by instance numbers it leaves the second kind
out, or takes it for a fourth dimension. Here one of them has to be chosen.
"""

import re
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydicom.errors import BytesLengthException

from gpubspline.errors import InputError

Traits = Mapping[str, str]

KEYWORDS = {
    "kernel": ("ConvolutionKernel",),
    "kV": ("KVP",),
    "keV": ("MonoenergeticEnergyEquivalent",),
    "units": ("RescaleType",),
    "type": ("FrameType", "ImageType"),
    "acquisition": ("FrameAcquisitionNumber", "AcquisitionNumber"),
    "time": ("TemporalPositionIndex", "TemporalPositionIdentifier"),
    "phase": ("NominalPercentageOfCardiacPhase",),
    "stack": ("StackID",),
}
"""Traits by the name that ``--series`` takes, and the attributes that have them (PS3.3 C.8.2, C.8.15, C.7.6.16)."""

RECONSTRUCTION = ("kernel", "kV", "keV", "units")
"""Traits of which a body has one; the others differ from slice to slice of many a good series."""

NOT_HU = {
    "EFF_ATOMIC_NUM": "effective atomic numbers",
    "ELECTRON_DENSITY": "electron densities",
    "MAT_SPECIFIC": "one material's share",
}
"""Fourth values of the image type (PS3.3 C.8.2.1.1.1) whose samples are no CT's HU."""

SAME_PLACE_MM = 0.01
"""CT slices are 0.1 mm apart at the least."""


def traits_of(attribute: Callable[[str], Any]) -> dict[str, str]:
    """Traits of an image that has them; several values of one are parted by ``/``.

    A value that breaks the standard's rules is none: no scan is refused for one that nothing needs.
    """
    found: dict[str, str] = {}
    for name, keywords in KEYWORDS.items():
        for keyword in keywords:
            with suppress(BytesLengthException, KeyError, NotImplementedError, OverflowError, TypeError, ValueError):
                value = attribute(keyword)
                if value not in (None, ""):
                    parts = [value] if isinstance(value, str | int | float) else list(value)
                    words = (f"{part:g}" if isinstance(part, float) else str(part).strip() for part in parts)
                    found.setdefault(name, "/".join(words))
    return found


@dataclass(frozen=True)
class Choice:
    """What is to be read of a folder.

    Attributes
    ----------
    uid: SeriesInstanceUID, or None for the largest CT series.
    traits: values that its images must have: a whole one, or one of its parts.
    """

    uid: str | None = None
    traits: Traits = field(default_factory=dict)

    def takes(self, traits: Traits) -> bool:
        """Whether an image of these traits is among it."""

        def same(name: str, wanted: str) -> bool:
            value = traits.get(name, "").casefold()
            return wanted.casefold().replace("\\", "/") in (value, *value.split("/"))

        return all(same(name, wanted) for name, wanted in self.traits.items())

    @property
    def words(self) -> str:
        """As ``--series`` takes the traits."""
        return ",".join(f"{name}={value}" for name, value in self.traits.items())


def parse_choice(series: str | None) -> Choice:
    """Read ``UID``, ``kernel=B30f`` or both, with commas between.

    Raises InputError for a trait that is none of ``KEYWORDS``.
    """
    uid, traits = None, {}
    for part in (series or "").split(","):
        name, given, value = part.strip().partition("=")
        if not given:
            uid = name or uid
        elif name not in KEYWORDS or not value:
            raise InputError(f"expected a series by its UID or by one of {', '.join(KEYWORDS)}=VALUE, got {part!r}")
        else:
            traits[name] = value
    return Choice(uid, traits)


def check_one_reconstruction(along_mm: NDArray[np.float64], traits: Sequence[Traits], told: list[str]) -> None:
    """Raise InputError where images of unlike kernels, voltages, energies or units lie at one place or interleaved.

    Those that follow each other, as of a neck below a head, are one volume, which ``told`` says.

    Arguments
    ---------
    along_mm: (n,) position of each image along the common normal.
    """
    for name in RECONSTRUCTION:
        kinds: dict[str, list[float]] = defaultdict(list)
        for at, each in zip(along_mm, traits, strict=True):
            kinds[each.get(name, "")].append(float(at))
        if len(kinds) < 2:
            continue
        counts = " and ".join(f"{value or 'none'} ({len(at)} images)" for value, at in sorted(kinds.items()))
        if any(_overlap(one, other) for one, other in combinations(map(np.array, kinds.values()), 2)):
            most = min(kinds, key=lambda value: (-len(kinds[value]), value))
            raise InputError(
                f"expected one reconstruction in the series, got {len(kinds)} of one place, {name} {counts}: "
                f"--series {name}={most} reads one of them"
            )
        told.append(
            f"the series is of several reconstructions that follow each other, {name} {counts}: read as one volume"
        )


def _overlap(one: NDArray[np.float64], other: NDArray[np.float64]) -> bool:
    """Whether positions coincide, or lie between each other along more than half of the shorter stack."""
    if np.abs(one[:, None] - other).min() < SAME_PLACE_MM:
        return True
    shared = min(one.max(), other.max()) - max(one.min(), other.min())
    return bool(shared > 0.5 * min(np.ptp(one), np.ptp(other)) > 0)


def difference(one: Traits, other: Traits) -> str:
    """By what two images of one place differ, and how to read one of them; empty where nothing tells them apart."""
    for name in KEYWORDS:
        if one.get(name) != other.get(name):
            values = [value for value in (one.get(name), other.get(name)) if value]
            return f"{name} {' and '.join(values)}: --series {name}={values[0]} reads one"
    return ""


def multi_energy_words(traits: Sequence[Traits]) -> list[str]:
    """What a spectral scanner's images are, where they are not HU of a tube's beam (PS3.17 JJJJ.4)."""
    types = {word for each in traits for word in re.split("[/ ]", each.get("type", "").upper())}
    words = [
        f"the image type {word} says that values are {NOT_HU[word]}, not HU: they are taken for HU"
        for word in sorted(types & NOT_HU.keys())
    ]
    changed = sorted(word for word in types - NOT_HU.keys() if word.startswith("MAT_"))
    if changed:
        words.append(f"the image type {', '.join(changed)} says that HU were changed for a material, bone's maybe")
    energies = sorted({each["keV"] for each in traits if "keV" in each})
    if energies or "VMI" in types:
        at = f" at {', '.join(energies)} keV" if energies else ""
        words.append(
            f"virtual monoenergetic images{at}: bone has other HU than in a tube's beam, of which published lines from "
            "HU to density are: calibrate (--calibration)"
        )
    return words
