"""What the faces of a mesh cut off: nodes on a curved surface leave its bilinear faces inside, the more the larger.

The level set is moved by the sag of faces of one element before nodes are placed (``bulged``). Round thin rods and
along sharp edges faces are larger, and the bend is no second difference: there it is measured on the mesh made.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from gpubspline.mesh.blocks.bricks import bricks_round
from gpubspline.mesh.blocks.level_set import CLIP, SAMPLES, Field, spread

FARTHEST = 0.25
"""Most, in elements, that the level set is moved for it."""

_AT = np.array([0.0, 0.5, 1.0])
_V, _U = (index.ravel() for index in np.meshgrid(_AT, _AT, indexing="ij"))
_SHAPES = np.stack([(1 - _U) * (1 - _V), _U * (1 - _V), _U * _V, (1 - _U) * _V], axis=1)
_SIMPSON = np.outer([1, 4, 1], [1, 4, 1]).ravel() / 36


@dataclass(frozen=True, eq=False)
class Chords:
    """How far faces lie from a level set, in elements, outside positive.

    Attributes
    ----------
    centres: (f, 3) of faces, lattice coordinates.
    off: (f,) mean over each face.
    areas: (f,) of faces.
    """

    centres: NDArray[np.float64]
    off: NDArray[np.float64]
    areas: NDArray[np.float64]

    @property
    def volume(self) -> float:
        """What lies between the faces and the level set, more outside positive, in elements."""
        return float(self.off @ self.areas)

    def added_to(self, phi: Field) -> Field:
        """Move a level set by the mean distance of the faces around, which brings them back to it."""
        cells = tuple((n - 1) // SAMPLES for n in phi.shape)
        at = np.clip(np.floor(self.centres[:, ::-1]).astype(np.int64), 0, np.array(cells) - 1)
        number = np.ravel_multi_index(tuple(at.T), cells)
        weight, total = (
            np.bincount(number, values, int(np.prod(cells))).reshape(cells)
            for values in (self.areas, self.areas * self.off)
        )
        bricks = bricks_round(phi, CLIP)
        off = np.clip(bricks.between_cells(spread(weight, total), SAMPLES), -FARTHEST, FARTHEST)
        return bricks.put(bricks.of(phi, -CLIP, CLIP) + off, phi.copy())


def measure_chords(
    points: NDArray[Any], quads: NDArray[np.int32], phi: NDArray[np.float32], volume: float | None = None
) -> Chords:
    """Sample a level set at 3 x 3 points of each face.

    Arguments
    ---------
    points: (n, 3) nodes, lattice coordinates.
    quads: (f, 4) faces.
    phi: (n_k, n_j, n_i) samples, in elements.
    volume: that the level set holds, in elements: all distances of closed faces are shifted to what theirs differs by.
    """
    corners = points[quads].astype(np.float64)
    places = np.einsum("pa,fax->fpx", _SHAPES, corners).reshape(-1, 3)
    values = map_coordinates(phi, places[:, ::-1].T * SAMPLES, order=1, mode="nearest").reshape(len(quads), -1)
    across = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    centres, off, areas = corners.mean(axis=1), values @ _SIMPSON, 0.5 * np.linalg.norm(across, axis=1)
    if volume is not None:
        missing = 0.5 * float(np.einsum("fx,fx->", centres - centres[0], across)) / 3 - volume
        off = off + (missing - off @ areas) / areas.sum()
    return Chords(centres, off, areas)
