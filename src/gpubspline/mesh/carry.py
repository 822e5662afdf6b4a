"""Nodal fields carried along when nodes move: their value goes on with the slope of the element that they move into."""

import numpy as np
from numpy.typing import NDArray

from gpubspline.mesh.mesh import Mesh
from gpubspline.mesh.movable import node_slots

Floats = NDArray[np.float64]

_SIGNS = np.array([(-1, -1, -1), (1, -1, -1), (1, 1, -1), (-1, 1, -1), (-1, -1, 1), (1, -1, 1), (1, 1, 1), (-1, 1, 1)])
"""Of the vertices of a hex along u, v, w, and of a quad the first four along u, v; one part in as many as there are
vertices of them are the slopes of the shape functions at the centre."""


def carry_fields(old: Mesh, points: Floats) -> dict[str, NDArray[np.float64]]:
    """Values (n,) of each nodal field of hex8 or quad4 at new places (n, 3) of its nodes.

    To first order: exact for linear fields, and nothing changes for nodes that stay. The slope is that at the centre of
    the element, among those that the node belongs to, that holds its new place best. No value goes beyond the least
    and the greatest of its field.
    """
    if not old.fields:
        return {}
    start, slots = node_slots(old.cells, old.n_nodes)
    own = slots % old.n_elements
    corners = old.points.astype(np.float64)
    way = points - corners
    moved = np.flatnonzero(np.any(way != 0, axis=1))
    into = _elements_entered(corners, old.cells, points[moved], start[moved], np.diff(start)[moved], own)
    cells = old.cells[into]
    across = np.linalg.pinv(_tangents(corners[cells]))
    carried = {}
    for name, field in old.fields.items():
        values = field.astype(np.float64)
        slope = np.einsum("nk,kd,ndc->nc", values[cells], _slopes(cells.shape[1]), across)
        ahead = values[moved] + np.einsum("nc,nc->n", slope, way[moved])
        carried[name] = values.copy()
        carried[name][moved] = np.clip(ahead, values.min(), values.max())
    return carried


def _elements_entered(
    corners: Floats,
    cells: NDArray[np.int32],
    points: Floats,
    start: NDArray[np.int32],
    counts: NDArray[np.int64],
    own: NDArray[np.int32],
) -> NDArray[np.int32]:
    """Element (n,) in whose parameters each point lies nearest to the centre, of those that its node belongs to."""
    best, into = np.full(len(points), np.inf), own[start]
    for turn in range(int(counts.max(initial=0))):
        at = np.flatnonzero(counts > turn)
        element = own[start[at] + turn]
        hexes = corners[cells[element]]
        off = points[at] - hexes.mean(axis=1)
        outside = np.abs(np.einsum("ndc,nc->nd", np.linalg.pinv(_tangents(hexes)), off)).max(axis=1)
        better = outside < best[at]
        best[at[better]], into[at[better]] = outside[better], element[better]
    return into


def _tangents(elements: Floats) -> Floats:
    """Derivatives (n, 3, d), coordinate by parameter, of hexes (n, 8, 3) or quads (n, 4, 3) at their centres."""
    return np.asarray(np.einsum("nkc,kd->ncd", elements, _slopes(elements.shape[1])))


def _slopes(n_corners: int) -> Floats:
    return _SIGNS[:n_corners, : 3 if n_corners == 8 else 2] / n_corners
