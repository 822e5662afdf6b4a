"""Arguments that several commands take."""

from pathlib import Path
from typing import Annotated

import typer

SolidPaths = Annotated[
    list[Path],
    typer.Argument(
        metavar="INPUT...",
        help="DICOM folder or files, NIfTI, NRRD, MetaImage, .npy; or a closed surface: .stl, .obj, .ply, .off, .vtp",
        show_default=False,
    ),
]
InputPaths = Annotated[
    list[Path],
    typer.Argument(metavar="INPUT...", help="DICOM folder or files, NIfTI, NRRD, MetaImage, .npy", show_default=False),
]
