"""What the surface of a core can reach: the level set near it alone, and the features that it leaves out."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from gpubspline.mesh.blocks.bricks import (
    EDGE,
    FAR,
    INSIDE,
    Bricks,
    bricks_round,
    bricks_where,
    far_values,
    with_neighbours,
)
from gpubspline.mesh.blocks.core import Cells, count_neighbours
from gpubspline.mesh.blocks.level_set import CLIP, SAMPLES, Field, LevelSet
from gpubspline.mesh.blocks.runs import runs_of

REACH = 0.9
"""How far, in elements, a surface node may go from the boundary of the core: not to another sheet.

Cells are kept by their middle: the surface passes within half their diagonal, 0.87, of the core's boundary.
"""

ROUNDING = 0.5
"""Standard deviation, in elements, of the Gaussian that takes the steps off the distance from the core."""

EXACT = 2.0
"""Distance from the core, in elements, beyond which what is lost is measured to its cells, not smoothed."""

NEAREST = 8
"""Cells that are then tried, by their centres."""

MOST_LOST = 1.2
"""How far, in elements, a feature may stand out of the mesh without another place being tried."""

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


@dataclass(frozen=True, eq=False)
class CoreDistance:
    """Smoothed signed distance from a core's boundary, in elements, near it.

    Attributes
    ----------
    cells: of the core.
    bricks: those round the boundary.
    values: at their samples, exact to ``EXACT``, farther away some larger number.
    """

    cells: Cells
    bricks: Bricks
    values: Field

    @property
    def field(self) -> Field:
        """The same at all samples of a level set."""
        return self.bricks.field(self.values)


def core_distance(cells: Cells) -> CoreDistance:
    """Measure the distance from the boundary of core cells."""
    shape, each = tuple(SAMPLES * n + 1 for n in cells.shape), EDGE // SAMPLES
    k, j, i = (-(-n // EDGE) for n in shape)
    padded = np.pad(cells, [(0, each * b - n) for b, n in zip((k, j, i), cells.shape, strict=True)])
    by_brick = padded.reshape(k, each, j, each, i, each).transpose(0, 2, 4, 1, 3, 5)
    some, whole = by_brick.any(axis=(3, 4, 5)), by_brick.all(axis=(3, 4, 5))
    bricks = bricks_where(with_neighbours(some) & with_neighbours(~whole), whole, shape)
    thirds = by_brick[bricks.numbers >= 0]
    for axis in range(1, 4):
        thirds = np.repeat(thirds, SAMPLES, axis=axis)
    steps = bricks.depth(np.concatenate([thirds, far_values(True, False)]))
    distance = -(np.clip(steps, -FAR, FAR) + np.float32(0.5)) / np.float32(SAMPLES)  # from middles of outermost thirds
    distance = bricks.smoothed(distance, ROUNDING * SAMPLES)
    for axis in range(3):  # from the middles of thirds of cells to their corners
        distance = bricks.along(distance, axis, 1, lambda a: np.float32(0.5) * (a[:, :EDGE] + a[:, 1:-1]))
    return CoreDistance(cells, bricks, distance)


def within_reach(phi: Field, core: CoreDistance) -> Field:
    """Clamp a level set to the smoothed distance from the core's boundary, plus and minus ``REACH``."""
    level, bricks = bricks_round(phi, CLIP), core.bricks
    astray = (level.numbers >= 0) | ((level.numbers == INSIDE) != (bricks.numbers == INSIDE))
    out: Field = phi.copy()
    beyond = bricks_where(astray & (bricks.numbers < 0), bricks.numbers == INSIDE, phi.shape)
    for some, distance in ((bricks, core.values), (beyond, _far_off(beyond, bricks))):
        values = some.of(phi, -CLIP, CLIP)
        lost = np.nonzero((values[:-2] < 0) & (distance[:-2] > EXACT))
        if len(lost[0]):
            distance = distance.copy()
            distance[lost] = _distance_from(core.cells, some.places(lost) / SAMPLES)
        some.put(near(values, distance), out)
    return out


def near(phi: Field, distance: Field) -> Field:
    """Clamp a level set to a distance plus and minus the reach."""
    return np.asarray(np.clip(phi, distance - np.float32(REACH), distance + np.float32(REACH)), dtype=np.float32)


def _far_off(beyond: Bricks, core: Bricks) -> Field:
    """Distance at bricks away from the core's boundary: only its sign is known, and that no sheet is held there."""
    far = np.float32(CLIP + REACH)
    signs = np.where(core.numbers[beyond.numbers >= 0] == INSIDE, -far, far)
    return np.broadcast_to(np.append(signs, [-far, far])[:, None, None, None], (beyond.count + 2, EDGE, EDGE, EDGE))


def _distance_from(cells: Cells, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Distance (n,) of points (n, 3) outside, k, j, i in elements, from the nearest cell."""
    centres = np.argwhere(cells & (count_neighbours(cells) < 6)) + 0.5
    _, nearest = KDTree(centres).query(points, k=min(NEAREST, len(centres)))
    beside = np.abs(points[:, None] - centres[nearest.reshape(len(points), -1)]) - 0.5
    return np.asarray(np.linalg.norm(np.maximum(beside, 0), axis=2).min(axis=1))


def lost_features(level: LevelSet, reached: Field) -> tuple[LostFeature, ...]:
    """Bodies of the level set's inside that lie outside what the core reaches, farthest out first."""
    runs = runs_of((level.phi < 0) & (reached > 0))
    if not len(runs.start):
        return ()
    lost = runs.samples(np.ones(len(runs.start), dtype=bool))
    bodies, out = np.repeat(runs.bodies, runs.stop - runs.start), reached.reshape(-1)[lost]
    order = np.lexsort((-out, bodies))  # the farthest out of each body first
    firsts = order[np.searchsorted(bodies[order], np.arange(len(runs.sizes)))]
    places, depths = np.stack(np.unravel_index(lost[firsts], reached.shape), axis=1), out[firsts]
    order = np.argsort(-depths, kind="stable")
    kept = order[depths[order] > LEAST_LOSS]
    at = level.in_mm(places[kept][:, ::-1] / SAMPLES)
    return tuple(
        LostFeature((float(x), float(y), float(z)), float(depth) * level.size_mm)
        for (x, y, z), depth in zip(at, depths[kept], strict=True)
    )
