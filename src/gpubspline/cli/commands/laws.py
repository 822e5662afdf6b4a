"""The material laws, and what they make of a model."""

from pathlib import Path
from typing import Annotated, Any

import typer

from gpubspline.cli.app import KNOW, command
from gpubspline.cli.options import RunOptions, flattened
from gpubspline.cli.options.groups import option
from gpubspline.errors import InputError
from gpubspline.files import check_apart, check_writable


@command(KNOW, "laws", "laws --compare femur.vtu -o laws.png")
@flattened
def laws(
    run: RunOptions,
    compare: Annotated[
        Path | None,
        typer.Option(metavar="MODEL", help="mesh with HU, or model file: compare all laws on it", show_default=False),
    ] = None,
    output: Annotated[
        Path | None,
        option("Output", "modulus against HU and stiffness, .png", "--output", "-o", metavar="FILE"),
    ] = None,
    summary: Annotated[Path | None, option("Output", "figures of --compare, .json", metavar="FILE")] = None,
    stiffness: Annotated[bool, typer.Option(help="solve for the model's stiffness under each law")] = True,
) -> None:
    """List the material laws, or compare them on a model."""
    from gpubspline.cli.describe_material import constant_lines, law_lines, step_lines
    from gpubspline.material.registry import laws as registered

    if compare is None:
        if output or summary:
            raise InputError("expected --compare MODEL for the files of a comparison, got none")
        listed = [line for law in registered().values() for line in law_lines(law)]
        run.say([*listed, *constant_lines(), *step_lines()])
        return
    _compare(run, compare, output, summary, stiffness)


def _compare(run: RunOptions, model: Path, output: Path | None, summary: Path | None, stiffness: bool) -> None:
    from gpubspline.analysis.law_comparison import compare_laws
    from gpubspline.cli import describe
    from gpubspline.cli.describe_material import comparison_lines
    from gpubspline.material.registry import laws as registered
    from gpubspline.report.law_comparison import write_law_comparison
    from gpubspline.report.sheet import check_png
    from gpubspline.report.summary import check_json, write_summary

    written = [path for path in (output, summary) if path]
    for path in written:
        check_writable(path)
    check_apart(written, [model])
    if summary:
        check_json(summary)
    if output:
        check_png(output)
    device = run.open()
    with run.clock() as clock:
        with clock.stage("read"):
            mesh = _mesh_of(model, device)
        with clock.stage("laws"):
            found = list(registered().values())
            outcomes = compare_laws(mesh, found, device, stiffness=stiffness, progress=clock.advance)
    if output:
        write_law_comparison(outcomes, mesh.fields["HU"], output)
    if summary:
        write_summary({"laws": [outcome.to_dict() for outcome in outcomes]}, summary)
    run.say(comparison_lines(outcomes) + describe.wrote(written))


def _mesh_of(model: Path, device: Any) -> Any:
    """Read a mesh file, or sample a model file at its control counts."""
    from gpubspline.export import read_mesh
    from gpubspline.mesh.sample import sample
    from gpubspline.spline.model import load_model

    if model.suffix == ".npz":
        patch = load_model(model)
        return sample(patch, patch.shape, device=device)
    return read_mesh(model)
