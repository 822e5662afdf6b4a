"""The help of every command: its options stand in panels, in the order in which a person thinks."""

import re
from collections.abc import Callable

import pytest

from gpubspline.cli.entry import app
from gpubspline.cli.options.groups import PANELS

Command = Callable[..., tuple[int, str, str]]
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
