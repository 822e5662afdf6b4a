"""What is to be meshed: the largest body above a threshold, or a label, with its sub-voxel boundary."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
import SimpleITK as sitk
from numpy.typing import NDArray

from gpubspline.ct.enclosed import enclosed_volume
from gpubspline.ct.held_volume import hold_volume
from gpubspline.ct.signed_distance import box_around, signed_distance
from gpubspline.ct.volume import AIR_HU, Volume
from gpubspline.errors import InputError, expect
from gpubspline.shown import brief

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]
Fill = Literal["slice", "volume", "none"]

MOST_SMOOTHING = 100
"""Voxels of a Gaussian's standard deviation; beyond it nothing of a body is left."""

LABEL_SMOOTHING = 1.1
"""Voxels of standard deviation that a label is smoothed by: a tenth more than takes its steps away makes up for those
that holding its volume brings back."""

HELD_OVER = 1.8
"""Standard deviation of what is around a place, where volume is held, in that of the smoothing: less brings steps back,
more mixes thin parts with thick ones beside them."""

LEAST_LEVEL = 0.05
"""Least distance of a label's boundary from a voxel centre: before its volume is held in label units (0 to 1), then in
voxels."""


@dataclass(frozen=True, eq=False)
class Region:
    """A mask on a volume's grid and the signed distance to its sub-voxel boundary.

    The region is open where it meets the border of the grid: no boundary is invented there.

    Attributes
    ----------
    mask: (n_k, n_j, n_i) bool, true at voxel centres that are inside.
    distance_mm: (n_k, n_j, n_i) float32, negative exactly where ``mask``; its trilinear zero level is the boundary.
        Beyond a few voxels around the mask it is an upper bound.
    affine: (4, 4) float64, index (i, j, k) of a voxel centre to LPS mm.

    Raises
    ------
    InputError where shapes differ or nothing is inside.
    """

    mask: Mask
    distance_mm: NDArray[np.float32]
    affine: Floats

    __repr__ = brief

    def __post_init__(self) -> None:
        """Check that the parts belong together."""
        if self.mask.ndim != 3 or self.mask.shape != self.distance_mm.shape:
            raise InputError(
                f"expected mask and distance of one shape (k, j, i), got {self.mask.shape}, {self.distance_mm.shape}"
            )
        if not self.mask.any():
            raise InputError("expected a region of at least one voxel, got none")

    def is_on(self, volume: Volume) -> bool:
        """Whether it lies on the grid of a volume."""
        return volume.hu.shape == self.mask.shape and bool(np.allclose(volume.affine, self.affine))

    @property
    def shape(self) -> tuple[int, int, int]:
        """Voxels along i, j, k."""
        n_k, n_j, n_i = self.mask.shape
        return n_i, n_j, n_k

    @property
    def spacing_mm(self) -> Floats:
        """(3,) distance between neighbouring voxel centres along i, j, k."""
        return np.asarray(np.linalg.norm(self.affine[:3, :3], axis=0))

    @property
    def box(self) -> tuple[tuple[int, int, int], tuple[int, int, int]]:
        """First index (i, j, k) inside, and the one after the last."""
        k, j, i = box_around(self.mask, 0)
        return (i.start, j.start, k.start), (i.stop, j.stop, k.stop)

    @cached_property
    def volume_mm3(self) -> float:
        """Volume within the trilinear zero level of the distance, between the outermost voxel centres of the grid.

        What a body cut by the end of the scan has beyond the last voxel centres is not counted, nor would a mesh
        reach there. A grid of one voxel along an axis counts as one voxel thick.
        """
        return enclosed_volume(self.distance_mm, self.affine)

    @property
    def section_mm2(self) -> float:
        """Area of a region that is one slice: its volume over the slice's thickness.

        Raises InputError where it is more than one slice.
        """
        if 1 not in self.shape:
            raise InputError(f"expected a region of one slice, got {self.shape} voxels")
        along = np.delete(self.affine[:3, :3], self.shape.index(1), axis=1)
        pixel = float(np.linalg.norm(np.cross(along[:, 0], along[:, 1])))
        return self.volume_mm3 * pixel / float(abs(np.linalg.det(self.affine[:3, :3])))

    @cached_property
    def centroid_mm(self) -> Floats:
        """(3,) mean of the voxel centres inside, LPS mm."""
        counts = (np.count_nonzero(self.mask, axis=others) for others in ((0, 1), (0, 2), (1, 2)))
        middle = [np.arange(count.size) @ count / count.sum() for count in counts]
        return np.asarray(self.affine[:3, :3] @ middle + self.affine[:3, 3])

    @property
    def outermost_mm(self) -> Floats:
        """(n, 3) centres, LPS mm, of the first and of the last voxel inside of each row: no other lies farthest out."""
        k, j = np.nonzero(self.mask.any(axis=2))
        rows = self.mask[k, j]
        ends = (rows.argmax(axis=1), rows.shape[1] - 1 - rows[:, ::-1].argmax(axis=1))
        indices = np.concatenate([np.stack([i, j, k], axis=1) for i in ends])
        return np.asarray(indices @ self.affine[:3, :3].T + self.affine[:3, 3])


def otsu_threshold(volume: Volume) -> float:
    """HU that best parts the histogram in two classes, for when no threshold is given (Otsu 1979).

    What lies below air, as scanners fill the corners of a round field of view with -2000 or -3024, counts as air: it
    would part the scan from its corners.

    Raises InputError where all HU are the same.
    """
    expect(volume, Volume, "read_volume reads one, Volume(hu, affine) makes one of an array")
    hu = np.maximum(volume.hu, AIR_HU) if volume.hu.max() > AIR_HU else volume.hu
    if hu.min() == hu.max():
        raise InputError(f"expected HU that differ, to find a body in them, got {hu.flat[0]:g} everywhere")
    otsu = sitk.OtsuThresholdImageFilter()
    otsu.SetNumberOfHistogramBins(256)
    otsu.Execute(sitk.GetImageFromArray(hu))
    return float(otsu.GetThreshold())


def region_from_threshold(
    volume: Volume,
    threshold_hu: float,
    *,
    fill: Fill = "slice",
    fill_axis: int = 2,
    smoothing_mm: float = 0.0,
    largest: bool = True,
) -> Region:
    """Take what is at or above a threshold; the boundary is the HU iso-level, linear between voxel centres.

    Where holes were filled, HU does not tell the boundary: it runs halfway between voxels there.

    Arguments
    ---------
    fill: holes to fill: those enclosed within a slice, those enclosed in the volume, or none.
    fill_axis: 0, 1, 2 for slices across i, j, k.
    smoothing_mm: standard deviation of a Gaussian on HU before the threshold.
    largest: keep only the largest of the bodies that voxel faces connect.

    Raises
    ------
    InputError where nothing reaches the threshold, giving the range of HU, or the threshold is not finite.
    """
    expect(volume, Volume, "read_volume reads one, Volume(hu, affine) makes one of an array")
    if not np.isfinite(threshold_hu):
        raise InputError(f"expected a finite threshold in HU, got {threshold_hu}")
    hu = volume.hu
    if smoothing_mm:
        hu = _smooth(hu.astype(np.float32), np.full(3, _checked(smoothing_mm)) / volume.spacing_mm)
    mask = np.asarray(hu >= threshold_hu)
    if not mask.any():
        raise InputError(
            f"expected HU at or above the threshold {threshold_hu:g}, got {hu.min():g} to {hu.max():g}: lower it"
        )
    mask = fill_holes(largest_component(mask) if largest else mask, fill, fill_axis)
    level = np.subtract(threshold_hu, hu, dtype=np.float32)
    return Region(mask, signed_distance(mask, level, volume.affine), volume.affine)


def region_from_mask(
    volume: Volume | Floats,
    mask: Mask,
    *,
    smoothing_mm: float | None = None,
    fill: Fill = "none",
    fill_axis: int = 2,
    largest: bool = True,
    coverage: NDArray[Any] | None = None,
) -> Region:
    """Take a mask; the boundary is that of the smoothed label, or of the smoothed coverage where it is known.

    The boundary stays between the centres of the voxels that the label parts, so smoothing removes steps but never a
    thin part. Its Gaussian is sharpened (twice the smoothed label minus the twice smoothed one), which to first order
    does not shrink convex bodies; what thin parts and edges lose nevertheless is given back: see ``held_volume``.

    Arguments
    ---------
    volume: the volume that the mask lies on, or the affine of its grid.
    mask: (n_k, n_j, n_i) bool.
    smoothing_mm: standard deviation of the Gaussian; None takes ``LABEL_SMOOTHING`` voxels along each axis, 0 leaves
        the boundary halfway between voxels.
    fill, fill_axis, largest: as in ``region_from_threshold``.
    coverage: (n_k, n_j, n_i), part of each voxel that is inside, 0 to 1: with it the boundary lies where half of a
        voxel is covered, and nothing is smoothed unless ``smoothing_mm`` says so.

    Raises
    ------
    InputError where the mask is empty or not of the volume's shape.
    """
    affine = volume.affine if isinstance(volume, Volume) else np.asarray(volume, dtype=np.float64)
    mask = np.asarray(mask, dtype=bool)
    if isinstance(volume, Volume) and mask.shape != volume.hu.shape:
        raise InputError(f"expected a mask of the volume's shape {volume.hu.shape} (k, j, i), got {mask.shape}")
    if mask.ndim != 3 or not mask.any():
        raise InputError(f"expected a mask (k, j, i) with at least one voxel inside, got none in {mask.shape}")
    mask = fill_holes(largest_component(mask) if largest else mask, fill, fill_axis)
    spacing = np.linalg.norm(affine[:3, :3], axis=0)
    known = 0.0 if coverage is not None else None
    smoothing = known if smoothing_mm is None else _checked(smoothing_mm)
    sigma = np.full(3, LABEL_SMOOTHING) if smoothing is None else np.full(3, smoothing) / spacing
    distance = signed_distance(mask, _label_level(mask, sigma, coverage), affine)
    if sigma.any():
        share = mask if coverage is None else coverage
        distance = hold_volume(distance, mask, share, affine, HELD_OVER * sigma, LEAST_LEVEL * float(spacing.min()))
    return Region(mask, distance, affine)


def largest_component(mask: Mask) -> Mask:
    """Keep the largest of the bodies that voxel faces connect; of equal ones the first."""
    window = box_around(mask, 0)
    labels = sitk.ConnectedComponent(sitk.GetImageFromArray(mask[window].astype(np.uint8)))
    kept = np.zeros_like(mask)
    numbers = sitk.GetArrayFromImage(labels)
    kept[window] = numbers == 1 + int(np.argmax(np.bincount(numbers.reshape(-1))[1:]))
    return kept


def fill_holes(mask: Mask, fill: Fill, fill_axis: int = 2) -> Mask:
    """Fill what is enclosed: within each slice across ``fill_axis`` (0, 1, 2 for i, j, k), in the volume, or nothing.

    Connection is by voxel faces; what meets the border of the grid is not enclosed.
    """
    if fill not in ("slice", "volume", "none") or fill_axis not in (0, 1, 2):
        raise InputError(f"expected fill of slice, volume or none and an axis 0 to 2, got {fill!r} and {fill_axis}")
    if fill == "none":
        return mask
    window = box_around(mask, 1)
    filled: Mask = mask.copy()
    if fill == "volume":
        filled[window] = _fill_enclosed(mask[window])
        return filled
    slices = np.moveaxis(filled[window], 2 - fill_axis, 0)  # a view: writing fills
    for k, image in enumerate(slices):
        if image.any():
            slices[k] = _fill_enclosed(image)
    return filled


def _fill_enclosed(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    image = sitk.GetImageFromArray(np.ascontiguousarray(mask, dtype=np.uint8))
    return np.asarray(sitk.GetArrayFromImage(sitk.BinaryFillhole(image, False, 1)), dtype=bool)


def _label_level(mask: Mask, sigma: Floats, coverage: NDArray[Any] | None = None) -> NDArray[np.float32]:
    """A level function of a label, negative inside, from 0.5 in to -0.5 at most."""
    values = mask if coverage is None else coverage
    level: NDArray[np.float32] = np.where(mask, np.float32(-0.5), np.float32(0.5))
    window = box_around(mask, 2 + int(np.ceil(4 * sigma.max())))
    once = _smooth(values[window].astype(np.float32), sigma)
    smoothed = 0.5 - (2 * once - _smooth(once, sigma))
    inside = mask[window]
    level[window] = np.where(inside, np.minimum(smoothed, -LEAST_LEVEL), np.maximum(smoothed, LEAST_LEVEL))
    return level


def _smooth(values: NDArray[Any], sigma: Floats) -> NDArray[np.float32]:
    """Gaussian of standard deviation ``sigma`` voxels along i, j, k, flat beyond the border."""
    if not sigma.any():
        return values
    if sigma.max() > MOST_SMOOTHING:
        raise InputError(f"expected a smoothing of at most {MOST_SMOOTHING} voxels, got {sigma.max():.3g}")
    image = sitk.GetImageFromArray(values)
    width = 2 * int(np.ceil(4 * sigma.max())) + 3
    smoothed = sitk.DiscreteGaussian(image, (sigma**2).tolist(), width, [0.001] * 3, False)
    result: NDArray[np.float32] = sitk.GetArrayFromImage(smoothed).astype(np.float32, copy=False)
    return result


def _checked(smoothing_mm: float) -> float:
    if not (np.isfinite(smoothing_mm) and smoothing_mm >= 0):
        raise InputError(f"expected a smoothing of 0 mm or more, got {smoothing_mm}")
    return smoothing_mm
