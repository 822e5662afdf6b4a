"""Numbered rows of numbers as text, by the thousand: what decks are made of."""

from collections.abc import Iterator
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray

_CHUNK = 20_000
"""Rows formatted at a time, which bounds the memory."""

PER_LINE = 16
"""Most entries of a data line that Abaqus and CalculiX read."""

REAL = "%.12g"
"""Twelve digits: a micrometre in a billion, and within the twenty characters that CalculiX reads of a number."""


def _chunks(n_rows: int) -> Iterator[slice]:
    for first in range(0, n_rows, _CHUNK):
        yield slice(first, min(first + _CHUNK, n_rows))


def write_reals(stream: TextIO, columns: list[NDArray[Any]]) -> None:
    """Write rows ``label, value, ...`` of columns (n,) with labels from 1."""
    line = "%d, " + ", ".join([REAL] * len(columns)) + "\n"
    for rows in _chunks(len(columns[0])):
        table = [range(rows.start + 1, rows.stop + 1), *(column[rows].tolist() for column in columns)]
        stream.write(line * (rows.stop - rows.start) % tuple(v for row in zip(*table, strict=True) for v in row))


def write_cells(stream: TextIO, cells: NDArray[Any], first_label: int) -> None:
    """Write rows ``label, node, ...`` of cells (m, k), their nodes counted from 0, as labels from 1."""
    width = cells.shape[1] + 1
    line = _broken_line(width)
    for rows in _chunks(len(cells)):
        labels = np.arange(rows.start, rows.stop) + first_label
        table = np.column_stack([labels, cells[rows].astype(np.int64) + 1])
        stream.write(line * len(table) % tuple(table.ravel().tolist()))


def write_members(stream: TextIO, members: NDArray[Any]) -> None:
    """Write the labels of members (n,), counted from 0, as labels from 1."""
    whole = len(members) // PER_LINE * PER_LINE
    labels = (np.asarray(members, dtype=np.int64) + 1).tolist()
    stream.write(_broken_line(PER_LINE) * (whole // PER_LINE) % tuple(labels[:whole]))
    if labels[whole:]:
        stream.write(", ".join(map(str, labels[whole:])) + "\n")


def _broken_line(width: int) -> str:
    """Format of ``width`` integers over lines of at most ``PER_LINE``, all but the last ending in a comma."""
    parts = [min(PER_LINE, width - first) for first in range(0, width, PER_LINE)]
    return ",\n".join(", ".join(["%d"] * part) for part in parts) + "\n"
