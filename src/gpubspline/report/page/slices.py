"""The CT as a page holds it: a block of grey around the mesh, and how its slices lie to the patient."""

from itertools import permutations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.ct.volume import Volume
from gpubspline.mesh.mesh import Mesh
from gpubspline.report.page.pack import pack

VOXELS = 8_000_000
"""Most voxels that a page holds; a larger block is averaged."""

MARGIN = 0.08
"""Of the mesh's extent, shown around it."""

NAMES = ("sagittal", "coronal", "axial")
"""Slices across x, y, z."""

_ACROSS = ((1, 2), (0, 2), (0, 1))
"""Patient axes to the right and up or down of the picture of a slice across x, y, z: radiology's views."""

_UP = (True, True, False)
"""Whether the second of them points up: superior does, posterior points down."""

_LETTERS = (("R", "L"), ("A", "P"), ("I", "S"))


def slices(volume: Volume, mesh: Mesh) -> dict[str, Any]:
    """Describe the CT around a mesh for ``slices.js``."""
    block, affine = _averaged(*_cropped(volume, mesh))
    low, high = np.percentile(block, [0.5, 99.8])
    if not high > low:
        low, high = low - 1, high + 1
    grey = np.round(np.clip((block - low) * (255 / (high - low)), 0, 255)).astype(np.uint8)
    shape = [int(n) for n in grey.shape[::-1]]
    return {
        "shape": shape,
        "affine": affine.tolist(),
        "window": [round(float(low)), round(float(high))],
        "grey": pack(grey),
        "views": [view for view in views(affine) if min(shape[view["right"]], shape[view["up"]]) > 1],
        "note": _note(volume, affine),
    }


def _cropped(volume: Volume, mesh: Mesh) -> tuple[NDArray[Any], NDArray[np.float64]]:
    index = volume.to_indices(mesh.points)
    low, high = index.min(axis=0), index.max(axis=0)
    margin = MARGIN * (high - low) + 1
    around = volume.crop(np.floor(low - margin), np.ceil(high + margin) + 1)
    return around.hu, around.affine


def _averaged(hu: NDArray[Any], affine: NDArray[np.float64]) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """Average blocks of voxels, finest spacing first, until the page can hold them."""
    block, affine = hu, affine.copy()
    while block.size > VOXELS:
        spacing = np.linalg.norm(affine[:3, :3], axis=0)
        axis = int(np.argmin(np.where(np.array(block.shape[::-1]) > 1, spacing, np.inf)))
        array_axis = 2 - axis
        n = block.shape[array_axis] // 2 * 2
        even = np.moveaxis(block, array_axis, 0)[:n]
        block = np.moveaxis(np.add(even[0::2], even[1::2], dtype=np.float32) * np.float32(0.5), 0, array_axis)
        affine[:3, 3] += affine[:3, axis] / 2
        affine[:3, axis] *= 2
    return np.ascontiguousarray(block, dtype=np.float32), affine


def views(affine: NDArray[np.float64]) -> list[dict[str, Any]]:
    """For axial, coronal and sagittal slices: the index axis across them, and how the others lie on the picture."""
    directions = affine[:3, :3] / np.linalg.norm(affine[:3, :3], axis=0)
    nearest = max(permutations(range(3)), key=lambda p: sum(abs(directions[x, i]) for x, i in enumerate(p)))
    views = []
    for x in (2, 1, 0):
        right, up = (nearest[patient] for patient in _ACROSS[x])
        flips = [bool(directions[patient, nearest[patient]] < 0) for patient in _ACROSS[x]]
        across, along = _ACROSS[x]
        views.append(
            {
                "name": NAMES[x],
                "across": nearest[x],
                "patient": "xyz"[x],
                "right": right,
                "up": up,
                "flipRight": flips[0],
                "flipUp": flips[1] != _UP[x],
                "letters": [*_LETTERS[across], *(_LETTERS[along][::-1] if _UP[x] else _LETTERS[along])],
            }
        )
    return views


def _note(volume: Volume, affine: NDArray[np.float64]) -> str:
    before, after = volume.spacing_mm, np.linalg.norm(affine[:3, :3], axis=0)
    if np.allclose(before, after):
        return ""
    return "Averaged to " + " x ".join(f"{mm:.3g}" for mm in after) + " mm for this page."
