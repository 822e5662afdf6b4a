"""Published benchmarks of elements: NAFEMS LE10, MacNeal and Harder's beams; see ``verification.py``."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from gpubspline.analysis.load_case import LoadCase, Pressure, Support
from gpubspline.analysis.loads import assemble
from gpubspline.analysis.stress import recover
from gpubspline.bench.closed_forms import Floats, Supports, block, on_face, region, solved, supports
from gpubspline.device import Device
from gpubspline.mesh.mesh import Mesh


@dataclass(frozen=True)
class Benchmark:
    """A published figure: its source's value, and what each kind of element finds, by name."""

    problem: str
    quantity: str
    expected: float
    found: dict[str, float]

    def ratio(self, kind: str) -> float:
        """Found over expected."""
        return self.found[kind] / self.expected


LE10_MPA = -5.38
"""Published sigma_yy at D."""
LE10 = ((3, 4, 2), (6, 8, 4), (9, 12, 6))


def le10(cells: Sequence[int], device: Device) -> float:
    """Sigma_yy, MPa, at D of the thick plate under pressure. Source: NAFEMS, The Standard NAFEMS Benchmarks, LE10."""

    def place(at: Floats) -> Floats:
        s, angle = at[:, 0], np.pi / 2 * at[:, 1]
        x, y = (2000 + 1250 * s) * np.cos(angle), (1000 + 1750 * s) * np.sin(angle)
        return np.stack([x, y, 600 * at[:, 2]], axis=1)

    mesh = block("hex20", cells, place, 210_000.0, 0.3)
    case = LoadCase("LE10", (Support(region("v0"), (False, True, False)),), pressures=(Pressure(region("w1"), 1.0),))
    loads, outer = assemble(case, mesh), mesh.node_sets["u1"]
    held = Supports(loads.fixed, loads.prescribed_mm).hold(mesh.node_sets["v1"], 0)
    held.hold(outer, 0).hold(outer, 1).hold(outer[np.abs(mesh.points[outer, 2] - 300) < 1e-6], 2)
    found = solved(mesh, held, loads.forces_n, device=device)
    stress = recover(mesh, found.displacement_mm).stress_mpa
    return float(stress[1, np.argmin(np.linalg.norm(mesh.points - [2000, 0, 600], axis=1))])


def straight(shape: str) -> Mesh:
    """Straight beam of MacNeal and Harder, 6 x 0.2 x 0.1 of 6 elements: regular, trapezoidal or parallelogram."""
    tilt = {"regular": lambda k: 0 * k, "trapezoidal": lambda k: (-1.0) ** k, "parallelogram": lambda k: 1.0 + 0 * k}

    def place(at: Floats) -> Floats:
        line = np.round(6 * at[:, 0])
        inside = (line > 0) & (line < 6)
        leaning = np.where(inside, tilt[shape](line), 0.0) * 0.2 * (at[:, 2] - 0.5)
        return np.stack([6 * at[:, 0] + leaning, 0.1 * at[:, 1], 0.2 * at[:, 2]], axis=1)

    return block("hex8", (6, 1, 1), place, 1e7, 0.3)


def curved() -> Mesh:
    """Curved beam of MacNeal and Harder: a quarter circle, radii 4.12 and 4.32, 0.1 thick, 6 elements."""

    def place(at: Floats) -> Floats:
        angle, r = np.pi / 2 * at[:, 0], 4.12 + 0.2 * at[:, 2]
        return np.stack([r * np.sin(angle), 0.1 * at[:, 1], r * np.cos(angle)], axis=1)

    return block("hex8", (6, 1, 1), place, 1e7, 0.25)


def twisted() -> Mesh:
    """Twisted beam of MacNeal and Harder: 12 x 1.1 x 0.32, a quarter turn, 12 x 2 x 1 elements."""

    def place(at: Floats) -> Floats:
        angle, y, z = np.pi / 2 * at[:, 0], 1.1 * (at[:, 1] - 0.5), 0.32 * (at[:, 2] - 0.5)
        turned = [y * np.cos(angle) - z * np.sin(angle), y * np.sin(angle) + z * np.cos(angle)]
        return np.stack([12 * at[:, 0], *turned], axis=1)

    return block("hex8", (12, 2, 1), place, 29e6, 0.22)


def tip(mesh: Mesh, direction: Sequence[float], device: Device, formulation: str) -> float:
    """Displacement of a beam's free end, u1, along a unit force on it."""
    held, end = supports(mesh), mesh.node_sets["u1"]
    for d in range(3):
        held.hold(mesh.node_sets["u0"], d)
    area = on_face(mesh, "u1", lambda at: np.ones((len(at), 3)))[:, :1]
    forces = area / area.sum() * np.asarray(direction, dtype=np.float64)
    found = solved(mesh, held, forces, device=device, formulation=formulation)
    return float(np.mean(found.displacement_mm[end] @ np.asarray(direction)))


def macneal_harder(device: Device) -> Iterator[Benchmark]:
    """The beams of hex8. Source: MacNeal and Harder 1985, A proposed standard set of problems."""
    loads: list[tuple[str, Mesh, str, tuple[float, ...], float]] = []
    for shape in ("regular", "trapezoidal", "parallelogram"):
        mesh = straight(shape)
        loads.append((f"straight, {shape}", mesh, "extension", (1, 0, 0), 3e-5))
        loads.append((f"straight, {shape}", mesh, "in-plane shear", (0, 0, 1), 0.1081))
        loads.append((f"straight, {shape}", mesh, "out-of-plane shear", (0, 1, 0), 0.4321))
    loads.append(("curved", curved(), "in-plane shear", (1, 0, 0), 0.08734))
    loads.append(("curved", curved(), "out-of-plane shear", (0, 1, 0), 0.5022))
    loads.append(("twisted", twisted(), "in-plane shear", (0, 0, 1), 0.005424))
    loads.append(("twisted", twisted(), "out-of-plane shear", (0, 1, 0), 0.001754))
    for name, mesh, load, direction, expected in loads:
        found = {kind: tip(mesh, direction, device, kind) for kind in ("full", "incompatible", "bbar")}
        yield Benchmark(name, load, expected, found)
