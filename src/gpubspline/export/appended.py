"""VTK's XML files with their arrays appended raw: every array's place is known before its numbers are.

    <VTKFile ...> header: names, types, offsets </...>
    <AppendedData encoding="raw"> _ | byte count, numbers | byte count, numbers | ... </AppendedData>

The byte counts are UInt64, everything is little-endian, and the first count lies at a multiple of eight bytes, so that
arrays of four-byte numbers can be mapped. The arrays lie in the reverse of the order in which the header names them:
meshio renumbers the offsets one by one, and could otherwise take one array's new offset for another's old one.

Source: VTK file formats, "XML file formats", appended data.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import DTypeLike, NDArray

from gpubspline.errors import InputError
from gpubspline.files import check_space, whole_file

_CHUNK = 1 << 15
"""Rows interleaved at a time, which stay in a core's cache until they are written."""

FIELD_DATA = "FieldData"
"""The section of arrays that belong to no point and no cell."""

COUNT = np.dtype("<u8")
TYPES = {
    np.dtype(f"<{code}{size}"): f"{name}{8 * size}"
    for code, name, sizes in (("f", "Float", (4, 8)), ("i", "Int", (1, 2, 4, 8)), ("u", "UInt", (1, 2, 4, 8)))
    for size in sizes
}
"""VTK's names of the types of numbers."""


@dataclass(frozen=True)
class Array:
    """One array of a file: its name, the type of its numbers and its shape."""

    name: str
    dtype: np.dtype[Any]
    n_rows: int
    n_components: int = 1

    @property
    def row_bytes(self) -> int:
        """Size of one row."""
        return self.n_components * self.dtype.itemsize

    @property
    def n_bytes(self) -> int:
        """Size of all rows."""
        return self.n_rows * self.row_bytes


def stored_type(dtype: DTypeLike, name: str) -> np.dtype[Any]:
    """Little-endian type of VTK for numbers of ``dtype``; raises InputError where there is none."""
    given = np.dtype(dtype)
    stored = np.dtype(np.uint8) if given == np.bool_ else given.newbyteorder("<")
    if stored not in TYPES:
        raise InputError(f"expected integers or floats of 4 or 8 bytes in the field {name}, got {given}")
    return stored


def field_arrays(types: Mapping[str, DTypeLike], count: int) -> list[Array]:
    """Arrays of ``count`` numbers for fields given by name and type; raises InputError for a type VTK has not."""
    return [Array(name, stored_type(dtype, name), count) for name, dtype in types.items()]


def set_arrays_of(given: Mapping[str, NDArray[Any]]) -> list[Array]:
    """Arrays of ``"FieldData"``, (n,) or (n, c) each."""
    shapes = {name: (*values.shape, 1) for name, values in given.items()}
    return [Array(n, stored_type(v.dtype, n), shapes[n][0], shapes[n][1]) for n, v in given.items()]


def xml_comment(line: str) -> str:
    """Comment of an XML file, which has no two hyphens in it."""
    return f"<!-- {line.replace('--', '- -')} -->"


Sections = Mapping[str, Sequence[Array]]


class AppendedFile:
    """The arrays of an open file, filled in any order and in parts."""

    def __init__(
        self,
        stream: BinaryIO,
        grid: str,
        attributes: Mapping[str, str],
        sections: Sections,
        comments: Sequence[str] = (),
    ) -> None:
        self._stream = stream
        self._arrays = {(section, array.name): array for section, arrays in sections.items() for array in arrays}
        offsets, end = _offsets(self._arrays)
        header = _header(grid, attributes, self._arrays, offsets, comments)
        stream.write(header)
        self._starts = {key: len(header) + offset + COUNT.itemsize for key, offset in offsets.items()}
        for key, start in self._starts.items():
            stream.seek(start - COUNT.itemsize)
            stream.write(np.array(self._arrays[key].n_bytes, dtype=COUNT).tobytes())
        stream.seek(len(header) + end)
        stream.write(b"\n</AppendedData>\n</VTKFile>\n")

    def put(self, section: str, name: str, first_row: int, rows: NDArray[Any]) -> None:
        """Write rows (k,) or (k, n_components) of an array, from its row ``first_row`` on."""
        array = self._seek(section, name, first_row)
        self._stream.write(np.ascontiguousarray(rows, dtype=array.dtype).data)

    def put_planes(self, section: str, name: str, first_row: int, planes: NDArray[Any]) -> None:
        """Write rows of an array given as one plane for each component (n_components, k)."""
        array = self._seek(section, name, first_row)
        buffer = np.empty((min(_CHUNK, planes.shape[1]), array.n_components), dtype=array.dtype)
        for first in range(0, planes.shape[1], _CHUNK):
            part = planes[:, first : first + _CHUNK]
            for component, plane in enumerate(part):
                buffer[: part.shape[1], component] = plane
            self._stream.write(buffer[: part.shape[1]].data)

    def _seek(self, section: str, name: str, row: int) -> Array:
        array = self._arrays[section, name]
        self._stream.seek(self._starts[section, name] + row * array.row_bytes)
        return array


@contextmanager
def appended_file(
    path: Path, grid: str, attributes: Mapping[str, str], sections: Sections, comments: Sequence[str] = ()
) -> Iterator[AppendedFile]:
    """Open a file that takes its place at ``path`` when the block ends without an error.

    Arguments
    ---------
    path: in an existing folder.
    grid: VTK's name, ``"StructuredGrid"`` or ``"UnstructuredGrid"``.
    attributes: of the one piece, and of the grid where they are its extent.
    comments: lines that stand in the header.
    sections: the arrays of ``"FieldData"`` first, ``"PointData"``, ``"CellData"``, ``"Points"`` and ``"Cells"``.

    Raises
    ------
    InputError where the folder is not there or not writable, or the disk has no room for the file.
    """
    check_space(path, sum(array.n_bytes for arrays in sections.values() for array in arrays))
    with whole_file(path) as temporary, open(temporary, "wb") as stream:
        yield AppendedFile(stream, grid, attributes, sections, comments)


_Key = tuple[str, str]


def _offsets(arrays: Mapping[_Key, Array]) -> tuple[dict[_Key, int], int]:
    """Offset behind the underscore of each array, the last named first, and the end of all."""
    offsets, end = {}, 0
    for key, array in reversed(list(arrays.items())):
        offsets[key] = end
        end += COUNT.itemsize + array.n_bytes
    return offsets, end


def _header(
    grid: str,
    attributes: Mapping[str, str],
    arrays: Mapping[_Key, Array],
    offsets: dict[_Key, int],
    comments: Sequence[str],
) -> bytes:
    """All up to and with the underscore, whose length is a multiple of eight bytes."""
    extent = "".join(f" Whole{name}={quoteattr(value)}" for name, value in attributes.items() if name == "Extent")
    piece = "".join(f" {name}={quoteattr(value)}" for name, value in attributes.items())
    lines = [
        '<?xml version="1.0"?>',
        *map(xml_comment, comments),
        f'<VTKFile type="{grid}" version="1.0" byte_order="LittleEndian" header_type="UInt64">',
        f"<{grid}{extent}>",
        f"<Piece{piece}>",
    ]
    for section in dict.fromkeys(section for section, _ in arrays):
        block = [f"<{section}>", *_data_arrays(section, arrays, offsets), f"</{section}>"]
        lines[-1:-1] = block if section == FIELD_DATA else []  # which is of the grid, before its piece
        lines += [] if section == FIELD_DATA else block
    lines += ["</Piece>", f"</{grid}>", '<AppendedData encoding="raw">', ""]
    text = "\n".join(lines).encode()
    return text + b" " * (-(len(text) + 1) % 8) + b"_"


def _data_arrays(section: str, arrays: Mapping[_Key, Array], offsets: dict[_Key, int]) -> Iterator[str]:
    for key, array in arrays.items():
        if key[0] == section:
            # meshio takes a stated single component for a table of one column
            shape = f' NumberOfComponents="{array.n_components}"' if array.n_components > 1 else ""
            count = f' NumberOfTuples="{array.n_rows}"' if section == FIELD_DATA else ""
            kind = f'type="{TYPES[array.dtype]}" Name={quoteattr(array.name)}{shape}{count}'
            yield f'<DataArray {kind} format="appended" offset="{offsets[key]}"/>'
