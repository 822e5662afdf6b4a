"""What a subject's model depends on, as one checksum: the bytes of its inputs, its options, the version of the code."""

import hashlib
import json
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path

from gpubspline.batch.manifest import Subject
from gpubspline.ct.image import format_name
from gpubspline.ct.nifti import nifti_files
from gpubspline.errors import InputError
from gpubspline.tables import parse, read_text

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
    options = {name: _told(value, contents) for name, value in subject.options.items()}
    inputs = [contents[str(path)] for path in subject.inputs]
    known = {"version": version("gpubspline"), "settings": dict(settings), "options": options, "inputs": inputs}
    return hashlib.sha256(json.dumps(known, sort_keys=True).encode()).hexdigest()


def _told(value: str, contents: Mapping[str, str]) -> str:
    """An option with its files by their content; of several texts each, behind its label."""
    if value in contents:
        return contents[value]
    return ";".join(name + equals + contents.get(text, text) for name, equals, text in map(_parted, value.split(";")))


def _parted(text: str) -> tuple[str, str, str]:
    name, equals, value = text.rpartition("=")
    return name, equals, value


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
    """Every file of a folder in a fixed order; or a file, with those that it names."""
    if path.is_dir():
        yield from sorted(file for file in path.rglob("*") if file.is_file() and not file.name.startswith("."))
        return
    yield path
    if path.suffix.lower() in (".mhd", ".nhdr"):
        yield from _samples(path)
    elif path.suffix.lower() == ".toml":
        with suppress(InputError):  # what is wrong with it is said of its subject
            mask = parse(read_text(path, "file"), path.name).get("mask")
            yield from _there([path.parent / Path(mask).expanduser()] if isinstance(mask, str) else [])
    elif format_name(path) == "NIfTI":
        with suppress(InputError):
            yield from (file for file in nifti_files(path) if file != path)


def _samples(header: Path) -> Iterator[Path]:
    """Files of the samples of a MetaImage or NRRD header: one, a numbered series, or those in the lines that follow."""
    with header.open("rb") as file:
        text = file.read(_HEADER).decode("latin-1")
    found = re.search(r"^(ElementDataFile *=|data ?file *:) *(.+?) *\r?$", text, re.MULTILINE | re.IGNORECASE)
    if found is None:
        return
    first, *_ = found[2].split()
    if first.upper() == "LIST":
        yield from _there(header.parent / line.strip() for line in text[found.end() :].splitlines() if line.strip())
    elif "%" in first:
        yield from sorted(header.parent.glob(re.sub(r"%\d*[dui]", "*", first)))
    else:
        yield from _there([header.parent / found[2]])


def _there(files: Iterable[Path]) -> Iterator[Path]:
    return (file for file in files if file.is_file())
