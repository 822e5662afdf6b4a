"""Writing and reading meshes: one file per format, found by its extension."""

import importlib
import pkgutil
from functools import lru_cache
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from gpubspline.errors import InputError
from gpubspline.export.read import read_mesh as read_mesh
from gpubspline.files import check_writable
from gpubspline.mesh.mesh import Mesh


@lru_cache(maxsize=1)
def _formats() -> dict[str, ModuleType]:
    """Modules of this folder that write files, by extension: those with ``EXTENSIONS`` and ``write``."""
    found = {}
    for info in pkgutil.iter_modules(__path__):
        module = importlib.import_module(f"{__name__}.{info.name}")
        found.update({extension: module for extension in getattr(module, "EXTENSIONS", ())})
    return found


def extensions() -> tuple[str, ...]:
    """Extensions of every format that can be written, ``.vtu`` and ``.inp`` first."""
    return tuple(sorted(_formats(), key=lambda extension: (extension not in (".vtu", ".inp"), extension)))


def check_extension(path: str | Path) -> None:
    """Raise ``InputError`` where no format that can be written has the extension, before any work is done for it."""
    extension = Path(path).suffix.lower()
    if extension not in _formats():
        raise InputError(f"expected a mesh file of {', '.join(extensions())}, got {Path(path).name!r}")
    if hasattr(_formats()[extension], "check"):
        _formats()[extension].check(extension)


def can_read(path: str | Path) -> bool:
    """Whether ``read_mesh`` knows the extension of ``path``."""
    return Path(path).suffix.lower() in _formats()


def write(mesh: Mesh, path: str | Path, **options: Any) -> None:
    """Write a mesh in the format of the extension, whole or not at all.

    Arguments
    ---------
    mesh: with all fields and sets that are to be written.
    path: a file in an existing folder.
    options: of the format, see ``abaqus.write``; every format takes ``law``, the material law to cite.

    Raises
    ------
    InputError for an unknown extension or option, a folder that is not there or not writable, a field that is not
    finite, or a format that cannot hold the elements. What else a format cannot hold is warned of.
    """
    path = Path(path)
    check_extension(path)
    check_writable(path)
    for name, values in {**mesh.fields, **mesh.cell_fields}.items():
        if not np.isfinite(values).all():
            bad = int(np.count_nonzero(~np.isfinite(values)))
            raise InputError(
                f"expected finite values in the field {name}, got NaN or infinity in {bad} of {values.size}"
            )
    _formats()[path.suffix.lower()].write(mesh, path, **options)
