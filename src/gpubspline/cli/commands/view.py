"""A look at a mesh file."""

from pathlib import Path
from typing import Annotated

import typer

from gpubspline.cli.app import JUDGE, command
from gpubspline.cli.options import RunOptions
from gpubspline.cli.options.deck import complete_load
from gpubspline.cli.options.groups import option
from gpubspline.errors import BackendUnavailable, InputError
from gpubspline.files import check_apart, check_new, check_writable


@command(
    JUDGE,
    "view femur.vtu -o femur.png",
    "view stressed.vtu --field von_mises --clip y --from AL -o cut.png",
    "view femur.vtu --load stance -o held.png",
)
def view(
    mesh: Annotated[Path, typer.Argument(metavar="MESH", help="any mesh file meshio reads", show_default=False)],
    field: Annotated[
        str | None,
        option("Picture", "field that colours it, or the beginning of one (default: stress, HU, E)", metavar="NAME"),
    ] = None,
    clip: Annotated[
        str | None, option("Picture", "cut across an axis (default: along the greatest section)", metavar="x|y|z")
    ] = None,
    sides: Annotated[
        str | None,
        option("Picture", "where a picture is seen from, such as I or PRS (default: ALS)", "--from", metavar="LRAPSI"),
    ] = None,
    load: Annotated[
        str | None,
        option(
            "Picture",
            "draw where a load case holds and pushes instead: stance, or a file (docs/loads.md) (default: none)",
            metavar="NAME|FILE.toml",
            complete=complete_load,
        ),
    ] = None,
    edges: Annotated[bool, option("Picture", "draw the elements' edges, however small", "--edges")] = False,
    output: Annotated[
        Path | None,
        option(
            "Output",
            "picture, .png (default: a window, or a new MESH.png without a screen)",
            "--output",
            "-o",
            metavar="FILE",
        ),
    ] = None,
) -> None:
    """Look at a mesh: a window where there is a screen, a PNG where not."""
    from gpubspline.analysis.load_case import load_case
    from gpubspline.export import read_mesh
    from gpubspline.mesh.quality import assess
    from gpubspline.report.camera import seen_from
    from gpubspline.report.load_picture import write_load_picture
    from gpubspline.report.picture import check_clip, write_picture
    from gpubspline.report.quantity import find_field
    from gpubspline.report.sheet import check_png
    from gpubspline.report.window import has_screen, open_window

    path = output or Path(mesh.name).with_suffix(".png")
    seen = None if sides is None else seen_from(sides)
    if load is not None and (field is not None or clip is not None):
        raise InputError("expected --load without --field and --clip, got both: it draws the regions on the surface")
    case = None if load is None else load_case(load)
    drawn = output is not None or seen is not None or case is not None or not has_screen()
    if drawn:
        check_png(path)
        check_writable(path)
        check_apart([path], [mesh, *([Path(load)] if load else [])])
        if output is None:
            check_new(path, "-o")
    with RunOptions().clock() as clock, clock.stage("read"):
        found = read_mesh(mesh)
        if case is None and not found.fields and not found.cell_fields:
            found, _ = assess(found)
    if case is not None:
        with RunOptions().clock() as clock, clock.stage("picture"):
            write_load_picture(found, case, path, view=seen, edges=True if edges else None)
        typer.echo(f"wrote {path}, with the regions of {case.title or case.name}")
        return
    name = find_field([*found.fields, *found.cell_fields], field)
    check_clip(found, clip)
    if not drawn:
        try:
            open_window(found, name, clip=clip, edges=edges).show()
            return
        except BackendUnavailable as error:
            typer.echo(f"gpubspline: warning: no window: {error}", err=True)
            check_writable(path)
            check_new(path, "-o")
    with RunOptions().clock() as clock, clock.stage("picture"):
        write_picture(found, path, field=name, view=seen, clip=clip, edges=True if edges else None)
    typer.echo(f"wrote {path}, coloured by {name}")
