"""Binary files whose arrays have known places: their space is taken at once, and parts are written in any order."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import DTypeLike, NDArray

from gpubspline.errors import InputError

_CHUNK = 1 << 15
"""Rows interleaved at a time, which stay in a core's cache until they are written."""

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


def arrays_like(given: Mapping[str, NDArray[Any]]) -> list[Array]:
    """Arrays for values (n,) or (n, c) each."""
    shapes = {name: (*values.shape, 1) for name, values in given.items()}
    return [Array(n, stored_type(v.dtype, n), shapes[n][0], shapes[n][1]) for n, v in given.items()]


Key = tuple[str, str]
"""Section and name of an array."""

Sections = Mapping[str, Sequence[Array]]


def by_key(sections: Sections) -> dict[Key, Array]:
    """Arrays of all sections, in their order."""
    return {(section, array.name): array for section, arrays in sections.items() for array in arrays}


class PlacedArrays:
    """The arrays of an open file, filled in any order and in parts.

    Arguments
    ---------
    starts: of each array, in bytes.
    """

    def __init__(self, stream: BinaryIO, arrays: Mapping[Key, Array], starts: Mapping[Key, int]) -> None:
        self._stream, self._arrays, self._starts = stream, arrays, starts

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
