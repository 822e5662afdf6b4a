"""The samples of a NIfTI file, or of a pair, in HU.

ITK, which reads the other images, knows no NIfTI-2, fills what a truncated file lacks with zeros, makes NaN and
infinity zero, and adds an intercept beside a slope of 0, where nifti1.h has neither.
"""

import struct
import zlib
from math import prod
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from gpubspline.ct.nifti import NiftiHeader, nifti_files, opened, parse_header
from gpubspline.errors import InputError

_TYPES = {
    2: "u1",
    4: "i2",
    8: "i4",
    16: "f4",
    64: "f8",
    256: "i1",
    512: "u2",
    768: "u4",
    1024: "i8",
    1280: "u8",
}
"""NumPy's names of the sample types that are one real number (nifti1.h: DT_UINT8 to DT_UINT64)."""

_OTHERS = {1: "bits", 32: "complex", 128: "RGB", 1536: "128-bit", 1792: "complex", 2048: "complex", 2304: "RGBA"}
"""Those that are not read."""

_BLOCK = 1 << 22


def read_nifti(path: Path) -> tuple[NDArray[Any], NiftiHeader]:
    """Read a ``.nii`` file or a pair, of NIfTI-1, NIfTI-2 or Analyze, compressed or not.

    Returns: samples (k, j, i), of the file's type or, where they are scaled, int32 or float32, and the header.

    Raises
    ------
    InputError where it has no header, a file is missing or shorter than announced, a sample is NaN or infinite, or they
    are not one real number on a grid of at most three dimensions.
    """
    head, body = nifti_files(path)
    try:
        with opened(head) as file:
            header = parse_header(file.read(544))
        _check_kind(header, path.name)
        with opened(body) as file:
            raw, length = _take(file, header)
    except InputError:
        raise
    except (EOFError, OSError, ValueError, OverflowError, MemoryError, zlib.error, struct.error) as error:
        raise InputError(f"cannot read {path.name} as NIfTI, it is damaged or truncated: {error}") from None
    if length < header.n_bytes:
        raise InputError(
            f"cannot read {body.name} as NIfTI: expected {header.n_bytes} bytes, got {length}; copy it again"
        )
    kind = np.dtype(header.byte_order + _TYPES[header.datatype])
    return _scaled(np.frombuffer(raw, kind).reshape(header.shape[::-1]), header, path.name), header


def _check_kind(header: NiftiHeader, name: str) -> None:
    if header.datatype not in _TYPES:
        kind = _OTHERS.get(header.datatype, f"the data type {header.datatype}")
        raise InputError(f"expected one value a voxel, got {kind} in {name}")
    if header.n_voxels != prod(header.shape):
        raise InputError(f"expected a three-dimensional image in {name}, got size {header.sizes}")


def _take(file: BinaryIO, header: NiftiHeader) -> tuple[bytearray, int]:
    """Bytes of the samples and length of the file; what follows is read for gzip's own check at the end."""
    length = len(file.read(header.vox_offset))
    raw = bytearray()
    while block := file.read(_BLOCK):
        length += len(block)
        raw += block[: header.n_bytes - header.vox_offset - len(raw)]
    return raw, length


def _scaled(stored: NDArray[Any], header: NiftiHeader, name: str) -> NDArray[Any]:
    """Stored values by slope and intercept: none where the slope is 0 (nifti1.h), or no number, as SPM writes."""
    if stored.dtype.kind == "f" and not np.isfinite(stored).all():
        wild = int(np.count_nonzero(~np.isfinite(stored)))
        raise InputError(
            f"expected finite HU everywhere in {name}, got NaN or infinity in {wild} of {header.n_voxels} voxels"
        )
    slope, intercept = header.scaling
    if not np.isfinite(slope) or slope == 0 or (slope, intercept) == (1, 0):
        return stored.astype(stored.dtype.newbyteorder("="), copy=False)
    if not np.isfinite(intercept):
        raise InputError(f"expected a number as the intercept of {name}, got {intercept}")
    whole = stored.dtype.kind in "iu" and stored.itemsize <= 2 and slope in (-1, 1) and float(intercept).is_integer()
    scaled = np.empty(stored.shape, dtype=np.int32 if whole else np.float32)
    for k, slab in enumerate(stored):
        scaled[k] = slab * np.float64(slope) + intercept
    return scaled
