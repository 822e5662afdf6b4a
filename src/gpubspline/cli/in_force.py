"""The command and every option in force, told without paths and identifiers, which may lead to a patient."""

import os
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import typer

from gpubspline.files import ENDINGS, kind, without_names
from gpubspline.report.page import Setting

HIDDEN = {"series": "SERIES"}
"""Options whose value identifies a patient, and what stands for it."""


def command(context: typer.Context) -> str:
    """Give what was typed: inputs and files by their kind, options as they were given."""
    words = ["gpubspline", str(context.info_name)]
    for parameter in context.command.params:
        if not _given(context, parameter.name):
            continue
        value = context.params[parameter.name]
        if parameter.param_type_name == "argument":
            words.append(_argument(parameter.name, value))
        elif value is True:
            words.append(parameter.opts[0])
        else:
            words += [part for each in _each(value) for part in (parameter.opts[0], _told(parameter, each))]
    return " ".join(words)


def settings(context: typer.Context) -> list[Setting]:
    """List every option in force, a panel of the help after the other."""
    found = []
    for parameter in context.command.params:
        if parameter.param_type_name == "argument" or parameter.name in (None, "help"):
            continue
        value = context.params.get(parameter.name)
        text = ", ".join(_told(parameter, each) for each in _each(value)) or _default(parameter, context.params)
        panel = getattr(parameter, "rich_help_panel", None) or "Options"
        found.append(Setting(str(panel), parameter.opts[0], text, _given(context, parameter.name)))
    order = list(dict.fromkeys(setting.panel for setting in found))
    return sorted(found, key=lambda setting: order.index(setting.panel))


def without_paths(told: Any, context: typer.Context, folders: bool = True) -> Any:
    """Take the paths of a run, and the names of their files, out of a text, or of the texts of a dict or a list.

    A folder's name may be a word like ``head``, which figures speak of: it stays in them without ``folders``.
    """
    if isinstance(told, dict):
        return {key: without_paths(value, context, folders) for key, value in told.items()}
    if isinstance(told, list | tuple):
        return [without_paths(value, context, folders) for value in told]
    if not isinstance(told, str):
        return told
    paths = [Path(each) for value in context.params.values() for each in _each(value) if _is_path(each)]
    names = {(name, kind(path)) for path in paths for name in (str(path), str(path.absolute()), path.name)}
    names = {(name, word) for name, word in names if name and (folders or ENDINGS.search(name) or os.sep in name)}
    return without_names(told, dict(names))


def _is_path(value: Any) -> bool:
    return isinstance(value, Path) or (isinstance(value, str) and ENDINGS.search(value) is not None)


def _given(context: typer.Context, name: str | None) -> bool:
    source = context.get_parameter_source(name) if name else None
    return source is not None and source.name not in ("DEFAULT", "DEFAULT_MAP")


def _argument(name: str, value: Any) -> str:
    inputs = [each for each in _each(value) if _is_path(each)]
    return " ".join(["INPUT" if name == "source" else kind(each) for each in inputs] or map(str, _each(value)))


def _told(parameter: Any, value: Any) -> str:
    if parameter.name in HIDDEN:
        return HIDDEN[parameter.name]
    if isinstance(value, bool):
        return "yes" if value else "no"
    return kind(value) if _is_path(value) else str(value)


def _each(value: Any) -> Iterable[Any]:
    if value is None:
        return []
    return value if isinstance(value, list | tuple) else [value]


def _default(parameter: Any, params: dict[str, Any]) -> str:
    """What the help says of the default, where it is chosen by the data."""
    masked = params.get("mask") is not None
    if (parameter.name == "threshold" and masked) or (parameter.name == "label" and not masked):
        return "-"
    said = re.search(r"\(default: ([^()]*(?:\([^()]*\))?[^()]*)\)", str(getattr(parameter, "help", "") or ""))
    return said.group(1) if said else "-"
