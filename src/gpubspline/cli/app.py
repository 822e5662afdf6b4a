"""The application that the commands join."""

from importlib.metadata import version
from typing import Annotated, Any

import typer

app = typer.Typer(
    name="gpubspline",
    help="CT in, all-hexahedral finite element model out: every node carries x, y, z, HU, density, E and nu.",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

USAGE_ERROR: Any = typer.BadParameter.__mro__[2]
"""Click's ``ClickException``, which Typer brings along in a copy of its own or not, by its version."""


def _tell_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"gpubspline {version('gpubspline')}")
        raise typer.Exit


_VERSION = typer.Option("--version", help="Show the version and exit.", callback=_tell_version, is_eager=True)


@app.callback()
def _of_all(told: Annotated[bool, _VERSION] = False) -> None:
    pass
