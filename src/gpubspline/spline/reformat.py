"""The region's distance laid out as slices of rows along the axis that the lattice is stacked on."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from gpubspline.ct.region import Region
from gpubspline.errors import InputError

Floats = NDArray[np.float64]

AXES = ("x", "y", "z", "long")
LARGEST_GRID = 16e6  # samples of a grid turned to the long axis: 64 MB, 0.4 mm for a whole femur's bounding box


@dataclass(frozen=True, eq=False)
class Stack:
    """Signed distance on a grid whose axes are those of the lattice, cut down to the region.

    Attributes
    ----------
    distance_mm: (w, v, u) float32, slices, rows, samples of a row; negative inside.
    affine: (4, 4) float64, from the index (u, v, w) to LPS millimetres.
    first: index of slice 0 along the volume's own axis.
    slices: how many slices the volume has along that axis; None on a turned grid.
    """

    distance_mm: NDArray[np.float32]
    affine: Floats
    first: int = 0
    slices: int | None = None

    def to_points(self, indices: Floats) -> Floats:
        """LPS millimetres (..., 3) of fractional indices (u, v, w) (..., 3)."""
        return np.asarray(indices @ self.affine[:3, :3].T + self.affine[:3, 3])


def stack(region: Region, axis: str = "z") -> Stack:
    """Lay the region out for stacking along ``axis``.

    Arguments
    ---------
    axis: ``"x"``, ``"y"`` or ``"z"`` for the image axis i, j or k; ``"long"`` for the region's principal axis. Rows and
        their samples follow in cyclic order, so that (u, v, w) is (j, k, i), (k, i, j) or (i, j, k) and keeps the
        handedness of the image.

    Raises
    ------
    InputError for an unknown axis or a region without inside.
    """
    if axis not in AXES:
        raise InputError(f"expected the stacking axis {', '.join(AXES)}, got {axis!r}")
    low, high = _bounds(region.distance_mm)
    return _turned(region, low, high) if axis == "long" else _along(region, "xyz".index(axis), low, high)


def _bounds(distance_mm: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Give first and one past last index (k, j, i) of the inside, with one sample around it where the grid has one."""
    inside = np.asarray(distance_mm < 0)
    rows = np.asarray(inside.any(axis=2))
    hits = [np.any(rows, axis=1), np.any(rows, axis=0), np.any(inside[np.any(rows, axis=1)], axis=(0, 1))]
    if not hits[0].any():
        raise InputError("expected a region with an inside, got a distance that is negative nowhere")
    ends = [np.flatnonzero(hit)[[0, -1]] for hit in hits]
    low = np.array([max(int(end[0]) - 1, 0) for end in ends])
    high = np.array([min(int(end[1]) + 2, n) for end, n in zip(ends, distance_mm.shape, strict=True)])
    return low, high


def _along(region: Region, w: int, low: NDArray[Any], high: NDArray[Any]) -> Stack:
    u, v = (w + 1) % 3, (w + 2) % 3  # image axes, 0 for i
    window = tuple(slice(int(a), int(b)) for a, b in zip(low, high, strict=True))
    distance = np.transpose(region.distance_mm[window], [2 - w, 2 - v, 2 - u])
    affine = np.eye(4)
    affine[:3, :3] = region.affine[:3, [u, v, w]]
    affine[:3, 3] = region.affine[:3, :3] @ low[::-1] + region.affine[:3, 3]
    return Stack(distance, affine, int(low[2 - w]), int(region.distance_mm.shape[2 - w]))


def _turned(region: Region, low: NDArray[Any], high: NDArray[Any]) -> Stack:
    affine, shape = _turned_grid(region, low, high)
    to_index = np.linalg.inv(region.affine) @ affine
    out = np.empty(shape, np.float32)
    v, u = np.meshgrid(np.arange(shape[1]), np.arange(shape[2]), indexing="ij")
    for w in range(shape[0]):  # one slice at a time keeps the coordinates small
        indices = np.stack([u, v, np.full_like(u, w)], axis=-1) @ to_index[:3, :3].T + to_index[:3, 3]
        sampled = ndimage.map_coordinates(
            region.distance_mm, indices[..., ::-1].transpose(2, 0, 1), order=1, mode="nearest"
        )
        out[w] = np.maximum(sampled, _beyond(indices, region))
    return Stack(out, affine)


def _beyond(indices: Floats, region: Region) -> Floats:
    """Signed distance in mm to the box of the voxel centres: where the scan ends, so does the region."""
    last = np.array(region.distance_mm.shape[::-1]) - 1
    planes_mm = 1 / np.linalg.norm(np.linalg.inv(region.affine)[:3, :3], axis=1)
    return np.asarray((np.maximum(-indices, indices - last) * planes_mm).max(axis=-1))


def _turned_grid(region: Region, low: NDArray[Any], high: NDArray[Any]) -> tuple[Floats, tuple[int, int, int]]:
    """Affine of (u, v, w) and shape (w, v, u) of an isotropic grid along the principal axis, around the region."""
    axes = _principal_axes(region, low, high)
    extents = region.outermost_mm @ axes
    least, most = extents.min(axis=0), extents.max(axis=0)
    spacing = float(np.linalg.norm(region.affine[:3, :3], axis=0).min())
    spacing = max(spacing, float(np.prod(most - least) / LARGEST_GRID) ** (1 / 3))
    margin = 1.5 * float(np.linalg.norm(region.affine[:3, :3], axis=0).max())  # the zero level may lie a voxel further
    counts = np.ceil((most - least + 2 * margin) / spacing).astype(int) + 1
    affine = np.eye(4)
    affine[:3, :3] = axes * spacing
    affine[:3, 3] = axes @ (least - margin)
    return affine, (int(counts[2]), int(counts[1]), int(counts[0]))


def _principal_axes(region: Region, low: NDArray[Any], high: NDArray[Any]) -> Floats:
    """(3, 3) right-handed columns u, v, w: w the principal axis of the inside, u as near the image rows as may be."""
    window = tuple(slice(int(a), int(b)) for a, b in zip(low, high, strict=True))
    moments = _index_covariance(region.distance_mm[window] < 0)
    edges = region.affine[:3, :3]
    w = np.linalg.eigh(edges @ moments @ edges.T)[1][:, -1]
    image = edges / np.linalg.norm(edges, axis=0)
    nearest = int(np.abs(image.T @ w).argmax())
    w = w if image[:, nearest] @ w > 0 else -w
    u = image[:, (nearest + 1) % 3]
    u = u - (u @ w) * w
    u = u / np.linalg.norm(u)
    return np.stack([u, np.cross(w, u), w], axis=1)


def _index_covariance(inside: NDArray[np.bool_]) -> Floats:
    """(3, 3) covariance of the indices (i, j, k) of the inside, from its three projections."""
    n_k, n_j, n_i = inside.shape
    i, j, k = (np.arange(n, dtype=np.float64) for n in (n_i, n_j, n_k))
    kj = inside.sum(axis=2, dtype=np.float64)
    ki, ji = inside.sum(axis=1, dtype=np.float64), inside.sum(axis=0, dtype=np.float64)
    total = kj.sum()
    mean = np.array([ji.sum(axis=0) @ i, ji.sum(axis=1) @ j, kj.sum(axis=1) @ k]) / total
    squares = np.array(
        [
            [ji.sum(axis=0) @ i**2, j @ ji @ i, k @ ki @ i],
            [j @ ji @ i, ji.sum(axis=1) @ j**2, k @ kj @ j],
            [k @ ki @ i, k @ kj @ j, kj.sum(axis=1) @ k**2],
        ]
    )
    return np.asarray(squares / total - np.outer(mean, mean))
