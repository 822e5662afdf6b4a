"""The hexes or quads of a mesh file, made better."""

from pathlib import Path
from typing import Annotated

import typer

from gpubspline.cli.app import JUDGE, command
from gpubspline.cli.options import ReportOptions, RunOptions, flattened
from gpubspline.cli.options.groups import option
from gpubspline.files import check_apart, check_writable


@command(JUDGE, "optimize femur.vtu -o better.vtu", "optimize femur.vtu --surface stay -o better.inp")
@flattened
def optimize(
    context: typer.Context,
    mesh: Annotated[
        Path, typer.Argument(metavar="MESH", help="mesh file of hex8 or quad4, such as .vtu", show_default=False)
    ],
    output: Annotated[
        Path,
        option("Output", "mesh or deck, by extension", "--output", "-o", metavar="FILE", show_default=False),
    ],
    page: ReportOptions,
    run: RunOptions,
    surface: Annotated[
        str,
        option("Mesh", "nodes of the surface go along it as it is, or do not move", metavar="slide|stay"),
    ] = "slide",
    summary: Annotated[Path | None, option("Output", "figures, .json", metavar="FILE")] = None,
    allow_inverted: Annotated[
        bool, option("Output", "write a mesh with inverted elements, too", "--allow-inverted")
    ] = False,
) -> None:
    """Raise the worst scaled Jacobian of a mesh of hexes or quads by moving its nodes."""
    from gpubspline.cli import describe
    from gpubspline.export import read_mesh, write
    from gpubspline.mesh.optimize import optimize as improved
    from gpubspline.mesh.quality import assess
    from gpubspline.report.page.compared import compared
    from gpubspline.report.summary import check_json, write_summary

    written = [output, *([summary] if summary else [])]
    for path in written:
        check_writable(path)
    check_apart(written, [mesh])
    page.check([mesh, *written])
    if summary:
        check_json(summary)
    device = run.open()
    with run.clock() as clock:
        with clock.stage("read"):
            found = read_mesh(mesh)
        with clock.stage("optimize"):
            made, report = improved(found, device, boundary=surface)
            made, judged = assess(made, device)
        if not allow_inverted:
            judged.check("--surface slide" if surface == "stay" else "'gpubspline mesh --method blocks'")
        with clock.stage("write"):
            write(made, output)
        figures = {**describe.quality_figures(made, judged, None), "optimized": report.to_dict()}
        if page.report:
            moved = (
                f"Nodes went up to {report.farthest_mm:.3g} mm, the surface stayed within {report.boundary_mm:.2g} mm."
            )
            tables = [compared(assess(found, device)[1], judged, "Before and after", moved)]
            title = f"Optimized: {describe.kind(made)}"
            page.write(context, clock, title, made, figures, quality=judged, tables=tables)
    if summary:
        write_summary(figures, summary)
    run.say(
        [
            *describe.quality_lines(made, judged),
            f"optimized  worst scaled Jacobian from {report.before:.3f} to {report.after:.3f}; nodes went up to "
            f"{report.farthest_mm:.3g} mm, the surface stayed within {report.boundary_mm:.2g} mm",
            *describe.wrote([*written, *page.paths]),
        ]
    )
