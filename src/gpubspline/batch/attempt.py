"""One subject on one worker: its folder appears whole or not at all, and its log says what was tried."""

import re
import shutil
import time
import traceback
import warnings
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gpubspline.batch.manifest import LOGS, Subject
from gpubspline.batch.record import FILE, Record, find_valid, write_record
from gpubspline.errors import BackendUnavailable, GpubsplineError, GpubsplineWarning
from gpubspline.files import kind, without_names

Task = Callable[[Subject, Path, str], dict[str, Any]]
"""Makes the model of a subject in a folder on a device, and gives its figures: a function that can be pickled."""

STARTED = "started by"

_UID = re.compile(r"(?<![\w.])[0-2](\.\d+){5,}")
"""Of DICOM, which leads to a scan, and so to a patient."""


@dataclass(frozen=True)
class Order:
    """A subject to be worked on.

    Attributes
    ----------
    subject, fingerprint: who, and what the model depends on.
    folder: of the cohort; the subject's is below it.
    retry: whether an error of an earlier run is to be tried again.
    """

    subject: Subject
    fingerprint: str
    folder: Path
    retry: bool = False


def attempt(order: Order, task: Task, device: str, worker: str) -> Record:
    """Make the model of a subject, unless it is there: a worker may die after the work and before it told of it.

    Whatever goes wrong with the subject is in the record, without the names of its files, which may be a patient's: the
    log has them.
    """
    subject, folder = order.subject, order.folder / order.subject.name
    found = find_valid(folder, order.fingerprint, order.retry)
    if found is not None:
        return found
    partial = folder.with_name(f".{folder.name}.partial")
    shutil.rmtree(partial, ignore_errors=True)
    partial.mkdir()
    log = _log(order)
    _note(log, f"{STARTED} {worker} on {device}")
    start = time.perf_counter()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("ignore")
        warnings.simplefilter("always", GpubsplineWarning)
        made = _outcome(task, subject, partial, device, log)
    told = tuple(dict.fromkeys(_one_line(str(w.message)) for w in caught))
    files = tuple(sorted(path.name for path in partial.iterdir() if path.is_file()))
    seconds = time.perf_counter() - start
    error = made.get("error", "")
    kept = {"error": _nameless(error, subject), "warnings": tuple(_nameless(text, subject) for text in told)}
    made |= {**kept, "files": files, "device": device, "worker": worker, "seconds": seconds}
    record = Record(subject.name, order.fingerprint, **made)
    write_record(record, partial)
    _replace(folder, partial)
    for text in told:
        _note(log, f"warning: {text}")
    _note(log, f"failed after {seconds:.1f} s: {error}" if record.failed else f"finished in {seconds:.1f} s")
    return record


def _outcome(task: Task, subject: Subject, partial: Path, device: str, log: Path) -> dict[str, Any]:
    try:
        return {"figures": task(subject, partial, device)}
    except Exception as error:  # a subject may fail in any way: it is recorded, and the others go on
        for path in partial.iterdir():  # of a failure nothing is kept
            path.unlink()
        expected = isinstance(error, GpubsplineError)
        if not expected:
            _note(log, "".join(traceback.format_exception(error)).rstrip())
        lasting = expected and not isinstance(error, BackendUnavailable)
        return {"error": describe(error), "lasting": lasting}


def describe(error: BaseException) -> str:
    """One line about an error; of one that is not ours with its kind."""
    if isinstance(error, MemoryError):
        return "not enough memory: ask for fewer nodes or fewer workers"
    text = _one_line(str(error))
    return text if isinstance(error, GpubsplineError) and text else f"{type(error).__name__}: {text}"


def _nameless(text: str, subject: Subject) -> str:
    """Without the paths of a subject's files, the names of those in its folders, but for mere numbers, and UIDs."""
    files = [each for path in subject.files for each in (path.rglob("*") if path.is_dir() else [path])]
    said = [path for path in files if path.name in text and len(path.name) > 2 and any(map(str.isalpha, path.name))]
    names = {str(path): kind(path) for path in subject.files} | {path.name: kind(path) for path in said}
    return _UID.sub("UID", without_names(text, names))


def _one_line(text: str) -> str:
    return " ".join(text.split())


def _replace(folder: Path, partial: Path) -> None:
    """Put the new folder in the place of the old one."""
    old = folder.with_name(f".{folder.name}.old")
    shutil.rmtree(old, ignore_errors=True)
    with suppress(FileNotFoundError):
        folder.rename(old)
    partial.rename(folder)
    shutil.rmtree(old, ignore_errors=True)


def is_ours(folder: Path) -> bool:
    """Whether a subject's folder may be replaced: there is none, or one of an earlier run, or an empty one."""
    return not folder.exists() or (folder.is_dir() and ((folder / FILE).is_file() or not any(folder.iterdir())))


def count_starts(order: Order) -> int:
    """How often the work on a subject was begun, in this run and in earlier ones, by its log."""
    try:
        return sum(f" {STARTED} " in line for line in _log(order).read_text(encoding="utf-8").splitlines())
    except OSError:
        return 0


def _log(order: Order) -> Path:
    return order.folder / LOGS / f"{order.subject.name}.txt"


def _note(log: Path, text: str) -> None:
    log.parent.mkdir(exist_ok=True)
    with log.open("a", encoding="utf-8") as file:
        file.write(f"{time.strftime('%Y-%m-%d %H:%M:%S')} {text}\n")
