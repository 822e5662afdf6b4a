"""The paper's results on the phantoms."""

from pathlib import Path
from typing import Annotated

import typer

from gpubspline.cli.app import KNOW, command
from gpubspline.cli.options import RunOptions, flattened
from gpubspline.cli.options.groups import option


@command(KNOW, "reproduce -o paper", "reproduce -o paper --only fig3 --only fig13")
@flattened
def reproduce(
    folder: Annotated[
        Path,
        option(
            "Output",
            "reproduce.html, reproduce.json, pictures, scans; what is there is kept",
            "--output",
            "-o",
            metavar="DIR",
            show_default=False,
        ),
    ],
    run: RunOptions,
    only: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="fig3 to fig11 or fig13; may be given again", show_default="all"),
    ] = None,
) -> None:
    """Make the paper's figures and tables on the phantoms, with a page that puts its results beside them.

    Run again, it goes on where it stopped.
    """
    from gpubspline.cli import describe, describe_study
    from gpubspline.reproduce.run import NUMBERS, PAGE, reproduce

    device = run.open()
    with run.clock() as clock:
        numbers = reproduce(folder, device, clock, only or ())
    run.say([*describe_study.reproduced_lines(numbers), *describe.wrote([folder / PAGE, folder / NUMBERS])])
