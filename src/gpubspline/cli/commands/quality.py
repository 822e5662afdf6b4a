"""The elements of a mesh file, judged."""

from pathlib import Path
from typing import Annotated

import typer

from gpubspline.cli.app import JUDGE, command
from gpubspline.cli.options import ReportOptions, RunOptions, flattened
from gpubspline.cli.options.groups import option
from gpubspline.files import check_apart, check_writable

SummaryOutput = Annotated[Path | None, option("Output", "figures, .json", metavar="FILE")]
HistogramOutput = Annotated[Path | None, option("Output", "scaled Jacobians, .png", metavar="FILE")]


@command(JUDGE, "quality femur.vtu", "quality femur.inp --histogram femur.png --summary femur.json")
@flattened
def quality(
    context: typer.Context,
    mesh: Annotated[Path, typer.Argument(metavar="MESH", help="any mesh file meshio reads", show_default=False)],
    page: ReportOptions,
    run: RunOptions,
    summary: SummaryOutput = None,
    histogram: HistogramOutput = None,
) -> None:
    """Judge the elements of a mesh file by their scaled Jacobian, and whether hexes are valid throughout."""
    from gpubspline.cli import describe
    from gpubspline.export import read_mesh
    from gpubspline.mesh.quality import assess
    from gpubspline.mesh.validity import certify
    from gpubspline.report.histogram import write_histogram
    from gpubspline.report.sheet import check_png
    from gpubspline.report.summary import check_json, write_summary

    written = [path for path in (summary, histogram) if path]
    for path in written:
        check_writable(path)
    check_apart(written, [mesh])
    page.check([mesh, *written])
    if summary:
        check_json(summary)
    if histogram:
        check_png(histogram)
    device = run.open()
    with run.clock() as clock:
        with clock.stage("read"):
            found = read_mesh(mesh)
        with clock.stage("quality"):
            found, judged = assess(found, device)
            inside = certify(found, device).certificate if found.element.dimension == 3 else None
        figures = describe.quality_figures(found, judged, inside)
        page.write(context, clock, f"Quality of {describe.kind(found)}", found, figures, quality=judged)
    if summary:
        write_summary(figures, summary)
    if histogram:
        write_histogram(judged, histogram)
    run.say(
        [
            *describe.quality_lines(found, judged),
            *describe.validity_lines(inside.to_dict() if inside else None),
            *describe.wrote([*written, *page.paths]),
        ]
    )
