"""The level set that a mesh of blocks conforms to: the region's distance, smoothed at the scale of an element.

Everything in this package happens in **lattice units**: the element size is 1, the axes are those of the lattice, and
distances count in elements. ``LevelSet.to_mm`` is the way back.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates

from gpubspline.ct.region import Region
from gpubspline.device import Device
from gpubspline.errors import InputError
from gpubspline.mesh.blocks.bricks import Bricks, bricks_round
from gpubspline.mesh.blocks.runs import runs_of
from gpubspline.mesh.blocks.sampled import sample_near
from gpubspline.mesh.coverage import surface_places

Floats = NDArray[np.float64]
Field = NDArray[np.float32]

SAMPLES = 3
"""Samples of the level set per element size."""

SMOOTHING = 0.6
"""Standard deviation, in elements, of the Gaussian that takes away what no element can follow."""

MARGIN = 3
"""Lattice cells around the region."""

CLIP = 3.0
"""Distances, in elements, beyond which the level set is flat."""

SMALLEST_CAVITY = 4.0
"""Volume, in elements, below which an enclosed cavity is filled: a sphere of two elements across."""

MOST_BULGE = 0.1
"""Farthest, in elements, that nodes are set outside the surface for the chords between them."""

CLOSING = 0.5
"""Radius, in elements, of the ball that must fit in what stays outside."""

GROOVE = 0.25
"""Depth, in elements, of the groove left at the mouth of a closed crack: more than distances between samples err."""

FARTHEST = 1.0
"""Most, in elements, that the zero level is moved for its volume."""

ON_SURFACE = 0.01
"""A node farther from the surface, in elements, counts as off it."""

NEAR, ON_REGION = 0.3, 0.05
"""How near, in elements, a point must be to the region to be brought to it, and the step of differences for that."""

BAND = 0.4
"""Half the width, in elements, of the band of samples that the surface's area is taken from."""


@dataclass(frozen=True, eq=False)
class LevelSet:
    """A signed distance on a grid of a third of an element.

    Attributes
    ----------
    phi: (n_k, n_j, n_i) float32, in elements, negative inside; sample (0, 0, 0) lies at the origin of the lattice and
        every third sample is a corner of lattice cells.
    size_mm: of an element.
    to_mm: (4, 4) float64, lattice coordinates to LPS mm: a rotation times ``size_mm``, and a shift.
    region: that it is of, where its thin tips are to be followed.
    """

    phi: NDArray[np.float32]
    size_mm: float
    to_mm: Floats
    region: Region | None = None

    @property
    def cells(self) -> tuple[int, int, int]:
        """Lattice cells along k, j, i."""
        n_k, n_j, n_i = ((n - 1) // SAMPLES for n in self.phi.shape)
        return n_k, n_j, n_i

    @cached_property
    def inside(self) -> NDArray[np.bool_]:
        """Samples inside."""
        return self.phi < 0

    @property
    def axes(self) -> Floats:
        """Rotation (3, 3), columns are the lattice's axes."""
        return np.asarray(self.to_mm[:3, :3] / self.size_mm)

    @cached_property
    def places(self) -> Floats:
        """Places (p, 3) on the surface of the region, lattice coordinates; none where it is not known."""
        if self.region is None:
            return np.empty((0, 3))
        return self.in_lattice(surface_places(self.region)[0])

    def region_distance(self, points: NDArray[Any]) -> Floats:
        """Signed distance (n,), in elements, of the region at lattice coordinates (n, 3); infinite if unknown."""
        if self.region is None:
            return np.full(len(points), np.inf)
        inverse = np.linalg.inv(self.region.affine)
        at = self.in_mm(points) @ inverse[:3, :3].T + inverse[:3, 3]
        return np.asarray(
            map_coordinates(self.region.distance_mm, at[:, ::-1].T, order=1, mode="nearest") / self.size_mm
        )

    def on_region(self, point: Floats) -> Floats:
        """Bring a point (3,), lattice coordinates, to the region's surface, if that is near."""
        steps, at = ON_REGION * np.concatenate([np.zeros((1, 3)), np.eye(3), -np.eye(3)]), point
        for _ in range(4):
            values = self.region_distance(at + steps)
            slope = (values[1:4] - values[4:]) / (2 * ON_REGION)
            at = at - values[0] * slope / max(float(slope @ slope), 0.1)
        return at if np.linalg.norm(at - point) < NEAR else point

    def in_mm(self, points: NDArray[Any]) -> Floats:
        """LPS mm (n, 3) of lattice coordinates (n, 3)."""
        return np.asarray(points.astype(np.float64) @ self.to_mm[:3, :3].T + self.to_mm[:3, 3])

    def in_lattice(self, points: NDArray[Any]) -> Floats:
        """Lattice coordinates (n, 3) of LPS mm (n, 3)."""
        inverse = np.linalg.inv(self.to_mm)
        return np.asarray(points.astype(np.float64) @ inverse[:3, :3].T + inverse[:3, 3])


def lattice_frame(region: Region, size_mm: float, rotation: Floats, offset: tuple[float, float, float]) -> Floats:
    """(4, 4) lattice coordinates to mm: the axes are columns of ``rotation``, the origin lies below the region.

    ``offset``, in elements from 0 to 1, shifts the lattice against the region.
    """
    low, _ = _extent(region, rotation)
    origin = rotation @ (low - (MARGIN + np.array(offset)) * size_mm)
    frame = np.eye(4)
    frame[:3, :3], frame[:3, 3] = rotation * size_mm, origin
    return frame


def lattice_cells(region: Region, size_mm: float, rotation: Floats) -> tuple[int, int, int]:
    """Cells along k, j, i that hold the region with its margin, for any offset."""
    low, high = _extent(region, rotation)
    count = np.ceil((high - low) / size_mm).astype(int) + 2 * MARGIN + 1
    return int(count[2]), int(count[1]), int(count[0])


def _extent(region: Region, rotation: Floats) -> tuple[Floats, Floats]:
    """Least and greatest coordinate of the voxels inside along each lattice axis, mm."""
    along = region.outermost_mm @ rotation
    reach = np.abs(rotation.T @ region.affine[:3, :3]).sum(axis=1)  # the boundary lies within a voxel
    return along.min(axis=0) - reach, along.max(axis=0) + reach


def level_set(
    region: Region,
    size_mm: float,
    *,
    rotation: Floats | None = None,
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0),
    smoothing: float = SMOOTHING,
    closing: float = CLOSING,
    device: Device,
) -> LevelSet:
    """Sample the region's distance on a lattice, smooth it, keep the largest body and fill small cavities.

    Where the region meets the border of its grid, the outermost voxel centres bound it.

    Arguments
    ---------
    size_mm: of an element.
    rotation: (3, 3), columns are the lattice's axes; None takes the patient's.
    offset: of the lattice against the region, in elements.
    smoothing: standard deviation of the Gaussian, in elements.
    closing: radius of the ball that must fit in what stays outside, in elements.

    Raises
    ------
    InputError where the size is not positive, or nothing as thick as an element is inside.
    """
    if not (np.isfinite(size_mm) and size_mm > 0):
        raise InputError(f"expected an element size above 0 mm, got {size_mm}")
    rotation = np.eye(3) if rotation is None else rotation
    frame = lattice_frame(region, size_mm, rotation, offset)
    n_k, n_j, n_i = (SAMPLES * n + 1 for n in lattice_cells(region, size_mm, rotation))
    bricks, phi = _sampled(region, frame, (n_k, n_j, n_i), size_mm, closing, device)
    phi = _smooth(bricks, close_cracks(bricks, phi, closing), smoothing * SAMPLES)
    return LevelSet(_one_body(bricks.field(phi), region, size_mm), size_mm, frame, region)


def bulged(phi: Field) -> Field:
    """Move the zero level by the mean sag of bilinear faces of one element between nodes on it.

    Across a curvature c a chord of length 1 sags by c / 12 on average. Nodes that lie so much farther out leave as
    much of the mesh outside the surface as inside, and its volume right to second order.
    """
    bricks = bricks_round(phi, CLIP)
    values = bricks.of(phi, -CLIP, CLIP)
    bent = np.zeros_like(values)
    for axis in range(3):
        bent += bricks.along(values, axis, SAMPLES, _bend)
    values -= np.clip(bent / np.float32(12), -MOST_BULGE, MOST_BULGE)
    return bricks.put(values, phi.copy())


def _bend(lines: Field) -> Field:
    """Second differences along lines, an element apart."""
    return np.asarray(lines[:, 2 * SAMPLES :] - 2 * lines[:, SAMPLES:-SAMPLES] + lines[:, : -2 * SAMPLES])


def volume_inside(phi: Field) -> float:
    """Volume, in elements, that the zero level holds."""
    return sum(float(_share_inside(plane).sum(dtype=np.float64)) for plane in phi) / SAMPLES**3


@dataclass(frozen=True, eq=False)
class Part:
    """Distance, in elements, of one of the bodies of a level set's region, on its grid.

    Attributes
    ----------
    phi: smoothed as the level set is.
    raw: as it was sampled.
    """

    phi: Field
    raw: Field


def part_of(level: LevelSet, region: Region, *, smoothing: float = SMOOTHING, device: Device) -> Part:
    """Sample the distance of one of the bodies of a level set's region."""
    bricks, raw = _sampled(region, level.to_mm, level.phi.shape, level.size_mm, 0.0, device)
    return Part(bricks.field(_smooth(bricks, raw, smoothing * SAMPLES)), bricks.field(raw))


def _sampled(
    region: Region, frame: Floats, shape: tuple[int, ...], size_mm: float, edge: float, device: Device
) -> tuple[Bricks, Field]:
    """Distance, in elements, of the region bounded by its grid, at the samples of the level set."""
    to_index = np.linalg.inv(region.affine)[:3] @ frame @ np.diag([1 / SAMPLES, 1 / SAMPLES, 1 / SAMPLES, 1.0])
    return sample_near(region, to_index, shape, size_mm, CLIP, edge, device)


def _smooth(bricks: Bricks, phi: Field, sigma: float) -> Field:
    """Twice the smoothed distance minus the twice smoothed one: to first order curved surfaces stay where they are."""
    if sigma == 0:
        return phi
    once = bricks.smoothed(phi, sigma)
    twice = bricks.smoothed(once, sigma)
    return brought_back(bricks, np.asarray(2 * once - twice, dtype=np.float32), phi)


def brought_back(bricks: Bricks, smooth: Field, phi: Field) -> Field:
    """Move the zero level until it holds the volume of the unsmoothed one, within an element or so around.

    Smoothing flattens the ridge of a distance half way between two sheets, which draws near ones: it thickened plates
    of 2.5 elements by 3 %. With the volume kept edges stay round, and as much is outside as inside.
    """
    near = np.maximum(0, 1 - np.abs(smooth) * np.float32(1 / BAND)).astype(np.float32)
    change = _share_inside(smooth)
    change -= _share_inside(phi)
    weight, total = (bricks.summed_in_cells(values, SAMPLES) for values in (near, change))
    moved = np.clip(spread(weight / BAND, total), -FARTHEST, FARTHEST)  # what nearly vanishes has hardly any surface
    return np.asarray(smooth + bricks.between_cells(moved, SAMPLES), dtype=np.float32)


def _share_inside(phi: Field) -> Field:
    """Share of the box of each sample that lies inside, as if it faced the surface."""
    return np.asarray(np.clip(0.5 - SAMPLES * phi, 0, 1), dtype=np.float32)


def spread(weight: NDArray[Any], total: NDArray[Any]) -> Field:
    """Mean of what was weighed and summed up in each lattice cell, over an element or so around."""
    around = gaussian_filter(weight.astype(np.float32), 1.0, truncate=3.0)
    summed = gaussian_filter(total.astype(np.float32), 1.0, truncate=3.0)
    return np.where(around > 0, summed / np.where(around > 0, around, 1), 0).astype(np.float32)


def close_cracks(bricks: Bricks, phi: Field, radius: float) -> Field:
    """Fill what is outside but nowhere as wide as a ball of ``radius`` elements: cracks, pores, thin tunnels.

    Morphological closing: grown by the radius, then shrunk by it. Only what ends up deeper inside than ``GROOVE`` is
    taken, so that the surface stays exact elsewhere.
    """
    if radius == 0:
        return phi
    shrunk = np.float32(radius) - bricks.depth(phi < radius) / np.float32(SAMPLES)
    return np.asarray(np.clip(shrunk + np.float32(GROOVE), -CLIP, phi), dtype=np.float32)


def _one_body(phi: Field, region: Region, size_mm: float) -> Field:
    """Push everything but the largest body outside, and cavities that hold no element inside; ``phi`` is lost."""
    inside = runs_of(phi < 0)
    if not len(inside.start):
        raise InputError(
            f"expected a region thicker than an element of {size_mm:g} mm, got none: the region's voxels are "
            f"{region.spacing_mm.min():g} mm and it holds {np.count_nonzero(region.mask):,}: ask for a smaller size"
        )
    flat = phi.reshape(-1)
    others = inside.samples(inside.bodies != np.argmax(inside.sizes))
    flat[others] = np.abs(flat[others]) + np.float32(1e-3)
    outside = runs_of(phi >= 0)
    small = outside.samples((outside.sizes < SMALLEST_CAVITY * SAMPLES**3)[outside.bodies])
    flat[small] = -np.abs(flat[small]) - np.float32(1e-3)
    return phi
