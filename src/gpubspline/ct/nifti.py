"""What ITK does not say about a NIfTI file: whether it is all there and finite, and whether its grid is sheared.

ITK fills what a truncated file lacks with zeros, makes NaN and infinity zero, and knows orthogonal grids only. A gantry
tilt makes an sform sheared.
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
        "datatype": (70, "h"),
        "bitpix": (72, "h"),
        "vox_offset": (108, "f"),
        "sform_code": (254, "h"),
        "srow": (280, "12f"),
    },
    540: {
        "dim": (16, "8q"),
        "datatype": (12, "h"),
        "bitpix": (14, "h"),
        "vox_offset": (168, "q"),
        "sform_code": (348, "i"),
        "srow": (400, "12d"),
    },
}
"""Offset and type of the fields of NIfTI-1 (nifti1.h) and NIfTI-2 (nifti2.h), by the size of their headers."""

_FLOATS = {16: "f4", 64: "f8"}
"""NumPy's names of the sample types that may be NaN or infinite (nifti1.h: DT_FLOAT32, DT_FLOAT64)."""

_BLOCK = 1 << 22


@dataclass(frozen=True)
class NiftiHeader:
    """The fields of a NIfTI header that are read here, under their names in nifti1.h."""

    byte_order: str
    dim: tuple[int, ...]
    datatype: int
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
    """Read the header of a ``.nii`` or ``.nii.gz`` file, count its bytes and look for samples that are not finite.

    Raises InputError where it has none, the file is shorter than it announces, or a sample is NaN or infinite.
    """
    try:
        with gzip.open(path) if path.name.lower().endswith(".gz") else path.open("rb") as file:
            header = _parse(file.read(540))
            file.seek(header.vox_offset)
            length, wild = _scan(file, header)
    except (EOFError, OSError, ValueError, OverflowError, zlib.error, struct.error) as error:
        raise InputError(f"cannot read {path.name} as NIfTI, it is damaged or truncated: {error}") from None
    if length < header.n_bytes:
        raise InputError(
            f"cannot read {path.name} as NIfTI: expected {header.n_bytes} bytes, got {length}; copy it again"
        )
    if wild:
        raise InputError(f"expected finite HU everywhere in {path.name}, got NaN or infinity in {wild} voxels")
    return header


def _parse(start: bytes) -> NiftiHeader:
    if len(start) < min(_LAYOUTS):
        raise ValueError(f"expected a header of {min(_LAYOUTS)} bytes, got a file of {len(start)}")
    for order in "<>":
        layout = _LAYOUTS.get(struct.unpack_from(f"{order}i", start)[0])
        if layout:
            fields = {name: struct.unpack_from(order + form, start, at) for name, (at, form) in layout.items()}
            return NiftiHeader(
                byte_order=order,
                dim=fields["dim"],
                datatype=int(fields["datatype"][0]),
                bitpix=int(fields["bitpix"][0]),
                vox_offset=int(fields["vox_offset"][0]),
                sform_code=int(fields["sform_code"][0]),
                srow=np.array(fields["srow"], dtype=np.float64).reshape(3, 4),
            )
    raise ValueError("no NIfTI header")


def _scan(file: BinaryIO | gzip.GzipFile, header: NiftiHeader) -> tuple[int, int]:
    """Length of the file, read from where its samples begin, and how many samples are NaN or infinite."""
    length, wild = header.vox_offset, 0
    kind = _FLOATS.get(header.datatype)
    while block := file.read(_BLOCK):
        samples = block[: max(header.n_bytes - length, 0)]
        length += len(block)
        if kind:
            values = np.frombuffer(samples, header.byte_order + kind, count=len(samples) // int(kind[1]))
            wild += int(np.count_nonzero(~np.isfinite(values)))
    return length, wild
