"""A block of HU samples with its place in the patient."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpubspline.errors import InputError
from gpubspline.shown import brief, shown

Floats = NDArray[np.float64]


AIR_HU = -1024
"""HU of padding: outside the reconstruction nothing was measured."""


@dataclass(frozen=True, eq=False)
class Volume:
    """HU samples on a regular, possibly oblique, left-handed or sheared grid.

    Attributes
    ----------
    hu: (n_k, n_j, n_i) int16 or float32, HU, index order (k, j, i) as stored, C-contiguous.
    affine: (4, 4) float64, from the index (i, j, k) of a voxel **centre** to patient millimetres in LPS.
    source: what the samples came from, without anything that identifies a patient.
    frame_of_reference: DICOM's UID of the frame the affine leads to, by which masks are told to belong; None elsewhere.
        It stays in memory: no output carries it.

    Raises
    ------
    InputError where the samples are not three-dimensional and finite or the affine is not invertible.
    """

    hu: NDArray[Any]
    affine: Floats
    source: str = "array"
    frame_of_reference: str | None = None

    __repr__ = brief

    def __post_init__(self) -> None:
        """Check shapes and values once, at the door."""
        hu, affine = np.ascontiguousarray(self.hu), np.asarray(self.affine, dtype=np.float64)
        if hu.ndim != 3 or hu.size == 0:
            raise InputError(f"expected HU samples of shape (k, j, i), got {hu.shape}")
        if hu.dtype not in (np.int16, np.float32):
            hu = hu.astype(np.float32)
        if hu.dtype == np.float32 and not np.isfinite(hu).all():
            bad = int(hu.size - np.count_nonzero(np.isfinite(hu)))
            raise InputError(f"expected finite HU everywhere, got NaN or infinity in {bad} of {hu.size} voxels")
        if affine.shape != (4, 4) or not np.isfinite(affine).all() or abs(np.linalg.det(affine[:3, :3])) < 1e-12:
            raise InputError(f"expected an invertible 4x4 affine, got {affine.tolist()}")
        object.__setattr__(self, "hu", hu)
        object.__setattr__(self, "affine", affine)

    def _repr_html_(self) -> str:
        return str(shown("volume_html", self))

    @property
    def shape(self) -> tuple[int, int, int]:
        """Voxels along i, j, k (the reverse of ``hu.shape``)."""
        n_k, n_j, n_i = self.hu.shape
        return n_i, n_j, n_k

    @property
    def spacing_mm(self) -> Floats:
        """(3,) distance between neighbouring voxel centres along i, j, k."""
        return np.asarray(np.linalg.norm(self.affine[:3, :3], axis=0))

    @property
    def voxel_mm3(self) -> float:
        """Volume of one voxel."""
        return float(abs(np.linalg.det(self.affine[:3, :3])))

    @cached_property
    def inverse(self) -> Floats:
        """(4, 4) from LPS millimetres to the index (i, j, k)."""
        return np.asarray(np.linalg.inv(self.affine))

    def to_points(self, indices: ArrayLike) -> Floats:
        """LPS millimetres (..., 3) of the indices (i, j, k) (..., 3)."""
        return np.asarray(np.asarray(indices, dtype=np.float64) @ self.affine[:3, :3].T + self.affine[:3, 3])

    def to_indices(self, points: ArrayLike) -> Floats:
        """Continuous indices (i, j, k) (..., 3) of points in LPS millimetres (..., 3)."""
        return np.asarray(np.asarray(points, dtype=np.float64) @ self.inverse[:3, :3].T + self.inverse[:3, 3])

    def crop(self, first: ArrayLike, last: ArrayLike) -> "Volume":
        """Cut out the voxels from index ``first`` (i, j, k) up to and without ``last``; every voxel keeps its place.

        Raises InputError where nothing is left.
        """
        low = np.maximum(np.asarray(first, dtype=int), 0)
        high = np.minimum(np.asarray(last, dtype=int), self.shape)
        if np.any(high <= low):
            raise InputError(f"expected a crop inside the {self.shape} voxels, got {low.tolist()} to {high.tolist()}")
        window = tuple(slice(int(a), int(b)) for a, b in zip(low[::-1], high[::-1], strict=True))
        affine = self.affine.copy()
        affine[:3, 3] = self.to_points(low)
        return replace(self, hu=self.hu[window], affine=affine)
