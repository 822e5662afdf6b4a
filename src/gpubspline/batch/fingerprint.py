"""What a subject's model depends on, as one checksum: the bytes of its inputs, its options, the version of the code."""

import hashlib
import json
import re
from collections.abc import Iterator, Mapping
from importlib.metadata import version
from pathlib import Path

from gpubspline.batch.manifest import Subject
from gpubspline.errors import InputError

_CHUNK = 1 << 20
_HEADER = 1 << 16


def fingerprint(subject: Subject, settings: Mapping[str, str]) -> str:
    """SHA-256, in hexadecimal, of all that decides what a subject's model will be.

    Arguments
    ---------
    subject: its options by name, and its files by their content: a folder that was moved or copied is the same input.
    settings: options of the whole cohort that change results.

    Raises
    ------
    InputError where a file cannot be read.
    """
    contents = {str(path): _checksum(path) for path in subject.files}
    options = {name: contents.get(value, value) for name, value in subject.options.items()}
    inputs = [contents[str(path)] for path in subject.inputs]
    known = {"version": version("gpubspline"), "settings": dict(settings), "options": options, "inputs": inputs}
    return hashlib.sha256(json.dumps(known, sort_keys=True).encode()).hexdigest()


def _checksum(path: Path) -> str:
    whole = hashlib.sha256()
    try:
        for file in _files(path):
            part = hashlib.sha256()
            with file.open("rb") as opened:
                while chunk := opened.read(_CHUNK):
                    part.update(chunk)
            name = file.relative_to(path).as_posix() if path.is_dir() else file.suffix
            whole.update(f"{name}\0{part.hexdigest()}\n".encode())
    except OSError as error:
        raise InputError(f"cannot read {error.filename}: {error.strerror}") from None
    return whole.hexdigest()


def _files(path: Path) -> Iterator[Path]:
    """Every file of a folder in a fixed order; or a file, with that of its samples where it is a header of them."""
    if path.is_dir():
        yield from sorted(file for file in path.rglob("*") if file.is_file() and not file.name.startswith("."))
    elif path.suffix.lower() in (".mhd", ".nhdr"):
        samples = re.search(r"^(ElementDataFile *=|data file *:) *(.+?) *\r?$", _header(path), re.MULTILINE)
        yield from [path, *([path.parent / samples[2]] if samples and (path.parent / samples[2]).is_file() else [])]
    else:
        yield path


def _header(path: Path) -> str:
    with path.open("rb") as file:
        return file.read(_HEADER).decode("latin-1")
