"""Tables of TOML files: read, and checked against what their keys should hold."""

import importlib
import sys
from pathlib import Path
from typing import Any

from gpubspline.errors import InputError

KINDS = {float: "a number", str: "a text", list: "a list", dict: "a table"}


def read_text(path: Path, what: str) -> str:
    """Text of a file in UTF-8; raises InputError, which calls the file ``what``, where there is none."""
    try:
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(f"cannot read the {what} {path}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise InputError(f"expected a {what} in UTF-8 text, got something else in {path}") from None


def parse(text: str, source: str) -> dict[str, Any]:
    """Tables of a TOML text; raises InputError, which calls the text ``source``, where it is none."""
    # tomllib is in Python since 3.11, tomli is the same code for 3.10
    toml = importlib.import_module("tomllib" if sys.version_info >= (3, 11) else "tomli")
    try:
        tables: dict[str, Any] = toml.loads(text)
    except toml.TOMLDecodeError as error:
        raise InputError(f"expected TOML in {source}, got a text with an error: {error}") from None
    return tables


def checked(table: Any, where: str, required: dict[str, type], optional: dict[str, type]) -> dict[str, Any]:
    """Copy a table that has every required key, no unknown key, and values of the right types.

    Arguments
    ---------
    table: what stands where a table is expected.
    where: what to call it in an error.
    required, optional: float, str, list or dict by key; whole numbers are numbers, too.

    Raises
    ------
    InputError, one line that names the key.
    """
    if not isinstance(table, dict):
        raise InputError(f"expected a table for {where}, got {table!r}")
    known = required | optional
    for key in [key for key in required if key not in table] + [key for key in table if key not in known]:
        problem = "which is unknown" if key in table else "missing"
        raise InputError(f"expected the keys {', '.join(known)} in {where}, got {key!r} {problem}")
    for key, value in table.items():
        if not is_a(value, known[key]):
            raise InputError(f"expected {KINDS[known[key]]} for {key} in {where}, got {value!r}")
    return dict(table)


def is_a(value: Any, kind: type) -> bool:
    """Whether a value of a table is of a kind: float, a finite number; str, list or dict."""
    if kind is float:
        return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= sys.float_info.max
    return isinstance(value, kind)


def pair(value: Any, where: str) -> tuple[float, float]:
    """Two numbers of a table; raises InputError for anything else."""
    if not (isinstance(value, list) and len(value) == 2 and all(is_a(number, float) for number in value)):
        raise InputError(f"expected two numbers in {where}, got {value!r}")
    return float(value[0]), float(value[1])
