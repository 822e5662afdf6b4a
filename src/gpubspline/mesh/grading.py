"""Where a hex mesh of one patch has flat corners: longer edges at the patch's corner lines, which open them.

A patch whose section is a smooth contour has four corner lines on it, and the hexes there open by no more than the
contour turns over their two edges: 2 degrees where 200 edges go round, for a scaled Jacobian of 0.03. Longer edges
there, and shorter ones between, turn more.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d, maximum_filter1d

from gpubspline.device import Device
from gpubspline.mesh.mesh import Mesh
from gpubspline.mesh.quality import corner_scaled_jacobian

Floats = NDArray[np.float64]

FIRST = (0.12, 0.06)
"""Share of the first and the last edge in a row along u and along v, where all is graded."""

EVEN = 0.15
"""Share of even spacing in a graded row: the shortest edges, in even ones."""

FLAT = 0.5
"""Scaled Jacobian at a corner line below which layers along w are graded."""

WIDEN, SMOOTH = 2, 2.0
"""Layers by which what is graded is widened, and standard deviation of its passing into what is not, in layers."""

FEWEST = 6
"""Nodes in a row from which grading it is worth while."""


def graded(mesh: Mesh, device: Device) -> Floats | None:
    """Parameters (n, 3), 0 to 1, that open the corners of a structured mesh of hex8; None where it has no flat ones."""
    assert mesh.structure is not None
    n_u, n_v, n_w = mesh.structure
    if min(n_u, n_v) < FEWEST:
        return None
    corners = corner_scaled_jacobian(mesh, device).reshape(n_w - 1, n_v - 1, n_u - 1, 8)
    least = corners[:, [0, -1]][:, :, [0, -1]].min(axis=(1, 2, 3))
    flat = (np.append(least, 1.0) < FLAT) | (np.append(1.0, least) < FLAT)  # of layers of nodes
    if not flat.any():
        return None
    share = gaussian_filter1d(maximum_filter1d(flat.astype(np.float64), 2 * WIDEN + 1), SMOOTH, mode="nearest")
    w, v, u = np.meshgrid(*(np.arange(n) for n in (n_w, n_v, n_u)), indexing="ij")
    rows = [(u, n_u, FIRST[0]), (v, n_v, FIRST[1])]
    along = [(1 - share[w]) * at / (n - 1) + share[w] * spaced(n, first)[at] for at, n, first in rows]
    return np.stack([*along, w / (n_w - 1)], axis=-1).reshape(-1, 3)


def spaced(n: int, first: float) -> Floats:
    """Places (n,) from 0 to 1 whose first and last gap are ``first``, no less than even; the others shrink inwards."""
    even = np.linspace(0.0, 1.0, n)
    wanted = (first - EVEN / (n - 1)) / (1 - EVEN)
    inner = 1 - 2 / (n - 1)
    if wanted <= (1 - inner) / 2:
        return even
    power = np.log(1 - 2 * min(wanted, 0.45)) / np.log(inner)
    s = 2 * even - 1
    return np.asarray(EVEN * even + (1 - EVEN) * (0.5 + 0.5 * np.sign(s) * np.abs(s) ** power))
