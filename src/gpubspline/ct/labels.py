"""The labels of a segmentation on a volume's grid, read one by one, and how another grid is laid on that one."""

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.ct.volume import Volume
from gpubspline.errors import GpubsplineWarning, InputError
from gpubspline.shown import brief

PLACE_TOLERANCE = 0.1
"""Greatest distance of a mask's corner from the volume's, in the smallest voxel edge: files round their matrices."""


MOST_LABELS = 255
"""Different whole numbers from 0 on that an image of labels has at most; a CT has more, or values below 0."""


@dataclass(frozen=True, eq=False)
class Segment:
    """What is inside.

    Attributes
    ----------
    inside: (n_k, n_j, n_i) bool, at voxel centres.
    coverage: (n_k, n_j, n_i) float32, part of each voxel that is inside, 0 to 1, where the format tells more than
        ``inside``; else None.
    """

    inside: NDArray[np.bool_]
    coverage: NDArray[np.float32] | None = None

    __repr__ = brief


@dataclass(frozen=True, eq=False)
class Labels:
    """The labels of a file.

    Attributes
    ----------
    source: name of the file.
    names: of each label that has a voxel or a contour, by its number; empty where the file gives none.
    read: gives the segment of a number.
    read_all: gives that of all labels together, where there is a shorter way than one after another.
    """

    source: str
    names: dict[int, str]
    read: Callable[[int], Segment]
    read_all: Callable[[], Segment] | None = None

    __repr__ = brief

    def number(self, label: int | str) -> int:
        """Number of a label by its number or name, the case of letters aside.

        Raises InputError where there is none, naming those that are there.
        """
        wanted = str(label).strip()
        if wanted.lstrip("-").isdecimal() and int(wanted) in self.names:
            return int(wanted)
        found = [number for number, name in self.names.items() if name and name.lower() == wanted.lower()]
        if len(found) > 1:
            numbers = ", ".join(map(str, found))
            raise InputError(f"expected one label of the name {wanted!r} in {self.source}, got the numbers {numbers}")
        if not found:
            raise InputError(f"expected one of the labels {self.shown()} of {self.source}, got {wanted}")
        return found[0]

    def segment(self, number: int) -> Segment:
        """Read a label.

        Raises InputError where nothing of it lies on the volume.
        """
        segment = self.read(number)
        if not segment.inside.any():
            raise InputError(f"expected voxels of the label {self.title(number)} of {self.source} on the CT, got none")
        return segment

    def all(self) -> Segment:
        """Read all labels together; raises InputError where there are none."""
        if not self.names:
            raise InputError(f"expected a mask, got {self.source}, in which every voxel is zero")
        found = self.read_all() if self.read_all else self._joined()
        if not found.inside.any():
            raise InputError(f"expected a mask, got {self.source}, which has no voxel on the CT")
        return found

    def _joined(self) -> Segment:
        segments = [self.read(number) for number in self.names]
        inside = np.logical_or.reduce([segment.inside for segment in segments])
        covered = [segment.coverage for segment in segments if segment.coverage is not None]
        return Segment(inside, np.maximum.reduce(covered) if len(covered) == len(segments) else None)

    def title(self, number: int) -> str:
        """Name of a label, or its number where it has none."""
        return self.names.get(number) or str(number)

    def shown(self) -> str:
        """List the labels in words."""
        words = [f"{number} ({name})" if name else str(number) for number, name in self.names.items()]
        return ", ".join(words[:40]) + (" and more" if len(words) > 40 else "")


def label_counts(values: NDArray[Any]) -> dict[int, int]:
    """Voxels of each number of what looks like an image of labels, 0 left out; empty where it looks like a CT."""
    if values.dtype.kind != "i" or values.min() < 0:
        return {}
    counts = np.zeros(int(values.max()) + 1, dtype=np.int64)
    for plane in values:  # at once NumPy would make eight bytes of each voxel
        counts += np.bincount(plane.ravel(), minlength=len(counts))
    found = {int(n): int(counts[n]) for n in np.flatnonzero(counts) if n}
    return found if counts[0] and len(found) <= MOST_LABELS else {}


def check_frame(frame: str | None, volume: Volume, source: str) -> None:
    """Raise InputError where a DICOM frame of reference is known not to be the volume's; warn where it is not known.

    Warns GpubsplineWarning where the volume, such as one converted to NIfTI, does not state its own.
    """
    if frame and not volume.frame_of_reference:
        words = f"{source} has a frame of reference and the CT states none: that they belong together was not checked"
        warnings.warn(words, GpubsplineWarning, stacklevel=4)
    if frame and volume.frame_of_reference and frame != volume.frame_of_reference:
        raise InputError(
            f"expected a mask in the CT's frame of reference {volume.frame_of_reference}, got {source} in {frame}: "
            "it belongs to another scan, or must be registered first"
        )


def lay_on(values: NDArray[Any], affine: NDArray[np.float64], volume: Volume, source: str) -> NDArray[Any]:
    """Lay samples of a part of the volume's grid on the whole of it, zeros elsewhere.

    Arguments
    ---------
    values: (k, j, i), on the volume's voxels; axes may run the other way or be exchanged.
    affine: (4, 4), index (i, j, k) to LPS mm.

    Raises
    ------
    InputError where the samples lie between the volume's voxels.
    """
    to_index = volume.inverse @ affine
    turn = np.rint(to_index[:3, :3]).astype(int)
    first = np.rint(to_index[:3, 3]).astype(int)
    whole = np.array_equal(np.abs(turn).sum(axis=0), [1, 1, 1]) and np.array_equal(np.abs(turn).sum(axis=1), [1, 1, 1])
    last = np.array(values.shape[::-1]) - 1
    corners = np.stack(np.meshgrid(*[(0, n) for n in last]), axis=-1).reshape(-1, 3)
    off = (corners @ (to_index[:3, :3] - turn).T + to_index[:3, 3] - first) @ volume.affine[:3, :3].T
    distance = float(np.linalg.norm(off, axis=1).max())
    if not whole or distance > PLACE_TOLERANCE * float(volume.spacing_mm.min()):
        raise InputError(
            f"expected a mask on the voxels of the CT (spacing {place(volume.spacing_mm)} mm), got {source} of spacing "
            f"{place(np.linalg.norm(affine[:3, :3], axis=0))} mm, up to {distance:.3g} mm beside them"
        )
    order = [int(np.flatnonzero(row)[0]) for row in turn]  # which of its axes runs along i, j, k of the volume
    along = np.transpose(values, [2 - order[axis] for axis in (2, 1, 0)])
    corner = first.copy()
    for axis, source_axis in enumerate(order):
        if turn[axis, source_axis] < 0:
            along = np.flip(along, 2 - axis)
            corner[axis] -= values.shape[2 - source_axis] - 1
    laid = np.zeros(volume.hu.shape, dtype=values.dtype)
    size = np.array(along.shape[::-1])
    low, high = np.clip(corner, 0, volume.shape), np.clip(corner + size, 0, volume.shape)
    into = tuple(slice(int(a), int(b)) for a, b in zip(low[::-1], high[::-1], strict=True))
    of = tuple(slice(int(a), int(b)) for a, b in zip((low - corner)[::-1], (high - corner)[::-1], strict=True))
    laid[into] = along[of]
    return laid


def place(numbers: NDArray[np.float64]) -> str:
    """Three numbers, or the origin of an affine, in words."""
    values = numbers[:3, 3] if numbers.ndim == 2 else numbers
    return "(" + ", ".join(f"{value:.4g}" for value in values) + ")"
