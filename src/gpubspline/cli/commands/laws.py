"""The material laws."""

from gpubspline.cli.app import app
from gpubspline.cli.options import RunOptions


@app.command()
def laws() -> None:
    """List the material laws."""
    from gpubspline.cli import describe
    from gpubspline.material.registry import laws as registered

    RunOptions().say(
        [line for law in registered().values() for line in describe.law_lines(law)] + describe.step_lines()
    )
