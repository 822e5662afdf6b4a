"""Arguments that several commands take."""

from pathlib import Path
from typing import Annotated

import typer

InputPaths = Annotated[
    list[Path],
    typer.Argument(metavar="INPUT...", help="DICOM folder or files, NIfTI, NRRD, MetaImage, .npy", show_default=False),
]
