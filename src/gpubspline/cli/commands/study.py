"""A convergence study of one body under one load case."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from gpubspline.cli.app import SOLVE, command
from gpubspline.cli.options import (
    ReadOptions,
    RegionOptions,
    ReportOptions,
    RunOptions,
    SamplingOptions,
    SplineOptions,
    StudyOptions,
    flattened,
)
from gpubspline.cli.solid import is_model
from gpubspline.errors import InputError


@command(
    SOLVE,
    "study dicom_folder --threshold 250 --load stance -o study",
    "study femur.npz --load stance --nodes-list '8x8x9 12x12x17' -o s",
)
@partial(flattened, without=("nodes", "slice_index", "optimize"))  # it samples solids, --nodes-list times
def study(
    context: typer.Context,
    source: Annotated[
        list[Path], typer.Argument(metavar="INPUT", help="CT, or model file of 'gpubspline fit'", show_default=False)
    ],
    wanted: StudyOptions,
    read: ReadOptions,
    region: RegionOptions,
    spline: SplineOptions,
    sampled: SamplingOptions,
    page: ReportOptions,
    run: RunOptions,
) -> None:
    """Solve meshes of growing density of one body: what converges, to what, how fast. Run again, it goes on."""
    from gpubspline.analysis.convergence import converge
    from gpubspline.analysis.loads import check_on_body
    from gpubspline.analysis.study import identity, run_study
    from gpubspline.cli import describe, describe_study
    from gpubspline.pipeline import calibrate, label_arrays, sample_material

    page.check([*source, *region.files, *sampled.files])
    studied, device, sampling = wanted.study(), run.open(), sampled.sampling(region.labels)
    if region.labels is not None and not sampling.law_by_label:
        raise InputError("expected a --law LABEL=LAW with --labels, which a study has no other use for, got none")
    with run.clock() as clock:
        patch, body = _body(source, read, region, spline, sampled.surface_depth, device, clock)
        if body is not None:
            check_on_body(studied.case, body.region)
        labels = [] if body is None else label_arrays(sampling, body)
        sampling, _ = calibrate(sampling, body)  # once, and the key has what came of it, not where its files lie

        def make(nodes: tuple[int, int, int]) -> Any:
            return sample_material(patch, replace(sampling, nodes=nodes), device, body)

        scan = () if body is None or body.volume is None else (body.volume.hu, body.volume.affine)
        made_from = identity(
            patch, sampling, run.precision, arrays=[*scan, *labels]
        )  # other mappings than nodal read the CT
        where: dict[str, Any] = {"folder": wanted.output, "device": device, "clock": clock, "made_from": made_from}
        found = converge(run_study(studied, patch, make, wanted.samples(patch.shape), **where))
        wanted.write(found, device)
        if page.report:
            _report(context, page, found, make(found.models[-1]["samples"]), sampling, body, device, clock)
    run.say([*describe_study.study_lines(found), *describe.wrote([*wanted.paths, *page.paths])])


def _report(
    context: typer.Context,
    page: ReportOptions,
    found: Any,
    finest: Any,
    sampling: Any,
    body: Any,
    device: Any,
    clock: Any,
) -> None:
    """Write the page: the table and curves of the study, and its finest mesh."""
    from gpubspline.cli import describe
    from gpubspline.mesh.quality import assess
    from gpubspline.report.page.study import study_parts

    judged, quality = assess(finest, device)
    figures = {key: value for key, value in found.to_dict().items() if key not in ("models", "limits")}
    figures |= {"backend": device.backend, "device": device.label}
    known: dict[str, Any] = {"quality": quality, "laws": [sampling.law, *sampling.law_by_label.values()]} | study_parts(
        found
    )
    case = found.models[-1]["load_case"]
    title = f"{case['title'] or case['name']}: {len(found.models)} meshes, the finest of {describe.kind(judged)}"
    volume = None if body is None else body.volume
    page.write(context, clock, title, judged, figures, volume=volume, **known)


def _body(
    source: list[Path],
    read: ReadOptions,
    region: RegionOptions,
    spline: SplineOptions,
    depth: float | None,
    device: Any,
    clock: Any,
) -> tuple[Any, Any]:
    """Hyperpatch, and what was found in the CT where there is one."""
    from gpubspline.pipeline import fit_patch
    from gpubspline.spline.model import load_model

    if is_model(source, read, region, spline):
        with clock.stage("read"):
            return load_model(source[0]), None
    fitted = fit_patch(region.source(source, read, spline, depth), spline.shaping(3), device, clock)
    return fitted.fit.patch, fitted.body
