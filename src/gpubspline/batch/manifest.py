"""The manifest of a cohort: a CSV file, a row a subject, a column an option.

    subject,input,threshold,control,load
    head-01,scans/head-01,-200,"20,80,26",
    femur-07,scans/femur-07.nii.gz,,,stance

Paths are relative to the manifest's folder; several inputs of one subject are parted by ``;``. An empty cell leaves the
option at its default. What is wrong with a manifest is found before any work.
"""

import csv
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path

from gpubspline.errors import InputError

SUBJECT, INPUT = "subject", "input"
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.+-]*")
LOGS, TABLE, PAGE = "logs", "cohort.csv", "cohort.html"
"""Names in a cohort's folder beside those of its subjects."""

RESERVED = (LOGS, TABLE, PAGE)
_YES, _NO = ("yes", "true", "1", "x"), ("no", "false", "0")


@dataclass(frozen=True)
class Subject:
    """A row of a manifest.

    Attributes
    ----------
    name: of its folder and of its row in the table; unique.
    line: of the manifest.
    inputs: absolute paths of its CT.
    options: the cells that are filled, by column; those that name a file are absolute paths, flags are ``"yes"``.
    files: every file or folder that is read: inputs, masks, laws, load cases.
    """

    name: str
    line: int
    inputs: tuple[Path, ...]
    options: dict[str, str]
    files: tuple[Path, ...]


def read_manifest(path: Path, columns: Mapping[str, str]) -> list[Subject]:
    """Read a manifest.

    Arguments
    ---------
    path: CSV with a header of ``subject``, ``input`` and any of the columns; UTF-8, commas.
    columns: what the cells of each option's column are: ``"text"``, ``"texts"`` parted by ``;``, ``"flag"``, ``"file"``
        to be read, or ``"new file"``, a name in the subject's own folder. A text that ends in ``.toml`` is a file to be
        read, in texts what follows a ``=``.

    Raises
    ------
    InputError, one line, for a file that cannot be read, an unknown column, a subject without a name or with that of
    another, a file that is missing.
    """
    rows = list(_rows(path))
    if not rows:
        raise InputError(f"expected a manifest with a header and a row for each subject, got nothing in {path.name}")
    header = _header(rows[0][1], columns, path)
    if len(rows) == 1:
        raise InputError(f"expected a row for each subject below the header of {path.name}, got none")
    subjects = [_subject(line, cells, header, columns, path) for line, cells in rows[1:]]
    _check_unique(subjects, path)
    return subjects


def _rows(path: Path) -> Iterator[tuple[int, list[str]]]:
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.reader(file, strict=True)
            for cells in reader:
                if any(cell.strip() for cell in cells):
                    yield reader.line_num, [cell.strip() for cell in cells]
    except OSError as error:
        raise InputError(f"cannot read the manifest {path}: {error.strerror}") from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"expected a manifest in CSV, UTF-8, got {path.name}: {error}") from None


def _header(cells: Sequence[str], columns: Mapping[str, str], path: Path) -> list[str]:
    known = [SUBJECT, INPUT, *columns]
    names = [cell.lower().replace("_", "-") for cell in cells]
    for name in names:
        if name not in known:
            near = get_close_matches(name, known, 1)
            hint = f" (did you mean {near[0]}?)" if near else ""
            raise InputError(f"expected the columns {', '.join(known)} in {path.name}, got {name!r}{hint}")
        if names.count(name) > 1:
            raise InputError(f"expected each column of {path.name} once, got {name!r} {names.count(name)} times")
    for name in (SUBJECT, INPUT):
        if name not in names:
            raise InputError(f"expected the columns {SUBJECT} and {INPUT} in {path.name}, got no {name}")
    return names


def _subject(line: int, cells: list[str], header: list[str], columns: Mapping[str, str], path: Path) -> Subject:
    where = f"line {line} of {path.name}"
    if len(cells) > len(header):
        raise InputError(
            f"expected {len(header)} cells in {where}, got {len(cells)}; a cell with commas stands in quotes"
        )
    row = {name: cell for name, cell in zip(header, cells, strict=False) if cell}
    name = row.pop(SUBJECT, "")
    if not _NAME.fullmatch(name):
        raise InputError(f"expected a subject's name of letters, digits and _ . + - in {where}, got {name!r}")
    if name.lower() in RESERVED:
        raise InputError(f"expected another name than {name!r} in {where}, which the cohort's own files have")
    where = f"{name}, {where}"
    inputs = tuple(_existing(part, path, where) for part in row.pop(INPUT, "").split(";") if part.strip())
    if not inputs:
        raise InputError(f"expected an input for {where}, got none")
    options: dict[str, str] = {}
    files = list(inputs)
    for column, cell in row.items():
        kind = columns[column]
        if kind == "file" or (kind == "text" and cell.lower().endswith(".toml")):
            files.append(_existing(cell, path, where))
            options[column] = str(files[-1])
        elif kind == "texts":
            options[column] = ";".join(_with_files(cell, path, where, files))
        elif kind != "flag" or _is_yes(cell, column, where):
            options[column] = _plain_name(cell, column, where) if kind == "new file" else cell
    return Subject(name, line, inputs, options, tuple(files))


def _with_files(cell: str, manifest: Path, where: str, files: list[Path]) -> Iterator[str]:
    """Texts of a cell, those of files with their paths, which join ``files``."""
    for text in filter(None, map(str.strip, cell.split(";"))):
        name, equals, value = text.rpartition("=")
        if value.lower().endswith(".toml"):
            files.append(_existing(value, manifest, where))
            value = str(files[-1])
        yield f"{name}{equals}{value}"


def _existing(text: str, manifest: Path, where: str) -> Path:
    path = (manifest.absolute().parent / Path(text.strip()).expanduser()).resolve()
    if not path.exists():
        raise InputError(f"expected an existing file for {where}, got {path}")
    return path


def _is_yes(cell: str, column: str, where: str) -> bool:
    if cell.lower() not in (*_YES, *_NO):
        raise InputError(f"expected yes or no for {column} of {where}, got {cell!r}")
    return cell.lower() in _YES


def _plain_name(cell: str, column: str, where: str) -> str:
    if Path(cell).name != cell or not _NAME.fullmatch(cell):
        raise InputError(f"expected a plain file name for {column} of {where}, got {cell!r}: it lies in its folder")
    return cell


def _check_unique(subjects: Sequence[Subject], path: Path) -> None:
    taken: dict[str, Subject] = {}
    for subject in subjects:
        other = taken.setdefault(subject.name.lower(), subject)  # file systems may not tell A from a
        if other is not subject:
            raise InputError(
                f"expected a name of its own for each subject of {path.name}, got {subject.name} in the lines "
                f"{other.line} and {subject.line}"
            )
