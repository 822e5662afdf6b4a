"""A mesh under a load case."""

from pathlib import Path
from typing import Annotated

import typer

from gpubspline.cli.app import app
from gpubspline.cli.options import (
    ReadOptions,
    RegionOptions,
    RunOptions,
    SamplingOptions,
    SolveOptions,
    SplineOptions,
    flattened,
)
from gpubspline.cli.solid import find_solid


@app.command()
@flattened
def solve(
    source: Annotated[
        list[Path],
        typer.Argument(metavar="MESH|INPUT...", help="mesh with E_MPa and nu; model file; or CT", show_default=False),
    ],
    wanted: SolveOptions,
    read: ReadOptions,
    region: RegionOptions,
    spline: SplineOptions,
    sampled: SamplingOptions,
    run: RunOptions,
) -> None:
    """Solve a mesh under a load case: displacement, reactions and stress."""
    from gpubspline.analysis.response import respond
    from gpubspline.cli import describe

    case, device = wanted.case(source), run.open()
    with run.clock() as clock:
        solid = find_solid(source, read, region, spline, sampled, device, clock)
        response = respond(solid, case, device, clock, **wanted.how())
        figures = response.figures() | {"backend": device.backend, "device": device.label}
        wanted.write(response, figures, clock)
    run.say([*describe.response_lines(figures), *describe.wrote(wanted.paths)])
