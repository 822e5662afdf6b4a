"""A mesh under a load case."""

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from gpubspline.cli.app import SOLVE, command
from gpubspline.cli.options import (
    MethodOptions,
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


@command(
    SOLVE,
    "solve femur.vtu --load stance -o stressed.vtu --report run.html",
    "solve ct.nii.gz --mask l3.nii.gz --load press.toml -o pressed.vtu",
)
@partial(flattened, without=("slice_index",))  # quads are not solved
def solve(
    context: typer.Context,
    source: Annotated[
        list[Path],
        typer.Argument(
            metavar="MESH|INPUT",
            help="mesh with E_MPa and nu; model file; CT; or a closed surface in one (--ct)",
            show_default=False,
        ),
    ],
    wanted: SolveOptions,
    read: ReadOptions,
    region: RegionOptions,
    method: MethodOptions,
    spline: SplineOptions,
    sampled: SamplingOptions,
    page: ReportOptions,
    run: RunOptions,
) -> None:
    """Solve a mesh under a load case: displacement, reactions and stress."""
    from gpubspline.analysis.loads import check_on_body
    from gpubspline.analysis.response import respond
    from gpubspline.cautions import warn_of_weight
    from gpubspline.cli import describe
    from gpubspline.mesh.quality import assess

    inputs = [*source, *([method.ct] if method.ct else []), *region.files, *sampled.files]
    case, device = wanted.case(inputs), run.open()
    method.check([*inputs, *wanted.paths])
    page.check([*inputs, *wanted.paths, *method.paths])
    with run.clock() as clock:
        fits = partial(check_on_body, case)
        solid = find_model(source, read, region, method, spline, sampled, device, clock, fits)
        if solid.mesh.density_kind:
            warn_of_weight(case.gravity_mm_s2 is not None, solid.mesh.density_kind)
        response = respond(solid.mesh, case, device, clock, **wanted.how())
        figures = response.figures() | {"backend": device.backend, "device": device.label}
        wanted.write(response, figures, clock)
        if solid.body is not None:
            method.write(solid.body.region, solid.figures, clock)
        if page.report:
            judged, quality = assess(response.mesh, device)
            known = {"quality": quality, "volume": solid.volume, "laws": list((solid.laws or {}).values())}
            title = f"{case.title or case.name}: {describe.kind(judged)} solved"
            page.write(context, clock, title, judged, figures, **known)
    made = [] if solid.figures is None else describe.method_lines(solid.figures["method"], solid.figures["size_mm"])
    written = [*wanted.paths, *method.paths, *page.paths]
    run.say([*made, *describe.response_lines(figures), *describe.wrote(written)])
