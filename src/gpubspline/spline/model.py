"""The model file: a hyperpatch in one ``.npz``, from which a mesh of any density can be sampled without the CT."""

import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from gpubspline.errors import InputError
from gpubspline.files import check_writable, whole_file
from gpubspline.spline.hyperpatch import Hyperpatch

FORMAT = "gpubspline hyperpatch 1"


def save_model(patch: Hyperpatch, path: str | Path) -> None:
    """Write a hyperpatch: ``format``, ``control``, ``degrees``, ``knots_0`` ..., ``channels`` and any ``weights``."""
    parts: dict[str, Any] = {
        "format": np.array(FORMAT),
        "control": patch.control,
        "degrees": np.array(patch.degrees),
        "channels": np.array(patch.channels),
        **{f"knots_{direction}": knots for direction, knots in enumerate(patch.knots)},
    }
    if patch.weights is not None:
        parts["weights"] = patch.weights
    check_model_path(path)
    with whole_file(Path(path)) as temporary:
        np.savez_compressed(temporary, **parts)


def check_model_path(path: str | Path) -> None:
    """Raise InputError unless a model file can be written there."""
    if Path(path).suffix != ".npz":
        raise InputError(f"expected a model file ending in .npz, got {Path(path).name}")
    check_writable(Path(path))


def load_model(path: str | Path) -> Hyperpatch:
    """Read a hyperpatch; nothing in the file is executed.

    Raises InputError where it is missing, damaged or something else.
    """
    try:
        if not zipfile.is_zipfile(path):
            raise zipfile.BadZipFile("it is no .npz file") if Path(path).exists() else FileNotFoundError
        with np.load(path, allow_pickle=False) as file:
            parts = {name: file[name] for name in file.files}
    except FileNotFoundError:
        raise InputError(f"expected a model file, got {path}, which does not exist") from None
    except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise InputError(f"expected a gpubspline model (.npz), got {path}: {error}") from None
    if str(parts.get("format")) != FORMAT or not {"control", "degrees", "channels"} <= parts.keys():
        raise InputError(f"expected a gpubspline model (.npz), got {path}, which holds something else")
    degrees = tuple(int(p) for p in parts["degrees"])
    knots = tuple(parts[f"knots_{direction}"] for direction in range(len(degrees)) if f"knots_{direction}" in parts)
    channels = tuple(str(name) for name in parts["channels"])
    return Hyperpatch(parts["control"], degrees, knots, parts.get("weights"), channels)
