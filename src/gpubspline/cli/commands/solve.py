"""A mesh under a load case."""

from pathlib import Path
from typing import Annotated

import typer

from gpubspline.cli.app import app
from gpubspline.cli.options import (
    ReadOptions,
    RegionOptions,
    ReportOptions,
    RunOptions,
    SamplingOptions,
    SolveOptions,
    SplineOptions,
    flattened,
)
from gpubspline.cli.solid import find_model


@app.command()
@flattened
def solve(
    context: typer.Context,
    source: Annotated[
        list[Path],
        typer.Argument(metavar="MESH|INPUT...", help="mesh with E_MPa and nu; model file; or CT", show_default=False),
    ],
    wanted: SolveOptions,
    read: ReadOptions,
    region: RegionOptions,
    spline: SplineOptions,
    sampled: SamplingOptions,
    page: ReportOptions,
    run: RunOptions,
) -> None:
    """Solve a mesh under a load case: displacement, reactions and stress."""
    from gpubspline.analysis.response import respond
    from gpubspline.cli import describe
    from gpubspline.mesh.quality import assess

    case, device = wanted.case([*source, *region.files, *sampled.files]), run.open()
    page.check([*source, *wanted.paths])
    with run.clock() as clock:
        solid = find_model(source, read, region, spline, sampled, device, clock)
        response = respond(solid.mesh, case, device, clock, **wanted.how())
        figures = response.figures() | {"backend": device.backend, "device": device.label}
        wanted.write(response, figures, clock)
        if page.report:
            judged, quality = assess(response.mesh, device)
            known = {"quality": quality, "volume": solid.volume, "laws": [solid.law] if solid.law else []}
            title = f"{case.title or case.name}: {describe.kind(judged)} solved"
            page.write(context, clock, title, judged, figures, **known)
    run.say([*describe.response_lines(figures), *describe.wrote([*wanted.paths, *page.paths])])
