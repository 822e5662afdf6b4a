"""The application that the commands join."""

import typer

app = typer.Typer(
    name="gpubspline",
    help="CT in, all-hexahedral finite element model out: every node carries x, y, z, HU, density, E and nu.",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
