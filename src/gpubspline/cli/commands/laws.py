"""The material laws."""

from gpubspline.cli.app import app
from gpubspline.cli.options import RunOptions


@app.command()
def laws() -> None:
    """List the material laws."""
    from gpubspline.cli.describe_material import law_lines, step_lines
    from gpubspline.material.registry import laws as registered

    RunOptions().say([line for law in registered().values() for line in law_lines(law)] + step_lines())
