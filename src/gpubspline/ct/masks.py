"""A segmentation made elsewhere, checked to lie on the volume's grid."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.ct.image import format_name, load_array, read_image
from gpubspline.ct.volume import Volume
from gpubspline.errors import InputError

PLACE_TOLERANCE = 0.1
"""Greatest distance of a mask's corner from the volume's, in the smallest voxel edge: files round their matrices."""


def read_mask(path: str | Path, volume: Volume, label: int | None = None) -> NDArray[np.bool_]:
    """Read a mask or one label of a label file.

    Arguments
    ---------
    path: NIfTI, NRRD or MetaImage on the grid of ``volume``, or ``.npy`` of its shape (k, j, i).
    label: the value that is inside; None takes every voxel that is not zero.

    Returns: (n_k, n_j, n_i) bool.

    Raises
    ------
    InputError where the file cannot be read, lies on another grid, or has no voxel of the label.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"expected an existing mask file, got {path}")
    values = _on_grid(path, volume)
    inside = values != 0 if label is None else values == label
    if not inside.any():
        raise InputError(_describe_absence(path, values, label))
    return np.asarray(inside, dtype=bool)


def _on_grid(path: Path, volume: Volume) -> NDArray[Any]:
    affine = volume.affine
    if path.suffix.lower() == ".npy":
        values = load_array(path)
    elif format_name(path):
        values, affine = read_image(path)
    else:
        raise InputError(f"expected a mask as NIfTI, NRRD, MetaImage or .npy, got {path.name}")
    if values.shape != volume.hu.shape:
        raise InputError(
            f"expected a mask on the volume's grid of {_size(volume.shape)} voxels, "
            f"got {_size(values.shape[::-1])} in {path.name}"
        )
    off = _corner_distance(affine, volume)
    if off > PLACE_TOLERANCE * float(volume.spacing_mm.min()):
        raise InputError(
            f"expected a mask in the volume's place (origin {_place(volume.affine)}, spacing "
            f"{_place(np.asarray([*volume.spacing_mm]))} mm), got {path.name} with origin {_place(affine)}, spacing "
            f"{_place(np.linalg.norm(affine[:3, :3], axis=0))} mm, up to {off:.3g} mm away"
        )
    return values


def _corner_distance(affine: NDArray[np.float64], volume: Volume) -> float:
    """Greatest distance between corner voxels of the two grids, mm."""
    last = np.array(volume.shape) - 1
    corners = np.array([[i, j, k, 1] for i in (0, last[0]) for j in (0, last[1]) for k in (0, last[2])], dtype=float)
    return float(np.linalg.norm((corners @ (affine - volume.affine).T)[:, :3], axis=1).max())


def _describe_absence(path: Path, values: NDArray[Any], label: int | None) -> str:
    labels = [f"{value:g}" for value in np.unique(values) if value != 0]
    if not labels:
        return f"expected a mask, got {path.name}, in which every voxel is zero"
    shown = ", ".join(labels[:40]) + (" and more" if len(labels) > 40 else "")
    return f"expected one of the labels {shown} of {path.name}, got {label}"


def _size(shape: tuple[int, ...]) -> str:
    return "x".join(str(n) for n in shape)


def _place(numbers: NDArray[np.float64]) -> str:
    values = numbers[:3, 3] if numbers.ndim == 2 else numbers
    return "(" + ", ".join(f"{value:.4g}" for value in values) + ")"
