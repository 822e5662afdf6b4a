"""Better hexes of any mesh by moving its nodes; what the boundary looks like stays."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.device import Device
from gpubspline.errors import InputError
from gpubspline.mesh.carry import carry_fields
from gpubspline.mesh.colouring import colour_nodes
from gpubspline.mesh.improve import Effort, climb, copy, improve, placed
from gpubspline.mesh.mesh import Mesh
from gpubspline.mesh.movable import FIXED, FREE, movable, put_level
from gpubspline.mesh.own_surface import Held, hold
from gpubspline.mesh.quality import scaled_jacobian

Floats = NDArray[np.float64]

_EDGES = (((0, 1), (3, 2), (4, 5), (7, 6)), ((0, 3), (1, 2), (4, 7), (5, 6)), ((0, 4), (1, 5), (2, 6), (3, 7)))

SHORTEST = 0.05
"""Least target length of an edge, in the mean one."""


@dataclass(frozen=True)
class Optimized:
    """What an optimisation did.

    Attributes
    ----------
    before, after: least scaled Jacobian.
    farthest_mm: the longest way a node went.
    boundary_mm: farthest that a boundary node now lies from the surface as it was.
    """

    before: float
    after: float
    farthest_mm: float
    boundary_mm: float

    def to_dict(self) -> dict[str, float]:
        """Plain numbers, for JSON."""
        return {
            "before": self.before,
            "after": self.after,
            "farthest_mm": self.farthest_mm,
            "boundary_mm": self.boundary_mm,
        }


def optimize(
    mesh: Mesh, device: Device, *, boundary: str = "slide", effort: Effort | None = None
) -> tuple[Mesh, Optimized]:
    """Raise the worst scaled Jacobian of a mesh of hexes as far as its connectivity allows.

    Arguments
    ---------
    mesh: hex8; sets are kept, nodal fields are carried to where the nodes go, element fields of the quality dropped.
    boundary: ``"slide"``: nodes of the surface go along it, and along its sharp edges; ``"stay"``: they do not move.

    Returns
    -------
    the mesh, never worse than the one given, and what was done.

    Raises
    ------
    InputError where the mesh is not of hex8, or the boundary is told to do something else.
    """
    if mesh.element_type != "hex8":
        raise InputError(f"expected a mesh of hex8 to optimise, got {mesh.element_type}")
    if boundary not in ("slide", "stay"):
        raise InputError(f"expected the boundary to slide or stay, got {boundary!r}")
    points, cells = mesh.points.astype(np.float64), mesh.cells
    middle, unit = points.mean(axis=0), _mean_length(points, cells)
    scaled = (points - middle) / unit
    quads = mesh.boundary()
    held = hold(scaled, quads, device) if boundary == "slide" else _pinned(quads, len(points), device)
    lengths = _log_lengths(scaled, cells)
    hexes = movable(cells, len(points), held.slack, held.level, device, lengths, held.levels)
    x, colours = device.put(np.ascontiguousarray(scaled.T)), colour_nodes(cells, len(points))
    effort = replace(effort or Effort(), loosen=False)
    as_it_is = climb(hexes, colours, placed(hexes, copy(hexes, x), held.slack), effort)
    best = improve(hexes, colours, x, held.slack, effort)
    best = best if best.least > as_it_is.least else as_it_is
    moved = np.array(device.get(best.x)).reshape(3, -1).T.astype(np.float64) * unit + middle
    moved = np.where((held.slack < 0)[:, None], points, moved)
    before = float(scaled_jacobian(mesh, device).min())
    made = _moved(mesh, moved)
    after = float(scaled_jacobian(made, device).min())
    if after <= before:
        return mesh, Optimized(before, before, 0.0, 0.0)
    on = np.unique(quads)
    return made, Optimized(before, after, _farthest(moved - points), _off_surface(mesh, quads, moved[on], device))


def _moved(mesh: Mesh, points: Floats) -> Mesh:
    fields = {name: value.astype(mesh.fields[name].dtype) for name, value in carry_fields(mesh, points).items()}
    kept = {name: values for name, values in mesh.cell_fields.items() if name != "scaled_jacobian"}
    return replace(mesh, points=points.astype(mesh.points.dtype), fields=fields, cell_fields=kept)


def _pinned(quads: NDArray[Any], n: int, device: Device) -> Held:
    slack = np.full(n, FREE)
    slack[quads] = FIXED
    levels = np.stack([np.zeros(n), np.full(n, -1)]).astype(np.int32)
    return Held(put_level(np.ones((2, 2, 2)), np.eye(4)[:3], device), slack, levels)


def _edge_lengths(points: Floats, cells: NDArray[np.int32]) -> Floats:
    """(3, m, 4) of the edges along u, v, w."""
    ends = [[np.linalg.norm(points[cells[:, b]] - points[cells[:, a]], axis=1) for a, b in row] for row in _EDGES]
    return np.asarray(np.array(ends).transpose(0, 2, 1))


def _mean_length(points: Floats, cells: NDArray[np.int32]) -> float:
    return float(_edge_lengths(points, cells).mean())


def _log_lengths(points: Floats, cells: NDArray[np.int32]) -> Floats:
    """Logarithm (3, m) of the squared mean length of each element's edges along u, v, w: what they should stay."""
    means = _edge_lengths(points, cells).mean(axis=2)
    return np.asarray(2 * np.log(np.maximum(means, SHORTEST)))


def _farthest(way: Floats) -> float:
    return float(np.linalg.norm(way, axis=1).max(initial=0.0))


def _off_surface(mesh: Mesh, quads: NDArray[Any], points: Floats, device: Device) -> float:
    from gpubspline.surface.nearest import finder
    from gpubspline.surface.surface import Surface

    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    distance, _ = finder(Surface(mesh.points.astype(np.float64), triangles), device).nearest(points)
    return float(np.max(distance, initial=0.0))
