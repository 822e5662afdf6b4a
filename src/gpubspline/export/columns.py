"""Lines of text made of columns of numbers by a template, by the million, with fields of fixed width where wanted.

Polars formats them, as in ``rows``: no loop of Python's runs over lines.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray

from gpubspline.errors import InputError
from gpubspline.export.rows import chunks

_AROUND = 6
"""Characters of a real beside its digits: a sign, a point, and an exponent or the zeros of 0.0001."""

_WIDE = 16
"""Characters from which on a field has digits to spare."""


@dataclass(frozen=True)
class Fixed:
    """A column (n,) of integers, reals or texts, each right in a field of so many characters.

    A real always has its decimal point, which Fortran and Nastran want, and the digits that the field holds.
    """

    values: NDArray[Any]
    width: int

    def __getitem__(self, rows: slice) -> "Fixed":
        """Give some rows."""
        return Fixed(self.values[rows], self.width)

    def __len__(self) -> int:
        """Count the rows."""
        return len(self.values)


Column = NDArray[Any] | Fixed


def write_lines(out: TextIO, template: str, columns: Sequence[Column]) -> None:
    """Write a line, or several, for each row of columns (n,), each at a ``{}`` of the template.

    Reals have the digits that give them back, or those that fit into the width of ``Fixed``.
    """
    for rows in chunks(len(columns[0])):
        _write(out, template, [column[rows] for column in columns])


def write_labels(out: TextIO, members: NDArray[Any], per_line: int = 16) -> None:
    """Write members (n,), counted from 0, as labels from 1, with a comma between any two, over lines."""
    labels = np.asarray(members, dtype=np.int64) + 1
    whole = max(len(labels) - 1, 0) // per_line * per_line
    if whole:
        write_lines(out, "{}," * per_line, list(labels[:whole].reshape(-1, per_line).T))
    out.write(",".join(map(str, labels[whole:].tolist())) + "\n")


def _write(out: TextIO, template: str, columns: Sequence[Column]) -> None:
    import polars

    texts = [_text(column) for column in columns]
    frame = polars.DataFrame({str(number): text for number, text in enumerate(texts)})
    out.flush()  # what follows goes past the encoder
    lines = frame.select(polars.format(template, *map(polars.col, frame.columns)))
    lines.write_csv(out.buffer, include_header=False, quote_style="never")


def _text(column: Column) -> Any:
    """Polars' series of texts."""
    import polars

    if not isinstance(column, Fixed):
        return polars.Series(np.ascontiguousarray(column)).cast(polars.String)
    values = polars.Series(np.ascontiguousarray(column.values))
    if np.issubdtype(column.values.dtype, np.floating):
        return _fixed_reals(values, column.width).str.pad_start(column.width)
    text = values.cast(polars.String)
    if (text.str.len_chars() > column.width).any():
        longest = int(column.values.max())
        raise InputError(f"expected labels of at most {column.width} digits for this format, got {longest}")
    return text.str.pad_start(column.width)


def _fixed_reals(values: Any, width: int) -> Any:
    """Reals with their point, each of as many digits as fit."""
    import polars

    if values.dtype != polars.Float64:
        if width >= _WIDE:  # which holds all that they have
            return _pointed(values.cast(polars.String))
        values = values.cast(polars.Float64)
    text = _pointed(values.round_sig_figs(width - _AROUND).cast(polars.String))
    for digits in range(width - _AROUND + 1, width - 1) if width < _WIDE else ():
        more = _pointed(values.round_sig_figs(digits).cast(polars.String))
        text = more.zip_with(more.str.len_chars() <= width, text)
    long = (text.str.len_chars() > width).arg_true()  # rounding to digits left more of them, as in 6.00000000000001e-16
    if long.len():
        text = text.scatter(long, [_exponential(value, width) for value in values.gather(long).to_list()])
    return text


def _exponential(value: float, width: int) -> str:
    """A real with its exponent and the digits that fit beside it."""
    texts = (f"{value:.{digits}e}" for digits in range(width - len("1.e+00"), 0, -1))
    return next(text for text in texts if len(text) <= width)


def _pointed(text: Any) -> Any:
    without = ~text.str.contains(".", literal=True)
    return text.zip_with(~without, text.str.replace("e", ".e")) if without.any() else text
