"""The help of every command: its options stand in panels, in the order in which a person thinks."""

import re
import shlex
from collections.abc import Callable
from typing import Any

import pytest
import typer

from gpubspline.cli.entry import app
from gpubspline.cli.options.groups import PANELS

Command = Callable[..., tuple[int, str, str]]
GROUP: Any = typer.main.get_command(app)
NAMES = [each.name or each.callback.__name__ for each in app.registered_commands if each.callback]


def test_all_commands_are_looked_at() -> None:
    assert {"mesh", "fit", "sample", "quality", "solve", "study", "optimize", "view", "export"} <= set(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_panels_come_in_the_order_of_thought(run: Command, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "100")
    status, out, err = run(name, "--help")
    assert (status, err) == (0, "")
    panels = [panel for panel in re.findall(r"^╭─ (\w+) ─", out, re.M) if panel not in ("Arguments", "Options")]
    assert set(panels) <= set(PANELS)
    assert panels == sorted(panels, key=PANELS.index)


@pytest.mark.parametrize("name", ["mesh", "fit", "sample", "quality", "solve", "study", "optimize", "view", "export"])
def test_what_is_written_stands_under_output(run: Command, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "100")
    parts = re.split(r"^╭─ (\w+) ─.*$", run(name, "--help")[1], flags=re.M)
    under = dict(zip(parts[1::2], parts[2::2], strict=True))
    assert "--output" in under["Output"] or "--summary" in under["Output"]
    assert re.findall(r"^│ [* ]  ?(--\w+)", under["Options"], re.M) in (["--help"], [])


@pytest.mark.parametrize("name", ["mesh", "solve", "optimize", "preview"])
def test_where_to_is_the_first_option_of_output(run: Command, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "100")
    assert re.search(r"─ Output ─.*\n│ \*  --output ", run(name, "--help")[1])


def test_commands_come_in_the_order_of_the_work(run: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    out = run("--help")[1]
    headings = re.findall(r"^╭─ ([^─]+?) ─", out, re.M)
    assert headings[:4] == ["Options", "Look at what there is", "Make a mesh", "Judge it and make it better"]
    places = [out.index(f"│ {name} ") for name in ("info", "mesh", "quality", "solve", "batch", "backends", "demo")]
    assert places == sorted(places) and "<bool>" not in out
    assert sorted(re.findall(r"^│ (\w+) {2,}", out, re.M)) == sorted(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_the_examples_at_the_foot_are_commands(run: Command, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each is taken by the command that it stands under, and fits a line of a terminal."""
    monkeypatch.setenv("COLUMNS", "80")
    examples = GROUP.commands[name].epilog.splitlines()[1:]
    out = run(name, "--help")[1]
    assert examples and all(f"\n {line} " in out for line in examples) and "<" not in out
    for line in examples:
        program, command, *words = shlex.split(line)
        assert (program, command) == ("gpubspline", name)
        GROUP.commands[name].make_context(name, words)


@pytest.mark.parametrize("name", NAMES)
def test_what_an_option_is_when_it_is_not_given_is_said(name: str) -> None:
    """Whatever takes a value has a default in its help, or is a file that is written where it is asked for."""
    untold = [
        option.opts[0]
        for option in GROUP.commands[name].params
        if option.param_type_name == "option" and not option.required and not option.is_flag
        if option.default is None and option.show_default != "all"
        if "(default: " not in (option.help or "") and option.rich_help_panel != "Output"
    ]
    assert set(untold) <= {"--load", "--compare", "--spacing"}, untold
