"""What became of a subject: a JSON file in its folder, written last, so that what has one is complete."""

import json
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from gpubspline.files import whole_file

FILE = "record.json"


@dataclass(frozen=True)
class Record:
    """What became of a subject.

    Attributes
    ----------
    subject, fingerprint: whose, and what it was made from.
    error: why there is no model, one line; empty where there is one.
    lasting: whether the error is one of the input, which would come again.
    figures: of the run, by command: plain numbers, texts, lists and dicts.
    warnings: one line each.
    files: names in the subject's folder.
    device, worker: where it ran; the device as it was asked for.
    seconds: wall time, all in all.
    kept: whether it is of an earlier run; never stored.
    """

    subject: str
    fingerprint: str
    error: str = ""
    lasting: bool = True
    figures: dict[str, Any] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    files: tuple[str, ...] = ()
    device: str = ""
    worker: str = ""
    seconds: float = 0.0
    kept: bool = False

    @property
    def failed(self) -> bool:
        """Whether there is no model."""
        return bool(self.error)


def write_record(record: Record, folder: Path) -> None:
    """Write the record of the subject whose folder this is."""
    known = asdict(record)
    del known["kept"]
    with whole_file(folder / FILE) as temporary:
        temporary.write_text(json.dumps(known, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")


def read_record(folder: Path) -> Record | None:
    """Record of a subject's folder; None where there is none, or one that this version does not know."""
    try:
        known = json.loads((folder / FILE).read_text(encoding="utf-8"))
        record = Record(**known)
    except (OSError, ValueError, TypeError):
        return None
    return replace(record, warnings=tuple(record.warnings), files=tuple(record.files), kept=True)


def find_valid(folder: Path, fingerprint: str, retry: bool = False) -> Record | None:
    """Record that need not be made again: of the same inputs and options, its files all there.

    An error of the input stays one, unless ``retry``; of anything else (memory, a disk that is full) does not count.
    """
    record = read_record(folder)
    if record is None or record.fingerprint != fingerprint:
        return None
    if record.failed:
        return record if record.lasting and not retry else None
    return record if all((folder / name).is_file() for name in record.files) else None
