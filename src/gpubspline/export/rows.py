"""Numbered rows of numbers as text, by the million: what decks are made of.

Polars formats them, some 65,000 rows at a time: no loop of Python's runs over rows. Numbers of float32 are written
with the digits that give them back (at most 9), those of float64 with 12: a micrometre in a billion.
"""

from collections.abc import Iterator
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray

_CHUNK = 1 << 16
"""Rows at a time: they bound the memory, and fit into the cache."""

PER_LINE = 16
"""Most entries of a data line that Abaqus and CalculiX read."""

REAL = "%.12g"
"""Twelve digits, within the twenty characters that CalculiX reads of a number."""

_TWELVE_DIGITS: dict[str, Any] = {"float_scientific": True, "float_precision": 11}


def chunks(n_rows: int, times: int = 1) -> Iterator[slice]:
    """Ranges of rows that fit into memory, so many times as long where a range costs more than its rows do."""
    for first in range(0, n_rows, times * _CHUNK):
        yield slice(first, min(first + times * _CHUNK, n_rows))


def write_reals(stream: TextIO, columns: list[NDArray[Any]]) -> None:
    """Write rows ``label, value, ...`` of columns (n,) with labels from 1."""
    for rows in chunks(len(columns[0])):
        _write(stream, [np.arange(rows.start + 1, rows.stop + 1), *(column[rows] for column in columns)])


def write_cells(stream: TextIO, cells: NDArray[Any], first_label: int) -> None:
    """Write rows ``label, node, ...`` of cells (m, k), their nodes counted from 0, as labels from 1."""
    for rows in chunks(len(cells)):
        _write(stream, [np.arange(rows.start, rows.stop) + first_label, *(cells[rows].T + 1)])


def write_rows(stream: TextIO, columns: list[NDArray[Any]]) -> None:
    """Write rows of columns (n,) of integers, reals or texts."""
    for rows in chunks(len(columns[0])):
        _write(stream, [column[rows] for column in columns])


def write_members(stream: TextIO, members: NDArray[Any]) -> None:
    """Write the labels of members (n,), counted from 0, as labels from 1."""
    labels = np.asarray(members, dtype=np.int64) + 1
    whole = len(labels) // PER_LINE * PER_LINE
    table = labels[:whole].reshape(-1, PER_LINE)
    for rows in chunks(len(table)):
        _write(stream, list(table[rows].T))
    if whole < len(labels):
        stream.write(",".join(map(str, labels[whole:].tolist())) + "\n")


def texts(column: NDArray[Any]) -> list[str]:
    """A column (n,) as ``write_reals`` writes it, number by number."""
    import polars

    return str(polars.DataFrame({"0": column}).write_csv(include_header=False, **_options([column]))).splitlines()


def _write(stream: TextIO, columns: list[NDArray[Any]]) -> None:
    import polars

    frame = polars.DataFrame({str(number): np.ascontiguousarray(column) for number, column in enumerate(columns)})
    stream.flush()  # what follows goes past the encoder
    _broken(frame).write_csv(stream.buffer, include_header=False, quote_style="never", **_options(columns))


def _options(columns: list[NDArray[Any]]) -> dict[str, Any]:
    return _TWELVE_DIGITS if any(column.dtype == np.float64 for column in columns) else {}


def _broken(frame: Any) -> Any:
    """Rows over lines of at most ``PER_LINE`` entries, all but the last ending in a comma."""
    import polars

    names = frame.columns
    for first in range(PER_LINE, len(names), PER_LINE):
        ends = polars.concat_str([names[first - 1], names[first]], separator=",\n")
        frame = frame.with_columns(ends.alias(names[first - 1])).drop(names[first])
    return frame
