"""Pages of the guide that are made from the code, so that they cannot go stale: commands, laws, examples, changelog."""

import ast
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import typer

import gpubspline as gb
from gpubspline.cli.entry import app

ROOT = Path(__file__).resolve().parents[2]


def commands() -> str:
    """A section a command: what it does, how it is called, its arguments and options by panel."""
    group: Any = typer.main.get_command(app)
    parts = ["# Commands\n", f"{app.info.help}\n", "Made from `gpubspline COMMAND --help`.\n"]
    for name, command in group.commands.items():
        parts += [f"## {name}\n", f"{command.help.strip()}\n", f"```text\n{_usage(name, command)}\n```\n"]
        parts += ["```bash", *command.epilog.splitlines()[1:], "```\n"]
        panels: dict[str, list[Any]] = {}
        for parameter in command.params:
            if parameter.name != "help":
                panel = getattr(parameter, "rich_help_panel", None)
                kind = "Options" if parameter.opts[0].startswith("-") else "Arguments"
                panels.setdefault(panel or kind, []).append(parameter)
        for panel, parameters in panels.items():
            head = "argument" if panel == "Arguments" else "option"
            parts += [f"**{panel}**\n", f"| {head} | takes | |", "|---|---|---|", *map(_row, parameters), ""]
    return "\n".join(parts)


def _usage(name: str, command: Any) -> str:
    words = [_metavar(p) + "..." * (p.nargs < 0) for p in command.params if not p.opts[0].startswith("-")]
    required = [f"{p.opts[0]} {_metavar(p)}" for p in command.params if p.opts[0].startswith("-") and p.required]
    return " ".join(["gpubspline", name, *words, *required, "[OPTIONS]"])


def _metavar(parameter: Any) -> str:
    return str(parameter.metavar or parameter.name.upper())


def _row(parameter: Any) -> str:
    option = parameter.opts[0].startswith("-")
    flag = getattr(parameter, "is_flag", False)
    names = ", ".join(f"`{name}`" for name in parameter.opts) if option else f"`{_metavar(parameter)}`"
    takes = f"`{_metavar(parameter)}`" if option and not flag else ""
    shown = option and not flag and parameter.show_default and parameter.default not in (None, "")
    default = f"; default `{parameter.default}`" if shown and not callable(parameter.default) else ""
    needed = "; required" if option and parameter.required else ""
    text = f"{parameter.help or ''}{default}{needed}"
    return f"| {names} | {takes} | {text} |"


def laws() -> str:
    """A section a law: where it is from, its density, its pieces, what is not confirmed."""
    parts = [(ROOT / "docs" / "scripts" / "laws.md").read_text()]
    for law in gb.laws().values():
        parts += [
            f"## {law.name}\n",
            f"{law.title}.\n",
            "| HU | Young's modulus, MPa | Poisson's ratio |",
            "|---|---|---|",
        ]
        for piece in law.pieces:
            shift = f" {piece.offset_mpa:+g}" if piece.offset_mpa else ""
            power = rf"{piece.factor_mpa:g}\,\rho^{{{piece.exponent:g}}}{shift}"
            parts.append(f"| {piece.lower_hu:.0f} to {piece.upper_hu:.0f} | ${power}$ | {piece.poisson:g} |")
        density = law.density
        line = rf"\rho = {density.slope_g_cm3_per_hu:.6g}\,\mathrm{{HU}} "
        if density.intercept_g_cm3:
            line += f"{density.intercept_g_cm3:+.4g}"
        parts += ["", f"- density: {density.kind}, g/cm3: ${line}$" + (f"; {density.source}" if density.source else "")]
        known = {"site": law.site, "direction": law.direction, "source": law.citation, "notes": law.notes}
        parts += [f"- {name}: {' '.join(text.split())}" for name, text in known.items() if text]
        parts += [f"- jumps at {hu:.0f} HU from {low:.0f} to {high:.0f} MPa" for hu, low, high in law.jumps()]
        parts += [f"- unconfirmed: {what}" for what in law.all_unconfirmed] + [""]
    return "\n".join(parts)


def examples() -> str:
    """The examples: heading, source text, each of them a script that the tests run."""
    parts = [
        "# Examples\n",
        "Scripts of the folder `examples`, run by the tests; start one as `python examples/femur.py`.\n",
    ]
    return "\n".join(parts + [part for path in sorted((ROOT / "examples").glob("*.py")) for part in _example(path)])


def _example(path: Path) -> Iterator[str]:
    text = path.read_text()
    module = ast.parse(text)
    title, _, rest = (ast.get_docstring(module) or "").partition("\n\n")
    head, _, more = rest.partition("\n\n")
    yield f"## {title.rstrip('.')}\n"
    for name, words in re.findall(r"^(Equation|Source|Figure):\s+(.*?)(?=^\w+:|\Z)", head, re.M | re.S):
        yield f"- {name.lower()}: {' '.join(words.split())}"
    yield f"\n{more}\n" if more else ""
    yield f'```python title="examples/{path.name}"\n{body(f"examples/{path.name}")}\n```\n'


def body(name: str) -> str:
    """Text of a file of the tree; of an example without its heading, which stands beside it."""
    text = (ROOT / name).read_text()
    if not re.fullmatch(r"examples/\w+\.py", name):
        return text.strip()
    return text.split("\n", ast.parse(text).body[0].end_lineno or 0)[-1].strip()


def changelog() -> str:
    """What the README tells of each version."""
    text = (ROOT / "README.md").read_text()
    return "# Changelog\n" + text.partition("\n## Changelog\n")[2]


PAGES: dict[str, Callable[[], str]] = {
    "commands.md": commands,
    "laws.md": laws,
    "examples.md": examples,
    "changelog.md": changelog,
}
