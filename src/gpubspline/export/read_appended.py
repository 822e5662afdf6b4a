"""VTK's XML files whose arrays are appended raw, such as this project writes: mapped rather than read."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from gpubspline.export.placed import TYPES

_HEADER = 1 << 20
"""Bytes within which the header must end; one of a hundred arrays has about 10,000."""

_TYPES = {name: dtype for dtype, name in TYPES.items()}
_COUNTS: dict[str, np.dtype[Any]] = {"UInt32": np.dtype("<u4"), "UInt64": np.dtype("<u8")}


@dataclass(frozen=True, eq=False)
class StoredGrid:
    """What a file holds.

    Attributes
    ----------
    grid: VTK's name, ``"StructuredGrid"`` or ``"UnstructuredGrid"``.
    piece: attributes of the one piece.
    arrays: by section (``"FieldData"``, ``"PointData"``, ``"CellData"``, ``"Points"``, ``"Cells"``) and name, (n,) or
        (n, c).
    """

    grid: str
    piece: dict[str, str]
    arrays: dict[str, dict[str, NDArray[Any]]]


def read_appended(path: Path) -> StoredGrid | None:
    """Map the arrays of a file, which cost memory when they are used.

    None where the file is of another kind: compressed, as text, big-endian, in pieces.

    Raises
    ------
    ValueError or KeyError where the file is cut short or contradicts itself.
    """
    with open(path, "rb") as stream:
        head = stream.read(_HEADER)
    end = head.find(b'<AppendedData encoding="raw">')
    if end < 0:
        return None
    root = ElementTree.fromstring(head[:end] + b"</VTKFile>")
    pieces = root.findall("*/Piece")
    plain = root.get("byte_order") == "LittleEndian" and root.get("compressor") is None and len(pieces) == 1
    own = root.findall("*/FieldData")
    tags = [*pieces[0].findall("*/DataArray"), *root.findall("*/FieldData/DataArray")] if plain else []
    if not plain or any(tag.get("format") != "appended" for tag in tags):
        return None
    start, count = head.index(b"_", end) + 1, _COUNTS[root.get("header_type", "UInt32")]
    sections = {
        section.tag: {tag.attrib["Name"]: _map(path, tag, start, count) for tag in section.findall("DataArray")}
        for section in (*own, *pieces[0])
    }
    return StoredGrid(root.attrib["type"], dict(pieces[0].attrib), sections)


def _map(path: Path, tag: ElementTree.Element, start: int, count: np.dtype[Any]) -> NDArray[Any]:
    """One array, copied to memory where it is changed."""
    dtype, at = _TYPES[tag.attrib["type"]], start + int(tag.attrib["offset"])
    n_components = int(tag.get("NumberOfComponents", 1))
    n_bytes = int(np.fromfile(path, count, count=1, offset=at)[0])
    shape = (n_bytes // dtype.itemsize // n_components, *((n_components,) if n_components > 1 else ()))
    if n_bytes == 0:
        return np.empty(shape, dtype=dtype)
    return np.asarray(np.memmap(path, dtype, "c", offset=at + count.itemsize, shape=shape))
