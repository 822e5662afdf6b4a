"""The application that the commands join."""

from typing import Any

import typer

app = typer.Typer(
    name="gpubspline",
    help="CT in, all-hexahedral finite element model out: every node carries x, y, z, HU, density, E and nu.",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

USAGE_ERROR: Any = typer.BadParameter.__mro__[2]
"""Click's ``ClickException``, which Typer brings along in a copy of its own or not, by its version."""
