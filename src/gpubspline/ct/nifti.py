"""The header of a NIfTI file, and where its grid lies.

It may be a pair, ``.hdr`` and ``.img``, as Analyze 7.5 is, which NIfTI came from and whose header knows no place.

ITK knows orthogonal grids only, while a gantry tilt makes an sform sheared, and takes the voxels' size from ``pixdim``
where the sform has another.
"""

import gzip
import re
import struct
import warnings
from dataclasses import dataclass
from math import prod
from pathlib import Path
from typing import BinaryIO, cast

import numpy as np
from numpy.typing import NDArray

from gpubspline.errors import GpubsplineWarning, InputError

Floats = NDArray[np.float64]

_LAYOUTS = {
    348: {
        "dim": (40, "8h"),
        "datatype": (70, "h"),
        "bitpix": (72, "h"),
        "pixdim": (76, "8f"),
        "vox_offset": (108, "f"),
        "scaling": (112, "2f"),
        "xyzt_units": (123, "b"),
        "qform_code": (252, "h"),
        "sform_code": (254, "h"),
        "quatern": (256, "3f"),
        "qoffset": (268, "3f"),
        "srow": (280, "12f"),
        "magic": (344, "4s"),
    },
    540: {
        "dim": (16, "8q"),
        "datatype": (12, "h"),
        "bitpix": (14, "h"),
        "pixdim": (104, "8d"),
        "vox_offset": (168, "q"),
        "scaling": (176, "2d"),
        "xyzt_units": (500, "i"),
        "qform_code": (344, "i"),
        "sform_code": (348, "i"),
        "quatern": (352, "3d"),
        "qoffset": (376, "3d"),
        "srow": (400, "12d"),
        "magic": (4, "8s"),
    },
}
"""Offset and type of the fields of NIfTI-1 (nifti1.h) and NIfTI-2 (nifti2.h), by the size of their headers."""

_MAGIC = (b"n+", b"ni")
"""Of one file and of a pair, as they begin (nifti1.h, nifti2.h)."""

_GZIP = b"\x1f\x8b"
"""What a compressed file begins with (RFC 1952), whatever its name."""

_SCANNER = 1
"""Code of a form that leads to the scanner's own frame (nifti1.h: NIFTI_XFORM_SCANNER_ANAT)."""

_PER_UNIT_MM = {1: 1e3, 3: 1e-3}
"""Of the units of ``xyzt_units`` that are not mm: metres and micrometres (nifti1.h: NIFTI_UNITS_METER, _MICRON)."""

APART = 0.1
"""Distance of the corners, in the smallest voxel edge, from which qform and sform are said to differ."""

_PAIR = re.compile(r"\.(hdr|img)(\.gz)?$", re.IGNORECASE)

_TO_LPS = np.diag([-1.0, -1.0, 1.0, 1.0])


@dataclass(frozen=True)
class NiftiHeader:
    """The fields of a NIfTI header that are read here, under their names in nifti1.h.

    ``scaling`` are its slope and intercept, ``scl_slope`` and ``scl_inter``.
    """

    byte_order: str
    dim: tuple[int, ...]
    datatype: int
    bitpix: int
    pixdim: tuple[float, ...]
    vox_offset: int
    scaling: tuple[float, float]
    xyzt_units: int
    qform_code: int
    sform_code: int
    quatern: tuple[float, ...]
    qoffset: tuple[float, ...]
    srow: Floats

    @property
    def sizes(self) -> tuple[int, ...]:
        """Along every dimension of the file."""
        return tuple(int(max(size, 1)) for size in self.dim[1 : 1 + min(max(self.dim[0], 0), 7)])

    @property
    def n_voxels(self) -> int:
        """Of all images of the file."""
        return prod(self.sizes)

    @property
    def n_bytes(self) -> int:
        """Length of a whole file."""
        return self.vox_offset + self.n_voxels * self.bitpix // 8

    @property
    def shape(self) -> tuple[int, int, int]:
        """Voxels along i, j, k; 1 where there is no such axis."""
        i, j, k = (max(int(n), 1) if axis <= self.dim[0] else 1 for axis, n in enumerate(self.dim[1:4], start=1))
        return i, j, k

    @property
    def sform(self) -> Floats:
        """(4, 4) index (i, j, k) to mm, RAS, by rows: method 3 of nifti1.h."""
        affine = np.eye(4)
        affine[:3] = self.srow * _PER_UNIT_MM.get(self.xyzt_units & 7, 1.0)
        return affine

    @property
    def qform(self) -> Floats:
        """(4, 4) index (i, j, k) to mm, RAS, by a quaternion and the voxels' sizes: method 2 of nifti1.h."""
        b, c, d = self.quatern
        vector = b * b + c * c + d * d
        a = np.sqrt(max(1 - vector, 0.0))
        a, b, c, d = np.array([a, b, c, d]) / np.sqrt(a * a + vector)  # rounded, it may be longer than 1
        turn = np.array(
            [
                [a * a + b * b - c * c - d * d, 2 * (b * c - a * d), 2 * (b * d + a * c)],
                [2 * (b * c + a * d), a * a + c * c - b * b - d * d, 2 * (c * d - a * b)],
                [2 * (b * d - a * c), 2 * (c * d + a * b), a * a + d * d - b * b - c * c],
            ]
        )
        affine = np.eye(4)
        affine[:3, :3] = turn * self.sizes_mm * [1, 1, -1 if self.pixdim[0] < 0 else 1]
        affine[:3, 3] = np.array(self.qoffset) * _PER_UNIT_MM.get(self.xyzt_units & 7, 1.0)
        return affine

    @property
    def sizes_mm(self) -> Floats:
        """(3,) size of a voxel along i, j, k as ``pixdim`` has it; 1 along an axis that is not there."""
        sizes = np.array(self.pixdim[1:4]) * _PER_UNIT_MM.get(self.xyzt_units & 7, 1.0)
        return np.where((np.array(self.shape) == 1) & ~(sizes > 0), 1.0, sizes)


def patient_affine(header: NiftiHeader, name: str) -> Floats:
    """(4, 4) index (i, j, k) to LPS mm.

    That of the sform where it leads to the scanner or there is no qform, else of the qform: so ITK chooses. A file
    without both has voxel sizes alone, along the axes of LPS as ITK has it.

    Raises
    ------
    InputError where it is not finite or not invertible, or a voxel's size is not above 0.

    Warns
    -----
    GpubsplineWarning where the forms differ, or there is none, so that nothing tells left from right.
    """
    by_sform = header.sform_code > 0 and (header.sform_code == _SCANNER or header.qform_code <= 0)
    if not by_sform and not (np.isfinite(header.sizes_mm).all() and (header.sizes_mm > 0).all()):
        raise InputError(f"expected sizes of voxels above 0 mm in {name}, got {_spelled(header.sizes_mm)}")
    if header.sform_code <= 0 and header.qform_code <= 0:
        _warn(f"{name} says nothing of its orientation: rows are taken to run to the left, slices upwards")
        return np.diag([*header.sizes_mm, 1.0])
    affine = header.sform if by_sform else header.qform
    if header.shape[2] == 1 and not affine[:3, 2].any():  # one slice needs no thickness
        normal = np.cross(affine[:3, 0], affine[:3, 1])
        affine[:3, 2] = normal / max(float(np.linalg.norm(normal)), 1e-12)
    if not np.isfinite(affine).all() or abs(np.linalg.det(affine[:3, :3])) < 1e-12:
        raise InputError(f"expected an invertible orientation in {name}, got {affine[:3].tolist()}")
    if header.sform_code > 0 and header.qform_code > 0:
        off = _apart(header)
        if off > APART * float(np.linalg.norm(affine[:3, :3], axis=0).min()):
            kind = "sform" if by_sform else "qform"
            _warn(f"the qform and the sform of {name} are up to {off:.3g} mm apart: the {kind} is taken, as ITK does")
    return _TO_LPS @ affine


def _apart(header: NiftiHeader) -> float:
    """Greatest distance of a corner voxel's places by qform and sform, mm."""
    corners = np.array([[i, j, k, 1] for i in (0, 1) for j in (0, 1) for k in (0, 1)], dtype=np.float64)
    corners[:, :3] *= np.array(header.shape) - 1
    return float(np.linalg.norm((corners @ (header.sform - header.qform).T)[:, :3], axis=1).max())


def _spelled(sizes_mm: Floats) -> str:
    return " x ".join(f"{size:g}" for size in sizes_mm)


def _warn(message: str) -> None:
    warnings.warn(message, GpubsplineWarning, stacklevel=4)


def nifti_files(path: Path) -> tuple[Path, Path]:
    """Files of the header and of the samples: one, but where it is either of a pair, which may be compressed.

    Raises InputError where the other of a pair is missing.
    """
    found = _PAIR.search(path.name)
    if found is None:
        return path, path
    this, stem = found[1], path.name[: found.start()]
    wanted = "img" if this.lower() == "hdr" else "hdr"
    names = [f"{stem}.{wanted.upper() if this.isupper() else wanted}{end}" for end in (found[2] or "", "", ".gz")]
    other = next((path.parent / name for name in names if (path.parent / name).is_file()), None)
    if other is None:
        raise InputError(f"expected {names[0]} beside {path.name}, as of a pair of Analyze or NIfTI, got no such file")
    return (path, other) if wanted == "img" else (other, path)


def opened(path: Path) -> BinaryIO:
    """Open a file to read, decompressed where it is compressed."""
    with path.open("rb") as file:
        packed = file.read(2) == _GZIP
    return cast(BinaryIO, gzip.open(path)) if packed else path.open("rb")


def parse_header(start: bytes) -> NiftiHeader:
    """Read the header that a file begins with; raises ValueError where there is none."""
    if len(start) < min(_LAYOUTS):
        raise ValueError(f"expected a header of {min(_LAYOUTS)} bytes, got a file of {len(start)}")
    for order in "<>":
        size = struct.unpack_from(f"{order}i", start)[0]
        layout = _LAYOUTS.get(size)
        if layout:
            fields = {name: struct.unpack_from(order + form, start, at) for name, (at, form) in layout.items()}
            if fields["magic"][0][:2] not in _MAGIC:  # Analyze's: what it has there is no place
                fields |= dict.fromkeys(("qform_code", "sform_code", "xyzt_units"), (0,)) | {"scaling": (0, 0)}
            return NiftiHeader(
                byte_order=order,
                dim=fields["dim"],
                datatype=int(fields["datatype"][0]),
                bitpix=int(fields["bitpix"][0]),
                pixdim=fields["pixdim"],
                vox_offset=max(int(fields["vox_offset"][0]), size + 4 if fields["magic"][0][:2] == _MAGIC[0] else 0),
                scaling=fields["scaling"],
                xyzt_units=int(fields["xyzt_units"][0]),
                qform_code=int(fields["qform_code"][0]),
                sform_code=int(fields["sform_code"][0]),
                quatern=fields["quatern"],
                qoffset=fields["qoffset"],
                srow=np.array(fields["srow"], dtype=np.float64).reshape(3, 4),
            )
    raise ValueError("no NIfTI header")
