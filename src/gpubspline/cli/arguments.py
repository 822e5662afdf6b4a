"""Arguments that several commands take."""

from pathlib import Path
from typing import Annotated

import typer

IMAGES = "DICOM folder or files, NIfTI, Analyze, NRRD, MetaImage, .npy"

SolidPaths = Annotated[
    list[Path],
    typer.Argument(
        metavar="INPUT",
        help=f"{IMAGES}; or a closed surface: .stl, .obj, .ply, .off, .vtp",
        show_default=False,
    ),
]
InputPaths = Annotated[
    list[Path],
    typer.Argument(metavar="INPUT", help=IMAGES, show_default=False),
]
