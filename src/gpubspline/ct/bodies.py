"""Analytic bodies: what a phantom is made of, as level functions whose zero set is exact."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Level = Callable[[Floats], Floats]


@dataclass(frozen=True)
class Layer:
    """A part of a body that overrides the parts before it.

    Attributes
    ----------
    level: from points (..., 3) in mm to (...) in mm, negative inside the part, near its distance to the boundary.
    hu: from points (..., 3) in mm to (...) in HU inside the part.
    """

    level: Level
    hu: Level


@dataclass(frozen=True)
class Body:
    """Layers from the outermost inwards, in a surrounding; the first layer's boundary is the body's.

    Attributes
    ----------
    layers: the parts, each drawn over those before it.
    surrounding_hu: HU outside.
    """

    layers: tuple[Layer, ...]
    surrounding_hu: float

    def level(self, points: Floats) -> Floats:
        """(...) mm, negative inside; its zero set is exactly the body's outer boundary."""
        return self.layers[0].level(points)

    def hu(self, points: Floats, cell_mm: float = 0.0) -> Floats:
        """HU at points (..., 3) in mm.

        Arguments
        ---------
        cell_mm: 0 for the exact, discontinuous HU; above 0 its mean over a cell of that size (partial volume), exact
            to first order where a boundary is flat at that scale.
        """
        flat = np.reshape(points, (-1, 3))
        out = np.full(len(flat), self.surrounding_hu)
        inner = np.arange(len(flat))
        for number, layer in enumerate(self.layers):
            level = layer.level(flat[inner])
            if number == 0:  # the other layers lie within it
                near = level < cell_mm
                inner, level = inner[near], level[near]
            share = np.clip(0.5 - level / cell_mm, 0, 1) if cell_mm > 0 else (level < 0).astype(np.float64)
            out[inner] += share * (layer.hu(flat[inner]) - out[inner])
        return out.reshape(points.shape[:-1])


def sphere(points: Floats, centre: tuple[float, float, float], radius: float) -> Floats:
    """Signed distance in mm to a sphere."""
    return _length(points - np.array(centre)) - radius


def ellipsoid(points: Floats, centre: tuple[float, float, float], semi_axes: tuple[float, ...]) -> Floats:
    """Distance to an axis-aligned ellipsoid, exact in its zero set and of unit slope there."""
    axes = np.array(semi_axes)
    return _elliptic((points - np.array(centre)) / axes, axes)


def elliptic_tube(points: Floats, semi_axes: tuple[Floats | float, Floats | float]) -> Floats:
    """Distance to an elliptic cylinder along z, whose semi-axes along x and y may vary slowly with the point."""
    axes = np.stack(np.broadcast_arrays(*semi_axes), axis=-1)
    return _elliptic(points[..., :2] / axes, axes)


def _elliptic(scaled: Floats, axes: Floats) -> Floats:
    reach, slope = _length(scaled), _length(scaled / axes)
    return np.asarray(np.where(slope > 0, reach * (reach - 1) / np.maximum(slope, 1e-12), -axes.min(axis=-1)))


def cone(points: Floats, start: tuple[float, ...], end: tuple[float, ...], radii: tuple[float, float]) -> Floats:
    """Distance to a capsule from ``start`` to ``end`` whose radius changes linearly from one end to the other."""
    a = np.array(start)
    axis = np.array(end) - a
    along = np.clip((points - a) @ axis / (axis @ axis), 0, 1)
    centre = a + along[..., None] * axis
    return np.asarray(_length(points - centre) - (radii[0] + along * (radii[1] - radii[0])))


def smooth_union(first: Floats, second: Floats, width_mm: float) -> Floats:
    """Smooth minimum of two levels: their union with a fillet ``width_mm`` wide (polynomial, once differentiable)."""
    gap = np.maximum(width_mm - np.abs(first - second), 0) / width_mm
    return np.asarray(np.minimum(first, second) - gap**2 * width_mm / 4)


def ramp(values: Floats, start: float, end: float) -> Floats:
    """Rise smoothly from 0 at ``start`` to 1 at ``end``."""
    share = np.clip((values - start) / (end - start), 0, 1)
    return np.asarray(share * share * (3 - 2 * share))


def _length(vectors: Floats) -> Floats:
    return np.asarray(np.sqrt(np.einsum("...i,...i", vectors, vectors)))  # several times faster than linalg.norm
