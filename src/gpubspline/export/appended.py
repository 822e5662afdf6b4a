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
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from gpubspline.export.placed import TYPES, Array, Key, PlacedArrays, Sections, by_key
from gpubspline.files import check_space, reserve, whole_file

FIELD_DATA = "FieldData"
"""The section of arrays that belong to no point and no cell."""

COUNT = np.dtype("<u8")


def xml_comment(line: str) -> str:
    """Comment of an XML file, which has no two hyphens in it."""
    return f"<!-- {line.replace('--', '- -')} -->"


_TAIL = b"\n</AppendedData>\n</VTKFile>\n"


@contextmanager
def appended_file(
    path: Path, grid: str, attributes: Mapping[str, str], sections: Sections, comments: Sequence[str] = ()
) -> Iterator[PlacedArrays]:
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
    check_space(path, sum(array.n_bytes for given in sections.values() for array in given))
    arrays = by_key(sections)
    offsets, end = _offsets(arrays)
    header = _header(grid, attributes, arrays, offsets, comments)
    with whole_file(path) as temporary, open(temporary, "wb") as stream:
        reserve(stream, len(header) + end + len(_TAIL))
        stream.write(header)
        for key, offset in offsets.items():
            stream.seek(len(header) + offset)
            stream.write(np.array(arrays[key].n_bytes, dtype=COUNT).tobytes())
        stream.seek(len(header) + end)
        stream.write(_TAIL)
        yield PlacedArrays(stream, arrays, {key: len(header) + at + COUNT.itemsize for key, at in offsets.items()})


def _offsets(arrays: Mapping[Key, Array]) -> tuple[dict[Key, int], int]:
    """Offset behind the underscore of each array, the last named first, and the end of all."""
    offsets, end = {}, 0
    for key, array in reversed(list(arrays.items())):
        offsets[key] = end
        end += COUNT.itemsize + array.n_bytes
    return offsets, end


def _header(
    grid: str,
    attributes: Mapping[str, str],
    arrays: Mapping[Key, Array],
    offsets: dict[Key, int],
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


def _data_arrays(section: str, arrays: Mapping[Key, Array], offsets: dict[Key, int]) -> Iterator[str]:
    for key, array in arrays.items():
        if key[0] == section:
            # meshio takes a stated single component for a table of one column
            shape = f' NumberOfComponents="{array.n_components}"' if array.n_components > 1 else ""
            count = f' NumberOfTuples="{array.n_rows}"' if section == FIELD_DATA else ""
            kind = f'type="{TYPES[array.dtype]}" Name={quoteattr(array.name)}{shape}{count}'
            yield f'<DataArray {kind} format="appended" offset="{offsets[key]}"/>'
