"""From a model file to a mesh."""

from pathlib import Path
from typing import Annotated

import typer

from gpubspline.cli.app import MAKE, command
from gpubspline.cli.options import DeckOptions, OutputOptions, RunOptions, SamplingOptions, flattened


@command(
    MAKE, "sample femur.npz --nodes 40,60,120 -o fine.vtu", "sample femur.npz --nodes 14,24,46 --order 2 -o femur.inp"
)
@flattened
def sample(
    model: Annotated[Path, typer.Argument(metavar="MODEL", help="model file of 'gpubspline fit'", show_default=False)],
    sampled: SamplingOptions,
    files: OutputOptions,
    deck: DeckOptions,
    run: RunOptions,
) -> None:
    """Make a mesh of any density from a model file, without the CT."""
    from gpubspline import pipeline
    from gpubspline.cli import describe
    from gpubspline.spline.model import load_model

    files.check([model, *sampled.files], deck)
    sampling, device = sampled.sampling(), run.open()
    with run.clock() as clock:
        with clock.stage("read"):
            patch = load_model(model)
        made = files.make(patch, sampling, device, clock)
        figures = pipeline.summarise(made, device, clock)
        files.write(made, figures, clock)
    run.say([*describe.summary_lines(figures), *describe.deck_lines(figures), *describe.wrote(files.paths)])
