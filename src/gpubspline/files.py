"""Output files that appear whole or not at all; and what stands for the name of a file, which may be a patient's."""

import errno
import os
import re
import shutil
import stat
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from gpubspline.errors import InputError

ENDINGS = re.compile(
    r"(\.(nii|hdr|img)\.gz|\.(nii|hdr|img|nrrd|nhdr|mha|mhd|npy|npz|dcm|json|toml|csv|html|png|inp|feb|bdf|cdb|rad|k"
    r"|msh|xdmf|vtk|vtu|vts|vtkhdf|vtp|exo|med|stl|obj|ply|off))$",
    re.IGNORECASE,
)
"""Endings of file names that say what a file is."""

SHOWN = 40
"""Characters of a file's name in that of its temporary file, which file systems allow 255 bytes."""


def check_writable(path: Path) -> None:
    """Raise ``InputError`` where no file can be written at ``path``, before any work is done for it."""
    path = _followed(path)
    folder = path.absolute().parent
    if not folder.is_dir():
        raise InputError(f"expected an existing folder for {path.name}, got {folder}, which does not exist")
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        mode = stat.S_IFREG
    except OSError as error:  # a name that is too long, for one
        raise InputError(f"cannot write {path.name}: {error.strerror}") from None
    if stat.S_ISDIR(mode):
        raise InputError(f"expected a file to write, got the folder {path}")
    if not stat.S_ISREG(mode):  # a file would take the place of /dev/null, where root may
        raise InputError(f"expected a file to write, got the device or pipe {path}")
    try:  # root may pass os.access on a read-only file system: try
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise InputError(f"cannot write in {folder}: {error.strerror}") from None


def check_ending(path: Path, ending: str, what: str) -> None:
    """Raise ``InputError`` where a file's name does not say what is written to it."""
    if path.suffix.lower() != ending:
        raise InputError(f"expected a file of {what} that ends in {ending}, got {path.name}")


def check_space(path: Path, n_bytes: int) -> None:
    """Raise ``InputError`` where the disk has no room for a file of so many bytes, before any of it is written."""
    folder = _followed(Path(path)).absolute().parent
    free = shutil.disk_usage(folder).free if folder.is_dir() else n_bytes
    if n_bytes > free:
        raise InputError(
            f"expected {spelled_bytes(n_bytes)} of space for {path}, got {spelled_bytes(free)} in {folder}"
        )


def spelled_bytes(count: int) -> str:
    """Bytes in the unit that a person would take."""
    unit, name = next((each for each in ((1e9, "GB"), (1e6, "MB")) if count >= each[0]), (1e3, "kB"))
    return f"{count / unit:.3g} {name}"


def is_full(error: BaseException | None) -> bool:
    """Whether the disk is full, by an error or what it came from; polars gives the system's number in words alone."""
    if error is None:
        return False
    told = getattr(error, "errno", None) == errno.ENOSPC or f"(os error {errno.ENOSPC})" in str(error)
    return told or is_full(error.__cause__)


def reserve(stream: BinaryIO, n_bytes: int) -> None:
    """Take the space of an open file before it is filled, where the system can: less work than block by block."""
    try:
        os.posix_fallocate(stream.fileno(), 0, n_bytes)
    except AttributeError:  # neither macOS nor Windows has it
        return
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.EOPNOTSUPP):  # of file systems that cannot
            raise


def check_folder(path: Path) -> None:
    """Raise ``InputError`` where no folder can be made or filled at ``path``, before any work is done for it."""
    check_writable(path.absolute() / "any" if path.is_dir() else path)
    if path.exists() and not path.is_dir():
        raise InputError(f"expected a folder to fill, got the file {path}")


def check_apart(outputs: Sequence[Path], inputs: Sequence[Path] = ()) -> None:
    """Raise ``InputError`` where an output would replace an input or another output."""
    read, taken = {path.resolve() for path in inputs}, set[Path]()
    for path in outputs:
        if path.resolve() in read:
            raise InputError(f"expected a file of its own for each output, got the input {path}, which would be lost")
        if path.resolve() in taken:
            raise InputError(f"expected a file of its own for each output, got {path} for two files of this run")
        taken.add(path.resolve())


def check_new(path: Path, option: str) -> None:
    """Raise ``InputError`` where a name that nobody typed would replace a file: what is named by ``option`` may."""
    if os.path.lexists(path):
        raise InputError(f"expected no file {path}, whose name nobody gave, got one: {option} {path} replaces it")


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Give a temporary path beside ``path`` that replaces it when the block ends without an error.

    The temporary name keeps the extension, since writers choose their format by it. A link stays one: what it leads to
    is replaced. Where the disk is full, whatever the writer raises names the file.
    """
    path = _followed(Path(path))
    check_writable(path)
    temporary = path.with_name(f".{path.stem[:SHOWN]}.{os.getpid()}{path.suffix}")
    try:
        yield temporary
        if path.exists():
            _start_writeback(temporary)
        temporary.replace(path)
    except OSError as error:
        if is_full(error):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path)) from error
        raise
    finally:
        temporary.unlink(missing_ok=True)


def _start_writeback(path: Path) -> None:
    """Have the system begin to write a file that is to replace another one to the disk.

    ext4 does so itself lest a power cut leave neither, but not where the space was reserved.
    """
    if hasattr(os, "posix_fadvise"):
        with suppress(OSError), open(path, "rb") as stream:
            os.posix_fadvise(stream.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)


def _followed(path: Path) -> Path:
    """Where a link leads to; what is no link itself."""
    return path.resolve() if os.path.islink(path) else path


def kind(path: str | Path) -> str:
    """What stands for a file or a folder where its name must not be told: ``FILE.nii.gz``, ``FILE`` or ``DIR``."""
    ending = ENDINGS.search(str(path))
    return "FILE" + ending.group(0).lower() if ending else "DIR" if Path(path).is_dir() else "FILE"


def without_names(text: str, names: Mapping[str, str]) -> str:
    """Put words in the place of names in a text, the longest first, where they stand as whole words."""
    for name, word in sorted(names.items(), key=lambda each: -len(each[0])):
        text = re.sub(rf"(?<!\w){re.escape(name)}(?!\w)", word, text)
    return text
