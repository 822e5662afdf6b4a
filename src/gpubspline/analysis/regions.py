"""Regions of a mesh's surface, where supports and loads act.

A region is asked at sample points of the surface, so that it cuts through faces: what it catches depends on the body,
and hardly on the mesh. Points are in patient mm (LPS); directions follow the axes of the load case.
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from gpubspline.errors import GpubsplineWarning, InputError
from gpubspline.mesh.elements import ELEMENTS, Element
from gpubspline.mesh.mesh import Mesh

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Vector = tuple[float, float, float]

_POINTS = 4
"""Gauss points per parameter of a face: exact for the forces on a curved face of order 2 that lies in the region."""

_SAMPLES, _MOST_PARTS = 1_000_000, 8
"""Faces are cut into parts along either parameter, each with its Gauss points, for about so many samples in all: the
edge of a region then lies as exactly on a mesh of few faces as on one of many.
"""


FAR_MM = 10.0
"""Outside a mesh's box, from which the point of a patch is asked about: other axes, or another patient's."""


@dataclass(frozen=True, eq=False)
class Surface:
    """Sample points of the outer faces of hexes.

    Attributes
    ----------
    mesh: hexes.
    axes: (3,) of 1 and -1, from the load case's axes to the patient's x, y, z.
    faces: (f, k) node numbers, outward.
    at: (s, 2) parameters in 0..1 of the samples of each face.
    weights: (s,) of the samples, or None for samples at the faces' own nodes, in their order.
    body: the mesh whose width and outermost points regions are measured by.
    """

    mesh: Mesh
    axes: Floats
    faces: NDArray[np.int32]
    at: Floats
    weights: Floats | None
    body: Mesh

    @property
    def face(self) -> Element:
        """Element type of a face."""
        return ELEMENTS[self.mesh.element.side_name]

    @cached_property
    def shape(self) -> Floats:
        """(s, k) shape functions at the samples."""
        return self.face.shape(self.at)

    @cached_property
    def points_mm(self) -> Floats:
        """(f, s, 3) the samples, mm."""
        return np.asarray(np.matmul(self.shape, self._nodes))

    @cached_property
    def normals(self) -> Floats:
        """(f, s, 3) outward normals as long as the area per unit of the parameters, mm2."""
        along_u, along_v = (np.matmul(gradient, self._nodes) for gradient in self.face.gradient(self.at))
        return np.cross(along_u, along_v)

    @cached_property
    def areas_mm2(self) -> Floats:
        """(f, s) the area, mm2, that each sample stands for."""
        size = np.linalg.norm(self.normals, axis=2)
        return np.asarray(size if self.weights is None else size * self.weights)

    @cached_property
    def slack_mm(self) -> float:
        """What the mesh's coordinates may be off by, and points that shape functions make of them, mm."""
        return 32 * float(np.finfo(self.mesh.points.dtype).eps) * float(np.abs(self.mesh.points).max())

    @cached_property
    def _nodes(self) -> Floats:
        return np.asarray(self.mesh.points[self.faces], dtype=np.float64)


@dataclass(frozen=True, eq=False)
class Shell:
    """Points (n, 3), mm, of a body whose surface is not there yet, but will be within ``slack_mm`` of them."""

    points_mm: Floats
    axes: Floats
    slack_mm: float


def surfaces(mesh: Mesh, axes: Floats, body: Mesh | None = None) -> tuple[Surface, Surface]:
    """Surface of a mesh at Gauss points, where loads act, and at its nodes, which supports hold.

    ``body`` is the mesh whose width and outermost points regions are measured by, the same one unless given.

    Raises
    ------
    InputError where the mesh is not of hexes.
    """
    if mesh.element.dimension != 3:
        raise InputError(f"expected hexes to load, got {mesh.element_type}")
    faces = mesh.boundary()
    own = np.array(ELEMENTS[mesh.element.side_name].vertices) / 2
    at, weights = _samples(len(faces))
    body = mesh if body is None else body
    return Surface(mesh, axes, faces, at, weights, body), Surface(mesh, axes, faces, own, None, body)


def _samples(n_faces: int) -> tuple[Floats, Floats]:
    """Parameters (s, 2) in 0..1 and weights (s,) of the samples of a face."""
    parts = int(np.clip(np.sqrt(_SAMPLES / (_POINTS**2 * max(n_faces, 1))), 1, _MOST_PARTS))
    points, weights = np.polynomial.legendre.leggauss(_POINTS)
    along = ((np.arange(parts)[:, None] + (points + 1) / 2) / parts).ravel()
    shares = np.tile(weights / 2 / parts, parts)
    grid = np.stack(np.meshgrid(along, along, indexing="ij"), axis=-1).reshape(-1, 2)
    return grid, np.outer(shares, shares).ravel()


class Part(Protocol):
    """One condition on the samples of a surface."""

    def holds(self, surface: Surface) -> Flags:
        """Where it holds, (f, s) or what broadcasts to it."""
        ...


@dataclass(frozen=True)
class Region:
    """The part of a surface where every one of its parts holds; ``name`` is what errors and reports call it."""

    name: str
    parts: tuple[Part, ...]

    def inside(self, surface: Surface) -> Flags:
        """Which samples (f, s) lie in the region.

        Raises
        ------
        InputError, which names the region, where none does. The point of a patch that lies far from the body is warned
        of.
        """
        inside = np.ones((len(surface.faces), len(surface.at)), dtype=np.bool_)
        for part in self.parts:
            inside &= part.holds(surface)
            if isinstance(part, Patch):
                self._warn_of_far(part, surface)
        if not inside.any():
            raise InputError(
                f"expected the region {self.name!r} to catch a part of the surface, got none: {_place(surface)}"
            )
        return inside

    def check_near(self, shell: Shell) -> None:
        """Raise InputError where a body that is not meshed yet has no point near to all of the region's bounds."""
        bounds = [part.holds(shell) for part in self.parts if isinstance(part, Sphere | Box | HalfSpace)]
        if bounds and not np.logical_and.reduce(bounds).any():
            raise InputError(
                f"expected the region {self.name!r} to catch a part of the body's surface, got none: the body spans "
                + _spans(shell.points_mm)
            )

    def _warn_of_far(self, patch: "Patch", surface: Surface) -> None:
        points, point = surface.mesh.points, np.array(patch.point_mm)
        away = float(np.linalg.norm(point - np.clip(point, points.min(axis=0), points.max(axis=0))))
        if away > FAR_MM:
            words = f"the point of the region {self.name!r} lies {away:.0f} mm outside the mesh's box, LPS: "
            warnings.warn(words + _place(surface), GpubsplineWarning, stacklevel=2)


def _place(surface: Surface) -> str:
    return f"the mesh spans {_spans(surface.mesh.points)}"


def _spans(points: NDArray[Any]) -> str:
    low, high = points.min(axis=0), points.max(axis=0)
    spans = (f"{c} {a:.1f} to {b:.1f}" for c, a, b in zip("xyz", low, high, strict=True))
    return f"{', '.join(spans)} mm"


@dataclass(frozen=True)
class Side:
    """A face of a structured mesh (``"u0"`` to ``"w1"``), a node set, or ``"surface"``, all of it."""

    name: str

    def holds(self, surface: Surface) -> Flags:
        """Hold at the nodes of the set, and on the faces that have all their nodes in it."""
        if self.name == "surface":
            return np.ones((1, 1), dtype=np.bool_)
        among = np.zeros(surface.mesh.n_nodes, dtype=np.bool_)
        among[self._members(surface.mesh)] = True
        nodes = among[surface.faces]
        return np.asarray(nodes if surface.weights is None else nodes.all(axis=1, keepdims=True))

    def _members(self, mesh: Mesh) -> NDArray[Any]:
        if self.name in mesh.node_sets:
            return mesh.node_sets[self.name]
        if mesh.structure is not None and self.name in mesh.element.sides:
            return np.asarray(mesh.boundary(self.name))
        sides = mesh.element.sides if mesh.structure is not None else ()
        known = dict.fromkeys(["surface", *mesh.node_sets, *sides])
        raise InputError(f"expected a region of the load case or one of {', '.join(known)}, got {self.name!r}")


@dataclass(frozen=True)
class Sphere:
    """What lies in a ball."""

    centre_mm: Vector
    radius_mm: float

    def holds(self, surface: Surface | Shell) -> Flags:
        """Hold up to the radius."""
        slack = surface.slack_mm if isinstance(surface, Shell) else 0.0
        return np.asarray(_distance(surface, self.centre_mm) <= self.radius_mm + slack)


@dataclass(frozen=True)
class Box:
    """What lies between two corners, along the patient's axes."""

    low_mm: Vector
    high_mm: Vector

    def holds(self, surface: Surface | Shell) -> Flags:
        """Hold between the corners, to rounding of the mesh's coordinates."""
        slack, points = surface.slack_mm, surface.points_mm
        within = (points >= np.array(self.low_mm) - slack) & (points <= np.array(self.high_mm) + slack)
        return np.asarray(within.all(axis=-1))


@dataclass(frozen=True)
class HalfSpace:
    """What lies on the side of a plane that its normal points to, the plane included."""

    point_mm: Vector
    normal: Vector

    def holds(self, surface: Surface | Shell) -> Flags:
        """Hold beyond the plane, to rounding of the mesh's coordinates."""
        normal = np.array(self.normal) * surface.axes / np.linalg.norm(self.normal)
        slack = surface.slack_mm
        return np.asarray((surface.points_mm - np.array(self.point_mm)) @ normal >= -slack)


@dataclass(frozen=True)
class Patch:
    """The surface nearest to a point: a disc of a radius about the foot of the point, or as near as fills an area.

    The distance d of the surface from the point is stationary at its foot, so that the disc, all within
    sqrt(d^2 + radius^2), does not jump with the mesh.
    """

    point_mm: Vector
    radius_mm: float | None = None
    area_mm2: float | None = None

    def holds(self, surface: Surface) -> Flags:
        """Hold near the foot."""
        distance = _distance(surface, self.point_mm)
        if self.radius_mm is not None:
            return np.asarray(distance <= np.hypot(distance.min(), self.radius_mm) + surface.slack_mm)
        if surface.weights is None:  # a node has no area of its own
            return Patch(self.point_mm, radius_mm=np.sqrt((self.area_mm2 or 0.0) / np.pi)).holds(surface)
        order = np.argsort(distance, axis=None)
        filled = np.cumsum(surface.areas_mm2.ravel()[order])
        last = min(int(np.searchsorted(filled, self.area_mm2 or 0.0)), order.size - 1)
        return np.asarray(distance <= distance.ravel()[order[last]])


@dataclass(frozen=True)
class Cap:
    """The end of a body in a direction: what lies within a depth of its outermost point.

    Attributes
    ----------
    towards: direction, of any length.
    depth: mm, or a share of the body's width where ``of_width``: the greater of its extents along x and y.
    within_deg: how far the outward normal may turn away from the direction, or None for any surface.
    """

    towards: Vector
    depth: float
    of_width: bool = False
    within_deg: float | None = None

    def holds(self, surface: Surface) -> Flags:
        """Hold between the outermost point and the depth below it."""
        towards = np.array(self.towards) * surface.axes / np.linalg.norm(self.towards)
        height = surface.points_mm @ towards
        top = float((towards @ surface.body.planes.astype(np.float64)).max())
        depth = self.depth * (width_mm(surface.body.points) if self.of_width else 1.0)
        inside = height >= top - depth - surface.slack_mm
        if self.within_deg is None:
            return np.asarray(inside)
        along = surface.normals @ towards >= np.cos(np.radians(self.within_deg)) * np.linalg.norm(
            surface.normals, axis=2
        )
        return np.asarray(inside & along)


def width_mm(points: NDArray[Any]) -> float:
    """Greater of the extents of points (n, 3) along x and y, mm: of a femur's, from its head to its trochanter."""
    return float(np.ptp(points[:, :2], axis=0).max())


def _distance(surface: Surface | Shell, point_mm: Sequence[float]) -> Floats:
    return np.asarray(np.linalg.norm(surface.points_mm - np.array(point_mm), axis=-1))
