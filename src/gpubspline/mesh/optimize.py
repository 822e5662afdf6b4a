"""Better elements of any mesh by moving its nodes; what the boundary looks like stays."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gpubspline.device import Buffer, Device, check_device
from gpubspline.errors import InputError, expect
from gpubspline.mesh.carry import carry_fields
from gpubspline.mesh.colouring import colour_nodes
from gpubspline.mesh.floors import ANY_LENGTH, Effort, climb, copy, placed
from gpubspline.mesh.grading import graded
from gpubspline.mesh.improve import improve
from gpubspline.mesh.mesh import Mesh
from gpubspline.mesh.movable import FIXED, Movable, movable
from gpubspline.mesh.neighbourhood import edge_lengths
from gpubspline.mesh.own_surface import cuts_for, hold
from gpubspline.mesh.persist import persist
from gpubspline.mesh.pieces import bilinear
from gpubspline.mesh.quality import scaled_jacobian
from gpubspline.mesh.validity import certify
from gpubspline.spline.hyperpatch import Hyperpatch
from gpubspline.surface.nearest import finder

Floats = NDArray[np.float64]

SHORTEST = 0.05
"""Least target length of an edge, in the mean one."""

OPENED_BELOW = 0.35
"""Least scaled Jacobian below which another start is tried, whose corners are opened."""


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
    mesh: Mesh,
    device: Device,
    *,
    boundary: str = "slide",
    effort: Effort | None = None,
    patch: Hyperpatch | None = None,
) -> tuple[Mesh, Optimized]:
    """Raise the worst scaled Jacobian of a mesh of hexes or quads as far as its connectivity allows.

    Arguments
    ---------
    mesh: hex8 or quad4; sets are kept, nodal fields are carried to where the nodes go, element fields of the quality
        dropped. Quads stay on the surface that they are.
    boundary: ``"slide"``: nodes of the surface go along it, and along its sharp edges; ``"stay"``: they do not move.
    patch: what the mesh samples, evenly: its boundary is what nodes go along, instead of the faces between nodes.

    Returns
    -------
    the mesh, never worse than the one given, and what was done. Of what is reached on the way the best is taken whose
    hexes are certified throughout, if any is.

    Raises
    ------
    InputError where the mesh is of other elements, a node is nowhere, or the boundary is told to do something else.
    """
    expect(mesh, Mesh, "sample makes one, read_mesh reads one")
    check_device(device)
    if mesh.element_type not in ("hex8", "quad4"):
        raise InputError(
            f"expected a mesh of hex8 or quad4 to optimise, got {mesh.element_type}, whose nodes midway would be left "
            "behind: mesh with --order 1"
        )
    if boundary not in ("slide", "stay"):
        raise InputError(f"expected the boundary to slide or stay, got {boundary!r}")
    mesh.check_finite()
    effort = replace(effort or Effort(), few=0.0, loosen=False, **ANY_LENGTH)
    start = _Start(mesh, patch, device)
    moved, rank = start.improved(start.points, start.held.at, boundary, effort)
    if boundary == "slide" and rank[1] < min(OPENED_BELOW, effort.goal):
        opened = start.opened(patch)
        if opened is not None:
            other, its_rank = start.improved(*opened, boundary, effort)
            moved = other if its_rank > rank else moved
    before = float(scaled_jacobian(mesh, device).min())
    made = _moved(mesh, moved)
    after = float(scaled_jacobian(made, device).min())
    if after <= before:
        return mesh, Optimized(before, before, 0.0, 0.0)
    way = float(np.linalg.norm(moved - mesh.points, axis=1).max())
    return made, Optimized(before, after, way, start.off_surface(moved))


class _Start:
    """A mesh and the surface that its nodes walk on, in units of its mean edge from its middle."""

    def __init__(self, mesh: Mesh, patch: Hyperpatch | None, device: Device) -> None:
        self.mesh, self.device = mesh, device
        self.quads = mesh.boundary() if mesh.element.dimension == 3 else mesh.cells
        points, cut = mesh.points.astype(np.float64), None
        self.middle, self.unit = points.mean(axis=0), float(edge_lengths(points, mesh.cells).mean())
        self.points = self._scaled(points)
        if patch is not None:
            parameters = bilinear(_even(mesh)[self.quads], cuts_for(self.quads))
            cut = self._scaled(_sampled(mesh, patch, parameters, device))
        self.held = hold(self.points, self.quads, device, cut)

    def _scaled(self, points: Floats) -> Floats:
        return np.asarray((points - self.middle) / self.unit)

    def opened(self, patch: Hyperpatch | None) -> tuple[Floats, NDArray[np.int64]] | None:
        """Nodes (n, 3) with longer edges at flat corners, and the piece (n,) each is on; None where none is flat."""
        if patch is None or self.mesh.element.dimension < 3:
            return None
        parameters = graded(self.mesh, self.device)
        if parameters is None:
            return None
        points = self._scaled(_sampled(self.mesh, patch, parameters, self.device))
        return points, self.held.found(points, self.device)

    def improved(
        self, points: Floats, at: NDArray[np.int64], boundary: str, effort: Effort
    ) -> tuple[Floats, tuple[bool, float]]:
        """Places (n, 3), mm, of the nodes of better elements from a start, and how good they are.

        That is whether all are valid throughout, as quads always are, and the least scaled Jacobian.
        """
        mesh, held, device = self.mesh, self.held, self.device
        if boundary == "stay":
            held.slack[mesh.boundary_nodes()] = FIXED
        lengths = _log_lengths(points, mesh.cells)
        hexes = movable(mesh.cells, mesh.n_nodes, held.slack, held.level, device, lengths, held.levels)
        x = device.put(np.ascontiguousarray(np.vstack([points.T, at])))
        colours = colour_nodes(mesh.cells, mesh.n_nodes)
        as_it_is = climb(hexes, colours, placed(hexes, copy(hexes, x), held.slack), effort)
        best = improve(hexes, colours, x, held.slack, effort)
        reached = persist(hexes, colours, best if best.least > as_it_is.least else as_it_is, effort)
        for one in reversed(reached):  # the last whose hexes are valid throughout, not at their corners alone
            places = self._places(hexes, one.x)
            if mesh.element.dimension < 3 or certify(_bare(mesh, places), device).certificate.valid:
                return places, (True, one.least)
        return self._places(hexes, reached[-1].x), (False, reached[-1].least)

    def _places(self, hexes: Movable, x: Buffer) -> Floats:
        """Places (n, 3), mm, of nodes x."""
        hexes.slide(x)
        moved = np.array(self.device.get(hexes.slid(x))).reshape(3, -1).T.astype(np.float64)
        return np.where((self.held.slack < 0)[:, None], self.mesh.points, moved * self.unit + self.middle)

    def off_surface(self, points: Floats) -> float:
        """Farthest, mm, that nodes of the surface at points (n, 3) lie from it."""
        distance, _ = finder(self.held.surface, self.device).nearest(self._scaled(points[np.unique(self.quads)]))
        return float(np.max(distance, initial=0.0)) * self.unit


def _even(mesh: Mesh) -> Floats:
    """Parameters (n, d), 0 to 1, of the nodes of a structured mesh."""
    assert mesh.structure is not None
    at = np.stack(np.unravel_index(np.arange(mesh.n_nodes), mesh.structure, order="F"), axis=1)
    return np.asarray(at / (np.array(mesh.structure) - 1))


def _sampled(mesh: Mesh, patch: Hyperpatch, parameters: Floats, device: Device) -> Floats:
    """Points (..., 3), mm, of the patch at the mesh's parameters (..., d), whose u may run against the patch's."""
    ends = np.zeros((2, parameters.shape[-1]))
    ends[1, 0] = 1.0
    far = np.linalg.norm(patch.evaluate_points(ends, device)[:, :3] - mesh.points[0], axis=1)
    flat = parameters.reshape(-1, parameters.shape[-1]).copy()
    flat[:, 0] = 1 - flat[:, 0] if far[1] < far[0] else flat[:, 0]
    found = patch.evaluate_points(flat, device)[:, :3]
    return found.reshape(*parameters.shape[:-1], 3).astype(np.float64)


def _bare(mesh: Mesh, points: Floats) -> Mesh:
    """The elements alone, of other places."""
    return Mesh(points.astype(mesh.points.dtype), mesh.element_type, connectivity=mesh.cells)


def _moved(mesh: Mesh, points: Floats) -> Mesh:
    fields = {name: value.astype(mesh.fields[name].dtype) for name, value in carry_fields(mesh, points).items()}
    kept = {name: values for name, values in mesh.cell_fields.items() if name != "scaled_jacobian"}
    return replace(mesh, points=points.astype(mesh.points.dtype), fields=fields, cell_fields=kept)


def _log_lengths(points: Floats, cells: NDArray[np.int32]) -> Floats:
    """Logarithm (3, m), of quads (2, m), of the squared mean length of elements' edges along u, v, w: their target."""
    means = edge_lengths(points, cells).mean(axis=2)
    return np.asarray(2 * np.log(np.maximum(means, SHORTEST)))
