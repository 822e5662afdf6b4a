"""A convergence study of one body under one load case."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from gpubspline.cli.app import app
from gpubspline.cli.options import (
    ReadOptions,
    RegionOptions,
    RunOptions,
    SamplingOptions,
    SplineOptions,
    StudyOptions,
    flattened,
)
from gpubspline.errors import InputError


@app.command()
@flattened
def study(
    source: Annotated[
        list[Path], typer.Argument(metavar="INPUT...", help="CT, or model file of 'gpubspline fit'", show_default=False)
    ],
    wanted: StudyOptions,
    read: ReadOptions,
    region: RegionOptions,
    spline: SplineOptions,
    sampled: SamplingOptions,
    run: RunOptions,
) -> None:
    """Solve meshes of growing density of one body: what converges, to what, how fast. Run again, it goes on."""
    from gpubspline.analysis.convergence import converge
    from gpubspline.analysis.study import run_study
    from gpubspline.cli import describe, describe_study
    from gpubspline.pipeline import sample_material

    if sampled.nodes is not None or region.slice_index is not None:
        raise InputError("expected --nodes-list for the meshes of a solid, got --nodes or --slice")
    studied, device, sampling = wanted.study(), run.open(), sampled.sampling()
    with run.clock() as clock:
        patch, body = _body(source, read, region, spline, device, clock)

        def make(nodes: tuple[int, int, int]) -> Any:
            return sample_material(patch, replace(sampling, nodes=nodes), device, body)

        made_from = repr((sampling, run.precision))
        where: dict[str, Any] = {"folder": wanted.output, "device": device, "clock": clock, "made_from": made_from}
        found = converge(run_study(studied, patch, make, wanted.samples(patch.shape), **where))
        wanted.write(found, device)
    run.say([*describe_study.study_lines(found), *describe.wrote(wanted.paths)])


def _body(
    source: list[Path], read: ReadOptions, region: RegionOptions, spline: SplineOptions, device: Any, clock: Any
) -> tuple[Any, Any]:
    """Hyperpatch, and what was found in the CT where there is one."""
    from gpubspline.pipeline import fit_patch
    from gpubspline.spline.model import load_model

    if source[0].suffix == ".npz":
        with clock.stage("read"):
            return load_model(source[0]), None
    fitted = fit_patch(region.source(source, read, spline.axis), spline.shaping(3), device, clock)
    return fitted.fit.patch, fitted.body
