"""How things show themselves: in a notebook by a picture, on a console in one line.

Pictures are found by their name when they are asked for: a stage imports nothing above itself.
"""

import importlib
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np

LISTED = 6
"""Most parts of a list that are told."""


def shown(how: str, thing: Any, *args: Any, **options: Any) -> Any:
    """Call a function of ``report.notebook`` for a volume, a mesh or a quality."""
    return getattr(importlib.import_module("gpubspline.report.notebook"), how)(thing, *args, **options)


def brief(thing: Any) -> str:
    """Tell a dataclass in one line, as its ``__repr__``: of an array type and shape, of a list its first parts."""
    told = (f"{each.name}={_told(getattr(thing, each.name))}" for each in fields(thing) if each.repr)
    return f"{type(thing).__name__}({', '.join(part for part in told if not part.endswith('=None'))})"


def _told(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return f"<{value.dtype} {' x '.join(map(str, value.shape)) or 'scalar'}>"
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key!r}: {_told(each)}" for key, each in value.items()) + "}"
    if isinstance(value, list | tuple):
        more = [f"... of {len(value)}"] * (len(value) > LISTED)
        return "(" + ", ".join([*map(_told, value[:LISTED]), *more]) + (",)" if len(value) == 1 else ")")
    return f"{value:.6g}" if isinstance(value, float) else repr(value)
