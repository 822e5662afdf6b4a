"""A phantom, scanned and meshed."""

from pathlib import Path
from typing import Annotated

import typer

from gpubspline.cli.app import KNOW, command
from gpubspline.cli.options import OutputOptions, ReportOptions, RunOptions, SamplingOptions, SplineOptions, flattened
from gpubspline.errors import InputError


@command(KNOW, "demo", "demo my_folder")
@flattened
def demo(
    context: typer.Context,
    run: RunOptions,
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="where the files go")] = Path("gpubspline-demo"),
) -> None:
    """Scan the adult femur phantom and make its model: mesh, deck, pictures, figures, report."""
    from gpubspline import pipeline
    from gpubspline.cli import describe
    from gpubspline.ct.phantom_dicom import write_phantom
    from gpubspline.export import write
    from gpubspline.recipe import Source

    if not folder.absolute().parent.is_dir():
        raise InputError(f"expected an existing folder to make {folder.name} in, got {folder.absolute().parent}")
    if folder.exists() and not folder.is_dir():
        raise InputError(f"expected a folder to make, got the file {folder}")
    device, counts = run.open(), "14,24,46"  # the adult femur of the paper's Fig. 4b
    folder.mkdir(exist_ok=True)
    series, deck, picture = folder / "ct", folder / "femur.inp", folder / "femur.png"
    files = OutputOptions(folder / "femur.vtu", folder / "femur.json", picture, "HU", folder / "histogram.png")
    page = ReportOptions(folder / "report.html")
    files.check()
    with run.clock() as clock:
        if not series.is_dir():
            with clock.stage("scan"):
                write_phantom("adult-femur", series, clock.advance)
        fitted = pipeline.fit_patch(Source(series), SplineOptions(control=counts).shaping(3), device, clock)
        model = files.make(fitted.fit.patch, SamplingOptions(nodes=counts).sampling(), device, clock, fitted.body)
        figures = pipeline.summarise(model, device, clock, fitted)
        files.write(model, figures, clock)
        with clock.stage("write"):
            write(model.mesh, deck, law=model.laws)
        known = {"quality": model.counted.quality, "volume": fitted.volume, "laws": list(model.laws.values())}
        page.write(context, clock, f"Mesh of {describe.kind(model.counted)}", model.mesh, figures, **known)
    run.say([*describe.summary_lines(figures), *describe.wrote([series, *files.paths, deck, *page.paths])])
