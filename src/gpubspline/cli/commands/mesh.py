"""From CT to a mesh with material."""

from gpubspline.cli.app import app
from gpubspline.cli.arguments import InputPaths
from gpubspline.cli.options import (
    OutputOptions,
    ReadOptions,
    RegionOptions,
    RunOptions,
    SamplingOptions,
    SplineOptions,
    flattened,
)


@app.command()
@flattened
def mesh(
    source: InputPaths,
    read: ReadOptions,
    region: RegionOptions,
    spline: SplineOptions,
    sampled: SamplingOptions,
    files: OutputOptions,
    run: RunOptions,
) -> None:
    """Make a mesh with material from CT."""
    from gpubspline import pipeline
    from gpubspline.cli import describe

    files.check(source)
    wanted = region.source(source, read, spline.axis)
    shaping = spline.shaping(3 if region.slice_index is None else 2)
    sampling, device = sampled.sampling(), run.open()
    with run.clock() as clock:
        fitted = pipeline.fit_patch(wanted, shaping, device, clock)
        model = files.make(fitted.fit.patch, sampling, device, clock, fitted.body)
        figures = pipeline.summarise(model, device, clock, fitted)
        files.write(model, figures, clock)
    run.say([*describe.summary_lines(figures), *describe.wrote(files.paths)])
