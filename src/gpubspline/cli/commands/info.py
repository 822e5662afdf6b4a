"""What a file holds."""

from pathlib import Path
from typing import Annotated

import typer

from gpubspline.cli.app import LOOK, command
from gpubspline.cli.options import ReadOptions, RunOptions, flattened
from gpubspline.errors import InputError


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
