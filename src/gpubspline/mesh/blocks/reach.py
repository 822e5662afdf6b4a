"""What the surface of a core can reach: the level set near it alone, and the features that it leaves out."""

from dataclasses import dataclass

import numpy as np
import SimpleITK as sitk
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from gpubspline.mesh.blocks.core import Cells
from gpubspline.mesh.blocks.level_set import SAMPLES, LevelSet

REACH = 0.9
"""How far, in elements, a surface node may go from the boundary of the core: not to another sheet.

Cells are kept by their middle: the surface passes within half their diagonal, 0.87, of the core's boundary.
"""

ROUNDING = 0.5
"""Standard deviation, in elements, of the Gaussian that takes the steps off the distance from the core."""

LEAST_LOSS = 0.5
"""Features that stand out less, in elements, are not listed."""


@dataclass(frozen=True)
class LostFeature:
    """A part of the region that is too thin for the lattice.

    Attributes
    ----------
    place_mm: (x, y, z) of its outermost point, LPS.
    out_mm: how far that lies from the mesh, about.
    """

    place_mm: tuple[float, float, float]
    out_mm: float

    def to_dict(self) -> dict[str, object]:
        """Plain numbers, for JSON."""
        return {"place_mm": list(self.place_mm), "out_mm": self.out_mm}


def within_reach(phi: NDArray[np.float32], cells: Cells, reach: float = REACH) -> NDArray[np.float32]:
    """Clamp a level set to the smoothed distance from the core's boundary, plus and minus the reach."""
    return near(phi, core_distance(cells, phi.shape), reach)


def near(phi: NDArray[np.float32], distance: NDArray[np.float32], reach: float = REACH) -> NDArray[np.float32]:
    """Clamp a level set to a distance plus and minus the reach."""
    return np.asarray(np.clip(phi, distance - np.float32(reach), distance + np.float32(reach)), dtype=np.float32)


def core_distance(cells: Cells, shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Smoothed signed distance from the core's boundary at the samples of a level set, in elements."""
    fine = cells
    for axis in range(3):
        fine = np.repeat(fine, SAMPLES, axis=axis)
    image = sitk.GetImageFromArray(fine.astype(np.uint8))
    steps = sitk.GetArrayFromImage(sitk.SignedMaurerDistanceMap(image, False, False, False))
    distance = (steps - np.float32(0.5)) / np.float32(SAMPLES)  # steps count from the middles of the outermost thirds
    rounded = gaussian_filter(distance, ROUNDING * SAMPLES, truncate=3.0, mode="nearest")
    for axis in range(3):  # from the middles of thirds of cells to their corners
        rounded = np.concatenate(
            [
                np.take(rounded, [0], axis),
                0.5 * (_but_last(rounded, axis) + _but_first(rounded, axis)),
                np.take(rounded, [-1], axis),
            ],
            axis=axis,
        )
    return np.asarray(rounded, dtype=np.float32)


def _but_first(values: NDArray[np.float32], axis: int) -> NDArray[np.float32]:
    return np.moveaxis(np.moveaxis(values, axis, 0)[1:], 0, axis)


def _but_last(values: NDArray[np.float32], axis: int) -> NDArray[np.float32]:
    return np.moveaxis(np.moveaxis(values, axis, 0)[:-1], 0, axis)


def lost_features(level: LevelSet, reached: NDArray[np.float32]) -> tuple[LostFeature, ...]:
    """Bodies of the level set's inside that lie outside what the core reaches, farthest out first."""
    out = np.where((level.phi < 0) & (reached > 0), reached, np.float32(0))
    bodies = sitk.GetArrayFromImage(sitk.ConnectedComponent(sitk.GetImageFromArray((out > 0).astype(np.uint8))))
    count = int(bodies.max(initial=0))
    if not count:
        return ()
    lost = np.flatnonzero(bodies)
    order = lost[np.lexsort((-out.reshape(-1)[lost], bodies.reshape(-1)[lost]))]  # the farthest out of each body first
    firsts = order[np.searchsorted(bodies.reshape(-1)[order], np.arange(1, count + 1))]
    places, depths = np.stack(np.unravel_index(firsts, out.shape), axis=1), out.reshape(-1)[firsts]
    order = np.argsort(-depths, kind="stable")
    kept = order[depths[order] > LEAST_LOSS]
    at = level.in_mm(places[kept][:, ::-1] / SAMPLES)
    return tuple(
        LostFeature((float(x), float(y), float(z)), float(depth) * level.size_mm)
        for (x, y, z), depth in zip(at, depths[kept], strict=True)
    )
