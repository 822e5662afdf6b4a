"""Problems of elasticity with closed forms, and the error of finer and finer meshes; see ``verification.py``.

Lengths are mm, moduli MPa, forces N, or any other units that fit together.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.analysis.elasticity import Solution, solve
from gpubspline.analysis.load_case import LoadCase, Pressure, Support
from gpubspline.analysis.loads import assemble
from gpubspline.analysis.regions import Region, Side
from gpubspline.device import Device
from gpubspline.mesh import structure
from gpubspline.mesh.elements import ELEMENTS
from gpubspline.mesh.mesh import Mesh

Floats = NDArray[np.float64]
Place = Callable[[Floats], Floats]
"""From parameters (n, 3) in 0..1 to places."""

EXACT = 1e-7
"""An error that is none: as small as the solve leaves it."""


@dataclass(frozen=True)
class Study:
    """Errors of finer and finer meshes.

    Attributes
    ----------
    problem: what is solved; error: of what, relative.
    element: its type and how it is taken.
    order: at which theory says the error falls.
    cells: elements along one side; errors: of each.
    """

    problem: str
    error: str
    element: str
    order: float
    cells: tuple[int, ...]
    errors: tuple[float, ...]

    @property
    def observed(self) -> float:
        """Order between the two finest meshes."""
        return float(np.log(self.errors[-2] / self.errors[-1]) / np.log(self.cells[-1] / self.cells[-2]))


def block(
    element_type: str, cells: Sequence[int], place: Place, modulus: float | Place = 1000.0, nu: float = 0.0
) -> Mesh:
    """Mesh of a block of elements, its modulus a number or a function of the place (n, 3); node sets are its sides."""
    element, counts = ELEMENTS[element_type], tuple(n + 1 for n in cells)
    axes = [np.linspace(0, 1, n) for n in structure.lattice_counts(element, counts)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3, order="F")
    kept = structure.has_node(element, counts)
    points = place(grid if kept is None else grid[kept])
    values = modulus(points) if callable(modulus) else np.full(len(points), modulus)
    mesh = Mesh(points, element_type, structure=counts, fields={"E_MPa": values, "nu": np.full(len(points), nu)})
    return replace(mesh, node_sets={side: np.unique(mesh.boundary(side)) for side in mesh.element.sides})


def brick(sizes: Sequence[float], low: Sequence[float] = (0.0, 0.0, 0.0)) -> Place:
    """Place of a brick's parameters."""
    return lambda at: np.asarray(at * sizes + low)


@dataclass(frozen=True, eq=False)
class Supports:
    """Held directions (n, 3) of nodes and where they are moved to."""

    fixed: NDArray[np.bool_]
    moved: Floats

    def hold(self, nodes: NDArray[Any], direction: int, values: Any = 0.0) -> "Supports":
        """Hold a direction of some nodes."""
        self.fixed[nodes, direction] = True
        self.moved[nodes, direction] = values
        return self


def supports(mesh: Mesh) -> Supports:
    """Hold nothing yet."""
    return Supports(np.zeros((mesh.n_nodes, 3), dtype=bool), np.zeros((mesh.n_nodes, 3)))


def solved(mesh: Mesh, held: Supports, forces: Floats | None = None, **how: Any) -> Solution:
    """Solve to 1e-8: rounding leaves the slender beams little less."""
    loads = np.zeros((mesh.n_nodes, 3)) if forces is None else forces
    return solve(mesh, held.fixed, loads, prescribed_mm=held.moved, tolerance=1e-8, **how)


def l2_error(mesh: Mesh, displacement: Floats, exact: Place) -> float:
    """Relative error of a displacement (n, 3) by 4 Gauss points a parameter."""
    points, weights = np.polynomial.legendre.leggauss(4)
    at = np.stack(np.meshgrid(points, points, points, indexing="ij"), axis=-1).reshape(-1, 3) / 2 + 0.5
    weight = np.einsum("i,j,k->ijk", weights, weights, weights).ravel()
    shape, slopes = mesh.element.shape(at), mesh.element.gradient(at)
    nodes = mesh.points[mesh.cells].astype(np.float64)
    volume = np.linalg.det(np.einsum("dga,mac->mgdc", slopes, nodes)) * weight
    expected = exact((shape @ nodes).reshape(-1, 3)).reshape(*volume.shape, 3)
    difference = shape @ displacement[mesh.cells] - expected
    squares = [np.sum(values**2 * volume[..., None]) for values in (difference, expected)]
    return float(np.sqrt(squares[0] / squares[1]))


def on_face(mesh: Mesh, side: str, traction: Place) -> Floats:
    """Consistent forces (n, 3) of a traction, a function of the place (n, 3), on a plane side."""
    face, nodes = ELEMENTS[mesh.element.side_name], mesh.boundary(side)
    points, weights = np.polynomial.legendre.leggauss(4)
    at = np.stack(np.meshgrid(points, points, indexing="ij"), axis=-1).reshape(-1, 2) / 2 + 0.5
    shape, slopes = face.shape(at), face.gradient(at)
    x = mesh.points[nodes].astype(np.float64)
    along = np.einsum("dga,mac->mgdc", slopes, x)
    area = (
        np.linalg.norm(np.cross(along[..., 0, :], along[..., 1, :]), axis=-1) * np.outer(weights, weights).ravel() / 4
    )
    pushed = traction((shape @ x).reshape(-1, 3)).reshape(*area.shape, 3)
    forces = np.zeros((mesh.n_nodes, 3))
    np.add.at(forces, nodes, np.einsum("ga,mgc,mg->mac", shape, pushed, area))
    return forces


def cantilever(element_type: str, n: int, device: Device, formulation: str = "full") -> float:
    """Error of a cantilever of 4 x 1 x 1 under an end shear P, nu = 0. Source: Timoshenko and Goodier, art. 21."""
    length, c, modulus, load = 4.0, 0.5, 1000.0, 1.0
    mesh, inertia = block(element_type, (4 * n, 1, n), brick((length, 1, 1), (0, 0, -c)), modulus), 1 / 12

    def exact(at: Floats) -> Floats:
        x, z = at[:, 0], at[:, 2]
        along = -load * z / (6 * modulus * inertia) * ((6 * length - 3 * x) * x + 2 * (z**2 - c**2))
        across = load / (6 * modulus * inertia) * (4 * c**2 * x + (3 * length - x) * x**2)
        return np.stack([along, 0 * x, across], axis=1)

    def shear(at: Floats) -> Floats:
        return np.outer(load / (2 * inertia) * (c**2 - at[:, 2] ** 2), [0, 0, 1])

    held, nodes = supports(mesh), mesh.node_sets["u0"]
    for direction in range(3):
        held.hold(nodes, direction, exact(mesh.points[nodes])[:, direction])
    found = solved(mesh, held, on_face(mesh, "u1", shear), device=device, formulation=formulation)
    return l2_error(mesh, found.displacement_mm, exact)


def torsion(element_type: str, n: int, device: Device, formulation: str = "full") -> float:
    """Error of the torque of a prism of square section, free to warp. Source: Timoshenko and Goodier, art. 109."""
    twist, nu = 0.01, 0.3
    mesh = block(element_type, (n, n, 1), brick((1, 1, 1), (-0.5, -0.5, 0)), 1000.0, nu)
    held, (x, y, _) = supports(mesh), mesh.points.T
    for side, angle in (("w0", 0.0), ("w1", twist)):
        nodes = mesh.node_sets[side]
        held.hold(nodes, 0, -angle * y[nodes]).hold(nodes, 1, angle * x[nodes])
    held.hold(np.flatnonzero(np.linalg.norm(mesh.points - [-0.5, -0.5, 0], axis=1) < 1e-9), 2)
    found = solved(mesh, held, device=device, formulation=formulation)
    nodes, forces = mesh.node_sets["w1"], found.reactions_n
    torque = float(np.sum(x[nodes] * forces[nodes, 1] - y[nodes] * forces[nodes, 0]))
    odd = np.arange(1, 60, 2)
    constant = 1 / 3 - 64 / np.pi**5 * np.sum(np.tanh(odd * np.pi / 2) / odd**5.0)
    return float(abs(torque / (1000.0 / 2 / (1 + nu) * twist * constant) - 1))


def cylinder(element_type: str, n: int, device: Device, formulation: str = "full") -> float:
    """Error of a thick cylinder under inner pressure, plane strain. Source: Lame; Timoshenko and Goodier, art. 28."""
    a, b, modulus, nu, pressure = 1.0, 2.0, 1000.0, 0.3, 10.0

    def place(at: Floats) -> Floats:
        r, angle = a + (b - a) * at[:, 0], np.pi / 2 * at[:, 1]
        return np.stack([r * np.cos(angle), r * np.sin(angle), 0.2 * at[:, 2]], axis=1)

    def exact(at: Floats) -> Floats:
        r2 = at[:, :1] ** 2 + at[:, 1:2] ** 2
        grown = (1 + nu) * pressure * a**2 / (modulus * (b**2 - a**2)) * ((1 - 2 * nu) + b**2 / r2)
        return np.asarray(grown * at * [1, 1, 0])

    mesh = block(element_type, (n, 2 * n, 1), place, modulus, nu)
    planes = [Support(region(name), (axis == "x", axis == "y", axis == "z")) for name, axis in _SYMMETRY]
    case = LoadCase("cylinder", tuple(planes), pressures=(Pressure(region("u0"), pressure),))
    loads = assemble(case, mesh)
    held = Supports(loads.fixed, loads.prescribed_mm)
    found = solved(mesh, held, loads.forces_n, device=device, formulation=formulation)
    return l2_error(mesh, found.displacement_mm, exact)


_SYMMETRY = (("v0", "y"), ("v1", "x"), ("w0", "z"), ("w1", "z"))
"""Sides of the quarter cylinder and the direction that each holds."""


def region(name: str) -> Region:
    return Region(name, (Side(name),))


GRADED: dict[str, Place] = {"linear": lambda t: 100 * (1 + 6 * t), "exponential": lambda t: 100.0 * 7.0**t}
"""Moduli from 100 to 700 along t in 0..1."""


def graded_bar(grading: str, element_type: str, n: int, device: Device, modulus: str) -> float:
    """Error of the force that pulls a bar whose modulus grows along it: F / A = u / integral of 1 / E."""
    law = GRADED[grading]
    mesh = block(element_type, (n, 1, 1), brick((12, 2, 2)), lambda at: law(at[:, 0] / 12))
    held = supports(mesh).hold(mesh.node_sets["u0"], 0).hold(mesh.node_sets["u1"], 0, 0.1)
    held.hold(mesh.node_sets["v0"], 1).hold(mesh.node_sets["w0"], 2)
    found = solved(mesh, held, device=device, modulus=modulus)
    force = float(found.reactions_n[mesh.node_sets["u1"], 0].sum())
    flexibility = {"linear": 12 * np.log(7) / 600, "exponential": 12 * (1 - 1 / 7) / np.log(7) / 100}[grading]
    return float(abs(force / (4 * 0.1 / flexibility) - 1))


def graded_beam(grading: str, element_type: str, n: int, device: Device, modulus: str) -> float:
    """Error of the moment that bends a beam whose modulus grows across its height: M = k integral of E (z - z0)^2."""
    law, curvature = GRADED[grading], 1e-3
    t, weights = np.polynomial.legendre.leggauss(40)
    z, weights = t / 2 + 0.5, weights / 2
    neutral = float(np.sum(weights * law(z) * z) / np.sum(weights * law(z)))
    expected = curvature * float(np.sum(weights * law(z) * (z - neutral) ** 2))
    mesh = block(element_type, (2, 1, n), brick((2, 1, 1)), lambda at: law(at[:, 2]))
    end, height = mesh.node_sets["u1"], mesh.points[:, 2]
    held = supports(mesh).hold(mesh.node_sets["u0"], 0).hold(end, 0, 2 * curvature * (height[end] - neutral))
    held.hold(mesh.node_sets["v0"], 1).hold(np.flatnonzero((mesh.points[:, 0] == 0) & (height == 0)), 2)
    formulation = "incompatible" if element_type == "hex8" else "full"
    found = solved(mesh, held, device=device, modulus=modulus, formulation=formulation)
    moment = float(np.sum(found.reactions_n[end, 0] * height[end]))
    return abs(moment / expected - 1)


def studies(device: Device) -> Iterator[Study]:
    """Convergence to the closed forms."""
    problems: list[tuple[str, Callable[..., float], str, dict[str, tuple[int, ...]], dict[str, float]]] = [
        (
            "cantilever",
            cantilever,
            "displacement, L2",
            {"hex8": (2, 4, 8), "hex20": (1, 2, 4)},
            {"hex8": 2, "hex20": 3},
        ),
        ("torsion of a prism", torsion, "torque", {"hex8": (4, 8, 16), "hex20": (2, 4, 8)}, {"hex8": 2, "hex20": 4}),
        (
            "thick cylinder",
            cylinder,
            "displacement, L2",
            {"hex8": (4, 8, 16), "hex20": (2, 4, 8)},
            {"hex8": 2, "hex20": 3},
        ),
    ]
    for name, problem, error, cells, order in problems:
        for element_type, formulation in (("hex8", "full"), ("hex8", "incompatible"), ("hex20", "full")):
            run = partial(problem, element_type, device=device, formulation=formulation)
            errors = tuple(run(n=n) for n in cells[element_type])
            kind = element_type if formulation == "full" else f"{element_type} {formulation}"
            yield Study(name, error, kind, order[element_type], cells[element_type], errors)


def gradings(device: Device) -> Iterator[Study]:
    """Graded elements beside constant ones."""
    for name, problem, error in (("bar", graded_bar, "force"), ("beam", graded_beam, "moment")):
        for grading in GRADED:
            for element_type in ("hex8", "hex20"):
                for modulus in ("element", "graded"):
                    cells = (2, 4, 8)
                    errors = tuple(problem(grading, element_type, n, device, modulus) for n in cells)
                    order = 4.0 if (element_type, modulus) == ("hex20", "graded") else 2.0
                    kind = f"{element_type} {'graded' if modulus == 'graded' else 'constant'}"
                    where = "along its length" if name == "bar" else "across its height"
                    yield Study(f"{name}, {grading} {where}", error, kind, order, cells, errors)
