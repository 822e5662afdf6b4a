"""A load case on a mesh: which nodes are held, and the nodal forces that do the work of the loads.

Forces are consistent: f_a = integral of N_a t dA over the surface, of N_a rho g dV over the body, with the shape
functions N_a of the elements, so that an even traction on hex8 and hex20 passes the patch test.
"""

import warnings
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.analysis.load_case import Force, LoadCase, Pressure, Support
from gpubspline.analysis.load_case import load_case as load_case
from gpubspline.analysis.load_case import load_cases as load_cases
from gpubspline.analysis.regions import FAR_MM, Flags, Floats, Shell, Surface, surfaces, width_mm
from gpubspline.ct.region import Region as BodyRegion
from gpubspline.errors import GpubsplineWarning, InputError
from gpubspline.mesh.mesh import Mesh
from gpubspline.shown import brief

TONNE_MM3 = 1e-9
"""Of 1 g/cm3: the unit of mass that goes with mm, N and MPa."""

ROUNDING = 1e-6
"""Of all that pushes on a region: a smaller total is what float32 places and sums leave of 0."""

_ELEMENTS = 1 << 14
"""Elements integrated at a time, which bounds the memory."""

_VOXELS = 1_000_000
"""Voxels of a body, about, by which it is judged before it is meshed."""

_TELLING = 0.05
"""Share of the width by which the head must lie off the middle for a femur to tell its side."""


@dataclass(frozen=True)
class Applied:
    """What became of one support or load.

    Attributes
    ----------
    kind: ``"fixed"``, ``"force"``, ``"pressure"`` or ``"gravity"``.
    region: its name; ``"body"`` for gravity.
    area_mm2: of the region, of a support its whole faces; 0 for gravity.
    nodes: how many it holds or moves.
    force_n: (3,) total force, zero for a support, N, patient axes.
    centre_mm: (3,) mean of its points, mm.
    held: whether a load pushes nothing but what is held where it pushes.
    """

    kind: str
    region: str
    area_mm2: float
    nodes: int
    force_n: Floats
    centre_mm: Floats
    held: bool = False

    def to_dict(self) -> dict[str, Any]:
        """Plain values, for JSON."""
        place = {"force_n": self.force_n.tolist(), "centre_mm": self.centre_mm.tolist()}
        return {"kind": self.kind, "region": self.region, "area_mm2": self.area_mm2, "nodes": self.nodes, **place}


@dataclass(frozen=True, eq=False)
class AssembledLoads:
    """A load case on the nodes of a mesh, in patient axes.

    Attributes
    ----------
    fixed: (n, 3) bool, which components are held.
    prescribed_mm: (n, 3) float64, where they are held, mm; zero elsewhere.
    forces_n: (n, 3) float64, consistent nodal forces, N.
    gripped: (n,) bool, nodes that are held or carry a force; pressure and gravity make no singular stress.
    away_mm: how near to them stress is left out of the maximum.
    report: what became of each support and load.
    """

    fixed: Flags
    prescribed_mm: Floats
    forces_n: Floats
    gripped: Flags
    away_mm: float
    report: tuple[Applied, ...]

    __repr__ = brief

    @property
    def applied_n(self) -> Floats:
        """(3,) total of all loads, N."""
        return np.asarray(self.forces_n.sum(axis=0))

    def warn_of_held(self) -> None:
        """Warn of loads that go straight into a support and move nothing."""
        for load in self.report:
            if load.held:
                warnings.warn(
                    f"the {load.kind} on {load.region!r} pushes nothing but nodes that are held: it goes straight into "
                    "the support",
                    GpubsplineWarning,
                    stacklevel=2,
                )

    def moment_nmm(self, mesh: Mesh, about_mm: Floats | None = None) -> Floats:
        """(3,) total moment of all loads, N mm, about a point (3,), the origin where None."""
        arms = mesh.points.astype(np.float64) - (0.0 if about_mm is None else about_mm)
        return np.asarray(np.cross(arms, self.forces_n).sum(axis=0))


def assemble(case: LoadCase, mesh: Mesh, body: Mesh | None = None) -> AssembledLoads:
    """Put a load case on a mesh of hexes.

    Arguments
    ---------
    body: the mesh by which caps and shares of the width are measured, ``mesh`` itself unless given: meshes of different
        density of one body then are loaded at the same places.

    Raises
    ------
    InputError where a region catches nothing of the surface, the mesh is not of hexes, gravity finds no density, or
    ``axes = "femur"`` no side.
    """
    body = mesh if body is None else body
    axes = patient_axes(case.axes, body.points)
    at_gauss, at_nodes = surfaces(mesh, axes, body)
    made = AssembledLoads(
        fixed=np.zeros((mesh.n_nodes, 3), dtype=np.bool_),
        prescribed_mm=np.zeros((mesh.n_nodes, 3)),
        forces_n=np.zeros((mesh.n_nodes, 3)),
        gripped=np.zeros(mesh.n_nodes, dtype=np.bool_),
        away_mm=case.away * (width_mm(body.points) if case.away_of_width else 1.0),
        report=(),
    )
    report = [_hold(made, support, at_nodes, at_gauss, axes) for support in case.supports]
    pushes: tuple[Force | Pressure, ...] = (*case.forces, *case.pressures)
    report += [_push(made, load, at_gauss, axes) for load in pushes]
    if case.gravity_mm_s2 is not None:
        report.append(_weigh(made, np.array(case.gravity_mm_s2) * axes, mesh))
    return replace(made, report=tuple(report))


def check_on_body(case: LoadCase, region: BodyRegion) -> None:
    """Raise ``InputError`` where a load case cannot fit what a region will be meshed to, before it is.

    Said of a femur without a side, and of regions farther than ``FAR_MM`` from the body; ``assemble`` finds the rest.
    """
    step = max(1, round(float(np.cbrt(np.count_nonzero(region.mask) / _VOXELS))))
    k, j, i = (step * index for index in np.nonzero(region.mask[::step, ::step, ::step]))
    points = np.stack([i, j, k], axis=1) @ region.affine[:3, :3].T + region.affine[:3, 3]
    axes = patient_axes(case.axes, points, _TELLING / 2)
    shell = Shell(points, axes, FAR_MM + step * float(np.linalg.norm(region.spacing_mm)))
    acting: tuple[Support | Force | Pressure, ...] = (*case.supports, *case.forces, *case.pressures)
    for each in acting:
        each.region.check_near(shell)


def patient_axes(axes: str, points: NDArray[Any], telling: float = _TELLING) -> Floats:
    """(3,) of 1 and -1, from the axes of a load case to the patient's: x to the left, y to the back, z to the head.

    Medial is to the right of a left femur (-x) and to the left of a right one (+x); anterior is -y.

    Arguments
    ---------
    points: (n, 3) of the body, mm.
    telling: share of the width by which the head must lie off the middle.

    Raises
    ------
    InputError for a femur whose head is neither to the left nor to the right.
    """
    if axes == "patient":
        return np.ones(3)
    if axes == "femur":
        axes = f"{_femur_side(points, telling)} femur"
    return np.array([-1.0 if axes == "left femur" else 1.0, -1.0, 1.0])


def _femur_side(points: NDArray[Any], telling: float) -> str:
    """Side of a proximal femur: its top, the head, lies medial of the middle of its upper third."""
    x, z = points[:, 0].astype(np.float64), points[:, 2]
    height = (z - z.min()) / max(float(np.ptp(z)), 1e-300)
    upper = x[height >= 2 / 3]
    off = float(x[height >= 0.9].mean() - (upper.min() + upper.max()) / 2)
    if abs(off) < telling * width_mm(points):
        raise InputError(
            "expected a femur along z whose head tells its side, got a body whose top lies in the middle: "
            'say axes = "left femur" or "right femur" in the load case'
        )
    return "left" if off < 0 else "right"


def _hold(made: AssembledLoads, support: Support, at_nodes: Surface, at_gauss: Surface, axes: Floats) -> Applied:
    inside = support.region.inside(at_nodes)
    nodes = np.unique(at_nodes.faces[inside])
    held = np.array(support.components)
    made.fixed[np.ix_(nodes, held)] = True
    made.prescribed_mm[np.ix_(nodes, held)] = (np.array(support.displacement_mm) * axes)[held]
    made.gripped[nodes] = True
    area = float(at_gauss.areas_mm2[inside.all(axis=1)].sum())
    centre = at_nodes.mesh.points[nodes].mean(axis=0, dtype=np.float64)
    return Applied("fixed", support.region.name, area, nodes.size, np.zeros(3), centre)


def _push(made: AssembledLoads, load: Force | Pressure, surface: Surface, axes: Floats) -> Applied:
    inside = load.region.inside(surface)
    faces = inside.any(axis=1)
    area = np.where(inside, surface.areas_mm2, 0.0)
    total_mm2 = float(area.sum())
    if isinstance(load, Force):
        on_samples = area[faces][..., None] * (np.array(load.force_n) * axes / total_mm2)
    else:
        assert surface.weights is not None
        weight = -load.pressure_mpa * np.where(inside[faces], surface.weights, 0.0)
        on_samples = surface.normals[faces] * weight[..., None]
    nodes = surface.faces[faces]
    on_nodes = np.einsum("sk,fsc->fkc", surface.shape, on_samples)
    _add(made.forces_n, nodes, on_nodes)
    if isinstance(load, Force):
        made.gripped[nodes] = True
    centre = np.einsum("fs,fsc->c", area, surface.points_mm) / total_mm2
    kind = "force" if isinstance(load, Force) else "pressure"
    pushed = np.abs(on_nodes)
    held = pushed.any() and not ((pushed > ROUNDING * pushed.max()) & ~made.fixed[nodes]).any()
    total = _without_rounding(on_nodes.sum(axis=(0, 1)), float(np.linalg.norm(on_samples, axis=2).sum()))
    return Applied(kind, load.region.name, total_mm2, np.unique(nodes).size, total, centre, bool(held))


def _without_rounding(total_n: Floats, pushed_n: float) -> Floats:
    """Components of a total, 0 where they are what summing leaves of all that pushes, whichever way."""
    return np.where(np.abs(total_n) > ROUNDING * pushed_n, total_n, 0.0)


def _weigh(made: AssembledLoads, acceleration: Floats, mesh: Mesh) -> Applied:
    if "density_g_cm3" not in mesh.fields and "density_g_cm3" not in mesh.cell_fields:
        raise InputError("expected the field density_g_cm3 for gravity, got a mesh without it")
    mass = np.zeros((mesh.n_nodes, 1))
    moment = np.zeros(3)
    for first in range(0, mesh.n_elements, _ELEMENTS):
        elements = np.arange(first, min(first + _ELEMENTS, mesh.n_elements))
        nodes = mesh.cells_of(elements)
        on_nodes, at = _element_mass(mesh, nodes, elements)
        _add(mass, nodes, on_nodes[..., None])
        moment += at
    made.forces_n[...] += mass * acceleration
    total = float(mass.sum())
    return Applied("gravity", "body", 0.0, mesh.n_nodes, total * acceleration, moment / max(total, 1e-300))


def _element_mass(mesh: Mesh, nodes: NDArray[np.int32], elements: NDArray[Any]) -> tuple[Floats, Floats]:
    """Consistent mass (m, k) of elements at their nodes, tonne, and its first moment (3,), tonne mm."""
    element = mesh.element
    points, weights = np.polynomial.legendre.leggauss(element.order + 2)
    grid = np.stack(np.meshgrid(points, points, points, indexing="ij"), axis=-1).reshape(-1, 3)
    weight = np.einsum("i,j,k->ijk", weights, weights, weights).ravel() / 8
    at = (grid + 1) / 2
    x = mesh.points[nodes].astype(np.float64)
    jacobian = np.linalg.det(np.einsum("dgk,mkc->mgdc", element.gradient(at), x, optimize=True))
    shape = element.shape(at)
    if "density_g_cm3" in mesh.fields:
        density = mesh.fields["density_g_cm3"][nodes].astype(np.float64) @ shape.T
    else:
        density = np.tile(mesh.cell_fields["density_g_cm3"][elements, None].astype(np.float64), (1, len(shape)))
    mass = TONNE_MM3 * density * jacobian * weight
    return mass @ shape, np.einsum("mg,gk,mkc->c", mass, shape, x, optimize=True)


def _add(total: Floats, nodes: NDArray[np.int32], values: Floats) -> None:
    """Add values (m, k, c) of elements or faces to those of their nodes (n, c)."""
    for component in range(total.shape[1]):
        total[:, component] += np.bincount(nodes.ravel(), values[..., component].ravel(), minlength=len(total))
