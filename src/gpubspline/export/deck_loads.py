"""A load case as a deck carries it: the regions it acts on as sets, and what acts on them.

Forces are consistent nodal forces, those of the project's own solver. A pressure on whole faces and gravity are given
as such too, for solvers that have cards for them; a pressure whose region cuts through faces is nodal forces only.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gpubspline.analysis.load_case import Force, LoadCase, Pressure
from gpubspline.analysis.loads import assemble, patient_axes
from gpubspline.analysis.regions import Region, surfaces
from gpubspline.errors import InputError
from gpubspline.mesh.mesh import Mesh

Floats = NDArray[np.float64]

NO_FORCE = 1e-9
"""Of all forces' sizes together: a sum of less is what they lose in rounding."""


@dataclass(frozen=True, eq=False)
class Faces:
    """Faces of elements.

    Attributes
    ----------
    elements: (f,) element numbers.
    sides: (f,) places in ``element.sides``, which name ``u0`` to ``w1``.
    nodes: (f, k) node numbers, outward, in VTK's order.
    """

    elements: NDArray[np.int64]
    sides: NDArray[np.int64]
    nodes: NDArray[np.int32]

    def only(self, wanted: NDArray[np.bool_] | slice) -> "Faces":
        """Those that are wanted, (f,) or a range."""
        return Faces(self.elements[wanted], self.sides[wanted], self.nodes[wanted])


@dataclass(frozen=True, eq=False)
class DeckLoads:
    """What holds and what moves a body, in mm, N, MPa or the units of a deck.

    Attributes
    ----------
    title: of the load case.
    fixed: (n, 3) bool, which components are held.
    prescribed: (n, 3) where.
    forces: (n, 3) nodal forces, N, of all but ``pressures`` and ``gravity``.
    all_forces: (n, 3) nodal forces, N, of all loads.
    pressures: name of a surface, and the pressure on it, into the body where positive.
    gravity: (3,) acceleration, or None.
    """

    title: str
    fixed: NDArray[np.bool_]
    prescribed: Floats
    forces: Floats
    all_forces: Floats
    pressures: tuple[tuple[str, float], ...] = ()
    gravity: Floats | None = None

    @property
    def total_n(self) -> Floats:
        """(3,) sum of the nodal forces of all loads, N."""
        total = self.all_forces.sum(axis=0)
        return np.where(np.abs(total) > NO_FORCE * np.abs(self.all_forces).sum(), total, 0.0)

    def supports(self) -> Iterator[tuple[NDArray[np.int64], NDArray[np.bool_], Floats]]:
        """Nodes (k,) held alike: which components (3,), and where (3,)."""
        held = np.flatnonzero(self.fixed.any(axis=1))
        keys = np.column_stack([self.fixed[held], self.prescribed[held]])
        alike, which = np.unique(keys, axis=0, return_inverse=True)
        for number, key in enumerate(alike):
            yield held[which.ravel() == number], key[:3].astype(np.bool_), key[3:]

    def held(self, component: int) -> tuple[NDArray[np.int64], Floats]:
        """Nodes (k,) held along an axis, and where (k,)."""
        nodes = np.flatnonzero(self.fixed[:, component])
        return nodes, self.prescribed[nodes, component]

    def forced(self, everything: bool = False) -> tuple[NDArray[np.int64], Floats]:
        """Nodes (k,) that carry a force, and the forces (k, 3); of all loads where ``everything``."""
        forces = self.all_forces if everything else self.forces
        nodes = np.flatnonzero(forces.any(axis=1))
        return nodes, forces[nodes]


@dataclass(frozen=True, eq=False)
class Placed:
    """A load case on a mesh, or none: the loads, and its regions as node sets and surfaces by name."""

    loads: DeckLoads | None
    node_sets: dict[str, NDArray[np.int64]]
    surfaces: dict[str, Faces]


def outer_faces(mesh: Mesh) -> Faces:
    """Faces of the boundary of hexes."""
    elements, sides = mesh.boundary_places()
    return Faces(elements, sides, mesh.faces(elements, sides))


def place_loads(case: LoadCase, mesh: Mesh) -> Placed:
    """Put a load case on a mesh of hexes.

    Raises
    ------
    InputError where it does not fit; see ``analysis.loads.assemble``.
    """
    if mesh.element.dimension != 3:
        raise InputError(f"expected hexes to load, got {mesh.element_type}")
    axes = patient_axes(case.axes, mesh.points)
    at_gauss, at_nodes = surfaces(mesh, axes)
    outer = outer_faces(mesh)
    regions: dict[str, tuple[NDArray[np.int64], Faces]] = {}

    def keep(region: Region, nodes: NDArray[np.int32], faces: Faces) -> None:
        regions.setdefault(region.name, (np.unique(nodes).astype(np.int64), faces))

    whole = []
    pushes: tuple[Force | Pressure, ...] = (*case.forces, *case.pressures)
    for load in pushes:
        inside = load.region.inside(at_gauss)
        touched = outer.only(np.asarray(inside.any(axis=1)))
        keep(load.region, touched.nodes, touched)
        whole.append(bool((inside.all(axis=1) == inside.any(axis=1)).all()))
    for support in case.supports:
        inside = support.region.inside(at_nodes)
        keep(support.region, outer.nodes[inside], outer.only(np.asarray(inside.all(axis=1))))
    pressed = [load for load, is_whole in zip(case.pressures, whole[len(case.forces) :], strict=True) if is_whole]
    loads = _loads(case, mesh, [(load.region.name, load.pressure_mpa) for load in pressed], axes)
    node_sets = {name: nodes for name, (nodes, _) in regions.items()}
    return Placed(loads, node_sets, {name: faces for name, (_, faces) in regions.items() if faces.elements.size})


def _loads(case: LoadCase, mesh: Mesh, pressures: list[tuple[str, float]], axes: Floats) -> DeckLoads:
    everything = assemble(case, mesh)
    everything.warn_of_held()
    left = tuple(load for load in case.pressures if (load.region.name, load.pressure_mpa) not in pressures)
    moved = any(any(support.displacement_mm) for support in case.supports)
    forces = np.zeros_like(everything.forces_n)
    if left == case.pressures and case.gravity_mm_s2 is None:
        forces = everything.forces_n
    elif case.forces or left or moved:  # a load case of supports alone is none
        forces = assemble(replace(case, pressures=left, gravity_mm_s2=None), mesh).forces_n
    gravity = None if case.gravity_mm_s2 is None else np.array(case.gravity_mm_s2) * axes
    return DeckLoads(
        case.title or case.name,
        everything.fixed,
        everything.prescribed_mm,
        forces,
        everything.forces_n,
        tuple(pressures),
        gravity,
    )
