"""A CT of an analytic body."""

from pathlib import Path
from typing import Annotated

import typer

from gpubspline.cli.app import KNOW, command
from gpubspline.cli.options import RunOptions
from gpubspline.cli.options.groups import completion, option

PHANTOMS = "child-femur|adult-femur|head"


@command(KNOW, "phantom adult-femur femur_ct", "phantom head head_ct")
def phantom(
    name: Annotated[str, typer.Argument(metavar=PHANTOMS, show_default=False, autocompletion=completion(PHANTOMS))],
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="new folder of the series", show_default=False)],
    quiet: Annotated[bool, option("Run", "print errors only", "--quiet", "-q")] = False,
) -> None:
    """Write a DICOM CT series of an analytic body."""
    from gpubspline.ct.phantom_dicom import write_phantom

    run = RunOptions(quiet=quiet)
    with run.clock() as clock, clock.stage("scan"):
        files = write_phantom(name, folder, clock.advance)
    run.say([f"wrote {len(files)} slices in {folder}"])
