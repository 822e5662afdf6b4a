"""A mesh file as a deck."""

from pathlib import Path
from typing import Annotated

import typer

from gpubspline.cli.app import SOLVE, command
from gpubspline.cli.options import DeckOptions, RunOptions, flattened
from gpubspline.cli.options.groups import option
from gpubspline.cli.options.output import MeshFile
from gpubspline.errors import InputError
from gpubspline.files import check_apart, check_writable


@command(
    SOLVE, "export femur.vtu --load stance -o femur.inp", "export l3.vtu --load press.toml --units m-N-Pa -o l3.cdb"
)
@flattened
def export(
    mesh: Annotated[Path, typer.Argument(metavar="MESH", help="mesh file, such as .vtu", show_default=False)],
    output: MeshFile,
    deck: DeckOptions,
    summary: Annotated[Path | None, option("Output", "figures, .json", metavar="FILE")] = None,
    thickness: Annotated[
        float | None, option("Deck", "of quads, which are shells in decks (default: 1)", metavar="MM")
    ] = None,
    quiet: Annotated[bool, option("Run", "print warnings and errors only", "--quiet", "-q")] = False,
) -> None:
    """Write a mesh file in another format, with a load case and in the units of a solver."""
    from gpubspline.cli import describe
    from gpubspline.export import read_mesh, write
    from gpubspline.report.summary import check_json, write_summary

    run, written = RunOptions(quiet=quiet), [output, *([summary] if summary else [])]
    deck.check(output)
    for path in written:
        check_writable(path)
    check_apart(written, [mesh, *deck.inputs])
    if summary:
        check_json(summary)
    if thickness is not None and not 0 < thickness < float("inf"):
        raise InputError(f"expected --thickness above 0 mm, got {thickness:g}")
    with run.clock() as clock:
        with clock.stage("read"):
            found = read_mesh(mesh)
        if thickness is not None and found.element.dimension != 2:
            raise InputError(f"expected quads with --thickness, got {found.element_type}")
        with clock.stage("write"):
            figures = {"deck": write(found, output, thickness_mm=1.0 if thickness is None else thickness, **deck.how())}
    if summary:
        write_summary(figures, summary)
    run.say([*describe.mesh_lines(found)[:1], *describe.deck_lines(figures), *describe.wrote(written)])
