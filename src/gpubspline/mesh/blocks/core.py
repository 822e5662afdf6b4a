"""The core: the cells of a lattice that lie inside, and their topology."""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label

from gpubspline.mesh.blocks.level_set import SAMPLES

Cells = NDArray[np.bool_]


def cell_means(phi: NDArray[np.float32]) -> NDArray[np.float32]:
    """Mean of a sampled distance, in elements, over the eight corners of each lattice cell (n_k, n_j, n_i)."""
    corners = phi[::SAMPLES, ::SAMPLES, ::SAMPLES]
    for axis in range(3):
        low = np.moveaxis(corners, axis, 0)
        corners = np.moveaxis(0.5 * (low[:-1] + low[1:]), 0, axis)
    return np.ascontiguousarray(corners, dtype=np.float32)


def core_cells(means: NDArray[np.float32]) -> Cells:
    """Cells whose mean is inside, less spikes (one neighbour or none), with dents filled (five neighbours or more)."""
    kept = means < 0
    kept &= count_neighbours(kept) > 1
    return np.asarray(kept | (count_neighbours(kept) >= 5))


def count_neighbours(cells: Cells) -> NDArray[np.uint8]:
    """Face neighbours of each cell; there are none beyond the border."""
    padded = np.pad(cells, 1).astype(np.uint8)
    inner = slice(1, -1)
    total = np.zeros(cells.shape, dtype=np.uint8)
    for axis in range(3):
        for side in (slice(0, -2), slice(2, None)):
            window = [inner, inner, inner]
            window[axis] = side
            total += padded[tuple(window)]
    return total


def largest_body(cells: Cells) -> Cells:
    """Keep the largest of the bodies that cell faces connect; of equal ones the first."""
    labels, count = label(cells)
    if count < 2:
        return cells
    return np.asarray(labels == 1 + int(np.argmax(np.bincount(labels.reshape(-1))[1:])))


def euler_characteristic(cells: Cells) -> int:
    """Vertices less edges plus faces less cells of the union of closed cells.

    One for each body, less one for each tunnel, plus one for each enclosed cavity.
    """
    padded = np.pad(cells, 1)
    total = 0
    for which in range(8):
        touched = padded
        for axis in range(3):
            if which >> axis & 1:
                low = np.moveaxis(touched, axis, 0)
                touched = np.moveaxis(low[:-1] | low[1:], 0, axis)
        dimension = 3 - which.bit_count()
        total += (-1) ** dimension * int(np.count_nonzero(touched))
    return total
