"""What ITK does not say about a NIfTI file: whether it is all there, and whether its grid is sheared.

ITK fills what a truncated file lacks with zeros, and knows orthogonal grids only. A gantry tilt makes an sform sheared.
"""

import gzip
import struct
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from gpubspline.errors import InputError

Floats = NDArray[np.float64]

_LAYOUTS = {
    348: {
        "dim": (40, "8h"),
        "bitpix": (72, "h"),
        "vox_offset": (108, "f"),
        "sform_code": (254, "h"),
        "srow": (280, "12f"),
    },
    540: {
        "dim": (16, "8q"),
        "bitpix": (14, "h"),
        "vox_offset": (168, "q"),
        "sform_code": (348, "i"),
        "srow": (400, "12d"),
    },
}
"""Offset and type of the fields of NIfTI-1 (nifti1.h) and NIfTI-2 (nifti2.h), by the size of their headers."""


@dataclass(frozen=True)
class NiftiHeader:
    """The fields of a NIfTI header that are read here, under their names in nifti1.h."""

    dim: tuple[int, ...]
    bitpix: int
    vox_offset: int
    sform_code: int
    srow: Floats

    @property
    def n_bytes(self) -> int:
        """Length of a whole file."""
        n_voxels = 1
        for size in self.dim[1 : 1 + min(max(self.dim[0], 0), 7)]:
            n_voxels *= max(size, 1)
        return self.vox_offset + n_voxels * self.bitpix // 8

    @property
    def sheared_affine(self) -> Floats | None:
        """(4, 4) index (i, j, k) to LPS mm where the sform is sheared; None where ITK can tell."""
        steps = self.srow[:, :3]
        lengths = np.linalg.norm(steps, axis=0)
        if self.sform_code <= 0 or not np.isfinite(self.srow).all() or lengths.min() <= 0:
            return None
        cosines = (steps / lengths).T @ (steps / lengths)
        if np.abs(cosines - np.eye(3)).max() < 1e-3:
            return None
        ras: Floats = np.vstack([self.srow, [0, 0, 0, 1]])
        return np.diag([-1.0, -1.0, 1.0, 1.0]) @ ras


def check_nifti(path: Path) -> NiftiHeader:
    """Read the header of a ``.nii`` or ``.nii.gz`` file and count its bytes.

    Raises InputError where it has none or the file is shorter than it announces.
    """
    try:
        with gzip.open(path) if path.name.lower().endswith(".gz") else path.open("rb") as file:
            start = file.read(540)
            header = _parse(start)
            length = len(start) + _count(file)
    except (EOFError, OSError, ValueError, OverflowError, zlib.error, struct.error) as error:
        raise InputError(f"cannot read {path.name} as NIfTI, it is damaged or truncated: {error}") from None
    if length < header.n_bytes:
        raise InputError(
            f"cannot read {path.name} as NIfTI: expected {header.n_bytes} bytes, got {length}; copy it again"
        )
    return header


def _parse(start: bytes) -> NiftiHeader:
    for order in "<>":
        layout = _LAYOUTS.get(struct.unpack_from(f"{order}i", start)[0])
        if layout:
            fields = {name: struct.unpack_from(order + form, start, at) for name, (at, form) in layout.items()}
            return NiftiHeader(
                dim=fields["dim"],
                bitpix=int(fields["bitpix"][0]),
                vox_offset=int(fields["vox_offset"][0]),
                sform_code=int(fields["sform_code"][0]),
                srow=np.array(fields["srow"], dtype=np.float64).reshape(3, 4),
            )
    raise ValueError("no NIfTI header")


def _count(file: BinaryIO | gzip.GzipFile) -> int:
    total = 0
    while block := file.read(1 << 22):
        total += len(block)
    return total
