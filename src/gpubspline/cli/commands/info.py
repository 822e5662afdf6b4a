"""What a file holds."""

from pathlib import Path
from typing import Annotated

import typer

from gpubspline.cli.app import LOOK, command
from gpubspline.cli.options import ReadOptions, RunOptions, flattened
from gpubspline.errors import InputError

OURS = {
    ".json": "figures of a run, which any editor shows",
    ".toml": "a law, a load case or a calibration, which any editor shows",
    ".csv": "a table, which any editor shows",
    ".html": "a report, which any browser shows",
    ".png": "a picture",
}
"""Other files of this package, which tell themselves what they hold."""


@command(LOOK, "info ct.nii.gz", "info dicom_folder", "info labels.nii.gz", "info femur.vtu")
@flattened
def info(
    source: Annotated[
        list[Path],
        typer.Argument(
            metavar="INPUT", help="CT, segmentation, model (.npz), mesh or closed surface", show_default=False
        ),
    ],
    read: ReadOptions,
) -> None:
    """Say what a CT, a segmentation, a model file, a mesh file or a closed surface holds."""
    from gpubspline.cli import describe
    from gpubspline.export import can_read, read_mesh
    from gpubspline.surface.read import is_surface, read_surface

    one = source[0].suffix == ".npz" or is_surface(source[0]) or can_read(source[0])
    if one and (len(source) > 1 or read != ReadOptions()):
        raise InputError(f"expected one file, without options that read a CT, with {source[0].name}, got more")
    _check_known(source[0])
    with RunOptions().clock() as clock, clock.stage("read"):
        if source[0].suffix == ".npz":
            from gpubspline.spline.model import load_model

            lines = describe.patch_lines(load_model(source[0]))
        elif is_surface(source[0]):
            try:
                lines = describe.mesh_lines(read_mesh(source[0]))  # .stl, .ply and others hold quads, too
            except InputError:
                lines = describe.surface_lines(read_surface(source[0]))
        elif can_read(source[0]):
            lines = describe.mesh_lines(read_mesh(source[0]))
        else:
            from gpubspline.ct.image import read_volume
            from gpubspline.ct.mask_image import label_names

            volume = read_volume(source, progress=clock.advance, **read.reading())
            lines = [*describe.volume_lines(volume), *describe.label_lines(volume, label_names(source[0]))]
    RunOptions().say(lines)


def _check_known(path: Path) -> None:
    """Raise InputError for what this package writes and does not read: the mesh that it was made of can be asked."""
    from gpubspline.export import can_read, extensions

    ending = path.suffix.lower()
    if path.is_file() and (ending in OURS or (ending in extensions() and not can_read(path))):
        what = OURS.get(ending, "a deck, which is written only: ask for the mesh file that it was made from")
        raise InputError(f"expected a CT, a segmentation, a model, a mesh or a surface, got {path.name}: {what}")
