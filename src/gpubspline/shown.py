"""What shows a thing in a notebook, found by its name when it is asked for: a stage imports nothing above itself."""

import importlib
from typing import Any


def shown(how: str, thing: Any, *args: Any, **options: Any) -> Any:
    """Call a function of ``report.notebook`` for a volume, a mesh or a quality."""
    return getattr(importlib.import_module("gpubspline.report.notebook"), how)(thing, *args, **options)
