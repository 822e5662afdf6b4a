"""A row of a manifest as commands: its columns are the options of ``mesh`` and ``solve``, and so are its errors."""

import json
import math
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import typer

from gpubspline.batch.manifest import Subject
from gpubspline.cli.app import USAGE_ERROR, app
from gpubspline.errors import InputError

MESH, SOLVED = "mesh.vtu", "solved.vtu"
"""Names in a subject's folder, where a row does not say another."""

_OURS = ("Run",)
"""Panels of the help whose options are the cohort's, not a row's."""


@cache
def columns() -> dict[str, str]:
    """Options of ``mesh`` and ``solve`` that a manifest may have a column of, and what its cells are."""
    found = {}
    for option in [*_options("mesh").values(), *_options("solve").values()]:
        name, panel = _name(option), getattr(option, "rich_help_panel", None)
        if panel in _OURS or name in ("summary", "help"):
            continue
        is_file = str(option.metavar).startswith("FILE")
        kind = "flag" if getattr(option, "is_flag", False) else "texts" if option.multiple else "text"
        found[name] = ("new file" if panel == "Output" else "file") if is_file else kind
    return found


@cache
def _options(command: str) -> dict[str, Any]:
    """Options of a command by name, as Typer gives them to Click."""
    import_module(f"gpubspline.cli.commands.{command}")  # which joins it to the application
    group: Any = typer.main.get_command(app)
    return {_name(option): option for option in group.commands[command].params if option.opts[0].startswith("--")}


def _name(option: Any) -> str:
    return str(option.opts[0]).removeprefix("--")


def check(subject: Subject, manifest: Path) -> None:
    """Raise ``InputError`` where the commands of a row would not be taken, before any work."""
    where = f"{subject.name}, line {subject.line} of {manifest.name}"
    if "load" not in subject.options:
        for name in subject.options:
            if name not in _options("mesh"):
                raise InputError(f"expected {name} only together with a load for {where}, got no load")
    _check_solvable(subject, where)
    group: Any = typer.main.get_command(app)
    for command, *words in commands(subject, Path("folder"), "auto", {}):
        try:
            group.commands[command].make_context(command, list(words))
        except USAGE_ERROR as error:
            raise InputError(f"expected options of '{command}' for {where}, got: {error.format_message()}") from None


def _check_solvable(subject: Subject, where: str) -> None:
    """Raise ``InputError`` where a row has a load, and its mesh a format that ``solve`` cannot take it from."""
    from gpubspline.export import find_format

    output = subject.options.get("output", MESH)
    if "load" in subject.options:
        form = find_format(output)
        if not (form.readable and form.fields) or output == SOLVED:
            raise InputError(f"expected an output to be solved, such as {MESH}, with the load of {where}, got {output}")


def commands(subject: Subject, folder: Path, device: str, settings: dict[str, str]) -> Iterator[list[str]]:
    """Words of the commands that make the model of a row: ``mesh``, and ``solve`` where it has a load."""
    output = folder / subject.options.get("output", MESH)
    run = [f"--{name}={value}" for name, value in settings.items()]
    run += ["--quiet", *([] if device == "auto" else [f"--device={device}"])]
    own = {name: value for name, value in subject.options.items() if name != "output"}
    made = {name: value for name, value in own.items() if name in _options("mesh") and name != "load"}
    mesh = [word for name, value in made.items() for word in _words(name, value, folder)]
    yield ["mesh", *map(str, subject.inputs), *mesh, f"--output={output}", f"--summary={folder / 'mesh.json'}", *run]
    if "load" in own:
        only = {name: value for name, value in own.items() if name not in made}
        solve = [word for name, value in only.items() for word in _words(name, value, folder)]
        yield ["solve", str(output), *solve, f"--output={folder / SOLVED}", f"--summary={folder / 'solve.json'}", *run]


def _words(name: str, value: str, folder: Path) -> list[str]:
    kind = columns()[name]
    if kind == "flag":
        return [f"--{name}"]
    if kind == "texts":
        return [f"--{name}={each}" for each in value.split(";")]
    return [f"--{name}={folder / value if kind == 'new file' else value}"]


class MakeModel:
    """The task of ``run_cohort``: the commands of a row in this process, and the figures they wrote."""

    def __init__(self, settings: dict[str, str]) -> None:
        self.settings = settings

    def __call__(self, subject: Subject, folder: Path, device: str) -> dict[str, Any]:
        """Make the model in the folder; raises what the commands raise."""
        from gpubspline.cli import commands as known  # noqa: F401  joins them to the application

        for words in commands(subject, folder, device, self.settings):
            app(words, standalone_mode=False)
        names = ("mesh", "solve")
        found = {n: json.loads(path.read_text()) for n in names if (path := folder / f"{n}.json").is_file()}
        if "solve" in found:
            found["solve"]["stiffness_n_per_mm"] = stiffness_n_per_mm(found["solve"])
        return found


def stiffness_n_per_mm(figures: dict[str, Any]) -> float | None:
    """Stiffness of the spring that stores the model's strain energy U under its resultant force F: F^2 / (2 U).

    None where the loads have no resultant, or displacements are what is prescribed.
    """
    force, energy = math.hypot(*figures["applied_n"]), figures["strain_energy_nmm"]
    return force**2 / (2 * energy) if force > 0 and energy > 0 else None
