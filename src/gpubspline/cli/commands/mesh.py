"""From CT to a mesh with material."""

import typer

from gpubspline.cli.app import app
from gpubspline.cli.arguments import InputPaths
from gpubspline.cli.options import (
    DeckOptions,
    OutputOptions,
    ReadOptions,
    RegionOptions,
    ReportOptions,
    RunOptions,
    SamplingOptions,
    SplineOptions,
    flattened,
)


@app.command()
@flattened
def mesh(
    context: typer.Context,
    source: InputPaths,
    read: ReadOptions,
    region: RegionOptions,
    spline: SplineOptions,
    sampled: SamplingOptions,
    files: OutputOptions,
    deck: DeckOptions,
    page: ReportOptions,
    run: RunOptions,
) -> None:
    """Make a mesh with material from CT."""
    from gpubspline import pipeline
    from gpubspline.cli import describe

    files.check(source, deck)
    page.check([*source, *files.paths])
    wanted = region.source(source, read, spline.axis)
    shaping = spline.shaping(3 if region.slice_index is None else 2)
    sampling, device = sampled.sampling(), run.open()
    with run.clock() as clock:
        fitted = pipeline.fit_patch(wanted, shaping, device, clock)
        model = files.make(fitted.fit.patch, sampling, device, clock, fitted.body)
        figures = pipeline.summarise(model, device, clock, fitted)
        files.write(model, figures, clock)
        known = {"quality": model.counted.quality, "volume": fitted.volume, "laws": [model.law]}
        page.write(context, clock, f"Mesh of {describe.kind(model.counted)}", model.mesh, figures, **known)
    run.say(
        [*describe.summary_lines(figures), *describe.deck_lines(figures), *describe.wrote([*files.paths, *page.paths])]
    )
