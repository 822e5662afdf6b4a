"""The command line: one function a command, which hands its options to the pipeline and says what came out."""

import sys
import warnings
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer

from gpubspline.errors import GpubsplineError, GpubsplineWarning, InputError
from gpubspline.files import check_apart, check_writable
from gpubspline.options import (
    MeshOptions,
    OutputOptions,
    ReadOptions,
    RegionOptions,
    RunOptions,
    SolveOptions,
    SplineOptions,
    flattened,
)

app = typer.Typer(
    name="gpubspline",
    help="CT in, all-hexahedral finite element model out: every node carries x, y, z, HU, density, E and nu.",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

USAGE_ERROR: Any = typer.BadParameter.__mro__[2]
"""Click's ``ClickException``, which Typer brings along in a copy of its own or not, by its version."""

InputPaths = Annotated[
    list[Path],
    typer.Argument(metavar="INPUT...", help="DICOM folder or files, NIfTI, NRRD, MetaImage, .npy", show_default=False),
]
ModelOutput = Annotated[
    Path, typer.Option("--output", "-o", metavar="FILE", help="model file, .npz", show_default=False)
]
SummaryOutput = Annotated[Path | None, typer.Option(metavar="FILE", help="figures, .json")]
HistogramOutput = Annotated[Path | None, typer.Option(metavar="FILE", help="scaled Jacobians, .png")]


@app.command()
@flattened
def mesh(
    source: InputPaths,
    read: ReadOptions,
    region: RegionOptions,
    spline: SplineOptions,
    sampled: MeshOptions,
    files: OutputOptions,
    run: RunOptions,
) -> None:
    """Make a mesh with material from CT."""
    from gpubspline import describe, pipeline

    files.check(source)
    wanted = region.source(source, read, spline.axis)
    shaping = spline.shaping(3 if region.slice_index is None else 2)
    sampling, device = sampled.sampling(), run.open()
    with run.clock() as clock:
        fitted = pipeline.fit_patch(wanted, shaping, device, clock)
        model = files.make(fitted.fit.patch, sampling, device, clock, fitted.region)
        figures = pipeline.summarise(model, device, clock, fitted)
        files.write(model, figures, clock)
    run.say([*describe.summary_lines(figures), *describe.wrote(files.paths)])


@app.command()
@flattened
def fit(
    source: InputPaths,
    output: ModelOutput,
    read: ReadOptions,
    region: RegionOptions,
    spline: SplineOptions,
    run: RunOptions,
) -> None:
    """Make a hyperpatch from CT and keep it, to be sampled at any density later."""
    from gpubspline import describe, pipeline
    from gpubspline.spline.model import check_model_path, save_model

    check_model_path(output)
    wanted = region.source(source, read, spline.axis)
    shaping, device = spline.shaping(3 if region.slice_index is None else 2), run.open()
    with run.clock() as clock:
        fitted = pipeline.fit_patch(wanted, shaping, device, clock)
        with clock.stage("write"):
            save_model(fitted.fit.patch, output)
    patch, error = fitted.fit.patch, fitted.fit.error
    run.say([*describe.patch_lines(patch), *describe.fit_lines(error), *describe.wrote([output])])


@app.command()
@flattened
def sample(
    model: Annotated[Path, typer.Argument(metavar="MODEL", help="model file of 'gpubspline fit'", show_default=False)],
    sampled: MeshOptions,
    files: OutputOptions,
    run: RunOptions,
) -> None:
    """Make a mesh of any density from a model file, without the CT."""
    from gpubspline import describe, pipeline
    from gpubspline.spline.model import load_model

    files.check([model])
    sampling, device = sampled.sampling(), run.open()
    with run.clock() as clock:
        with clock.stage("read"):
            patch = load_model(model)
        made = files.make(patch, sampling, device, clock)
        figures = pipeline.summarise(made, device, clock)
        files.write(made, figures, clock)
    run.say([*describe.summary_lines(figures), *describe.wrote(files.paths)])


@app.command()
@flattened
def quality(
    mesh: Annotated[Path, typer.Argument(metavar="MESH", help="any mesh file meshio reads", show_default=False)],
    run: RunOptions,
    summary: SummaryOutput = None,
    histogram: HistogramOutput = None,
) -> None:
    """Judge the elements of a mesh file by their scaled Jacobian."""
    from gpubspline import describe
    from gpubspline.export import read_mesh
    from gpubspline.mesh.quality import assess
    from gpubspline.report.histogram import write_histogram
    from gpubspline.report.sheet import check_png
    from gpubspline.report.summary import write_summary

    written = [path for path in (summary, histogram) if path]
    for path in written:
        check_writable(path)
    check_apart(written, [mesh])
    if histogram:
        check_png(histogram)
    device = run.open()
    with run.clock() as clock:
        with clock.stage("read"):
            found = read_mesh(mesh)
        with clock.stage("quality"):
            found, judged = assess(found, device)
    if summary:
        write_summary(describe.quality_figures(found, judged), summary)
    if histogram:
        write_histogram(judged, histogram)
    run.say(describe.quality_lines(found, judged) + describe.wrote(written))


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
    sampled: MeshOptions,
    run: RunOptions,
) -> None:
    """Solve a mesh under a load case: displacement, reactions and stress."""
    from gpubspline import describe
    from gpubspline.analysis.response import respond

    case, device = wanted.case(source), run.open()
    with run.clock() as clock:
        solid = _solid(source, read, region, spline, sampled, device, clock)
        response = respond(solid, case, device, clock, **wanted.how())
        figures = response.figures() | {"backend": device.backend, "device": device.label}
        wanted.write(response, figures, clock)
    run.say([*describe.response_lines(figures), *describe.wrote(wanted.paths)])


def _solid(
    source: list[Path],
    read: ReadOptions,
    region: RegionOptions,
    spline: SplineOptions,
    sampled: MeshOptions,
    device: Any,
    clock: Any,
) -> Any:
    """Read a mesh file, or make the mesh of a model file or a CT."""
    from gpubspline import pipeline
    from gpubspline.export import can_read, read_mesh
    from gpubspline.spline.model import load_model

    if can_read(source[0]):
        plain = (ReadOptions(), RegionOptions(), SplineOptions(), MeshOptions())
        if len(source) > 1 or (read, region, spline, sampled) != plain:
            raise InputError(f"expected one mesh file, without options that make a mesh, got {source[0].name} and more")
        with clock.stage("read"):
            return read_mesh(source[0])
    if source[0].suffix == ".npz":
        with clock.stage("read"):
            patch = load_model(source[0])
    else:
        shaping = spline.shaping(3 if region.slice_index is None else 2)
        patch = pipeline.fit_patch(region.source(source, read, spline.axis), shaping, device, clock).fit.patch
    return pipeline.sample_patch(patch, sampled.sampling(), device, clock).mesh


@app.command()
@flattened
def info(
    source: Annotated[
        list[Path], typer.Argument(metavar="INPUT...", help="CT, model file (.npz) or mesh file", show_default=False)
    ],
    read: ReadOptions,
) -> None:
    """Say what a CT, a model file or a mesh file holds."""
    from gpubspline import describe
    from gpubspline.export import can_read, read_mesh

    if source[0].suffix == ".npz":
        from gpubspline.spline.model import load_model

        lines = describe.patch_lines(load_model(source[0]))
    elif can_read(source[0]):
        lines = describe.mesh_lines(read_mesh(source[0]))
    else:
        from gpubspline.ct.image import read_volume

        with RunOptions().clock() as clock, clock.stage("read"):
            volume = read_volume(source, progress=clock.advance, **read.reading())
        lines = describe.volume_lines(volume)
    RunOptions().say(lines)


@app.command()
def phantom(
    name: Annotated[str, typer.Argument(metavar="child-femur|adult-femur|head", show_default=False)],
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="new folder of the series", show_default=False)],
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="print errors only")] = False,
) -> None:
    """Write a DICOM CT series of an analytic body."""
    from gpubspline.ct.phantom_dicom import write_phantom

    run = RunOptions(quiet=quiet)
    with run.clock() as clock, clock.stage("scan"):
        files = write_phantom(name, folder, clock.advance)
    run.say([f"wrote {len(files)} slices in {folder}"])


@app.command()
def laws() -> None:
    """List the material laws."""
    from gpubspline import describe
    from gpubspline.material.registry import laws as registered

    RunOptions().say([line for law in registered().values() for line in describe.law_lines(law)])


@app.command()
def backends() -> None:
    """List the devices that kernels can run on."""
    from gpubspline.device import list_devices, open_device

    rows, chosen = list_devices(), open_device().name
    width = max(len(name) for name, _ in rows)
    marked = [f"{'*' if name == chosen else ' '} {name:{width}}  {words}" for name, words in rows]
    RunOptions().say([*marked, "* chosen by --backend auto"])


@app.command()
@flattened
def demo(
    run: RunOptions,
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="where the files go")] = Path("gpubspline-demo"),
) -> None:
    """Scan the adult femur phantom and make its model: mesh, deck, picture, histogram, figures."""
    from gpubspline import describe, pipeline
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
    files = OutputOptions(folder / "femur.vtu", None, folder / "femur.json", picture, "HU", folder / "histogram.png")
    files.check()
    with run.clock() as clock:
        if not series.is_dir():
            with clock.stage("scan"):
                write_phantom("adult-femur", series, clock.advance)
        fitted = pipeline.fit_patch(Source(series), SplineOptions(control=counts).shaping(3), device, clock)
        model = files.make(fitted.fit.patch, MeshOptions(nodes=counts).sampling(), device, clock, fitted.region)
        figures = pipeline.summarise(model, device, clock, fitted)
        files.write(model, figures, clock)
        with clock.stage("write"):
            write(model.mesh, deck, law=model.sampling.law)
    run.say([*describe.summary_lines(figures), *describe.wrote([series, *files.paths, deck])])


@app.command()
def bench(
    only: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="may be given again", show_default="all")
    ] = None,
    device: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="see 'gpubspline backends'; may be given again", show_default="all"),
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="smaller sizes: minutes")] = False,
    json: Annotated[Path | None, typer.Option(metavar="FILE", help="the rows, .json", show_default=False)] = None,
    chart: Annotated[
        Path | None, typer.Option(metavar="FILE", help="time and memory against nodes, .png", show_default=False)
    ] = None,
) -> None:
    """Measure each piece of work beside its peers and the memory bandwidth of this machine."""
    from gpubspline.bench import bench_scale, run

    for path in filter(None, (json, chart)):
        check_writable(path)
    rows, measured = [], run.run(only or (), device or (), "quick" if quick else "full")
    typer.echo(run.heading())
    for row in measured:
        typer.echo(run.line(row))
        rows.append(row)
    if json:
        run.write_json(rows, json)
    if chart:
        bench_scale.draw([row for row in rows if row.name == "scale"], chart)


def main() -> None:
    """Run the command line; whatever is wrong with the input is one line on stderr and exit status 2."""
    warnings.simplefilter("ignore")
    warnings.simplefilter("always", GpubsplineWarning)
    warnings.showwarning = _warn
    try:
        status = app(sys.argv[1:] or ["--help"], standalone_mode=False)
    except USAGE_ERROR as error:
        _fail(error.format_message())
    except typer.Abort:
        _fail("interrupted", 130)
    except GpubsplineError as error:
        _fail(str(error))
    except OSError as error:
        _fail(f"cannot use {error.filename}: {error.strerror}" if error.filename else str(error))
    except MemoryError:
        _fail("not enough memory: ask for fewer nodes, or crop the CT with --box")
    sys.exit(status if isinstance(status, int) else 0)


def _warn(message: Warning | str, *_: object, **__: object) -> None:
    typer.echo(f"gpubspline: warning: {_one_line(str(message))}", err=True)


def _fail(message: str, status: int = 2) -> NoReturn:
    typer.echo(f"gpubspline: error: {_one_line(message)}", err=True)
    sys.exit(status)


def _one_line(text: str) -> str:
    return " ".join(text.split())
