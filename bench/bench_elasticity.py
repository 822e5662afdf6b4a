"""The elasticity solver: its operator, its solves beside CalculiX's, and how both grow.

Floors of the operator, a hex8 of a large mesh, which brings one node of its own. Bytes: place and displacement read
and the force written, 9 numbers of the node, and Lame's moduli at 8 Gauss points, 16 numbers: 100 bytes in float32, 200
in float64. Operations are those of the algorithm that both backends use, sums factorised, of which none is wasted:
derivatives of 6 planes 60 each, at each of 8 Gauss points the cofactors and the determinant 33, the gradient 45, the
stress 18, the tractions 45 and their sums 18, and back to the vertices 64 for each of 3 planes: 1,824. (A stored matrix
of 24 x 24 takes 1,152, but brings 300 numbers of its upper half.) Held against whichever of the two the machine's own
rates make longer. Its rate of arithmetic is that of products and sums that wait for nothing, in its longest vectors and
fused where the processor can, on the same backend; the operator may fuse as well.

Without structure a hex8 reads its 8 nodes' numbers besides: 132 and 232 bytes; operations are the same. Its elements
come in disorder, which the library has to find its way out of.

A hex20 brings 4 nodes of its own and reads 20 nodes' numbers and 2 moduli at 27 Gauss points: 440 bytes in float32, 800
in float64. Sums factorised over the 27 places that its nodes are part of, which the library does not do, 8 passes of 27
sums of 3 take 1,080 for the derivatives of each of 6 planes and as many back for each of 3, and each of 27 Gauss points
takes 141 as above: 13,527. Summed over 20 nodes at each Gauss point, as both backends do, it is 32,967.

CalculiX gets the same mesh, loads and moduli as a deck; its time is that of its process, reading and stress included,
ours that of ``solve``, from a mesh in memory to displacements. Both solve the proximal femur of a child, held at its
cut end, in the stance of the paper, with a modulus that is even in each element and varies 200-fold between them.
CalculiX's displacements are compared with ours before its time counts: 1e-6 of the largest for SPOOLES, 1e-3 for its
iterative solvers, which stop earlier than ours does.
"""

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.analysis.elasticity import Solution, solve
from gpubspline.analysis.loads import AssembledLoads, assemble, load_case
from gpubspline.analysis.stiffness import stiffness
from gpubspline.bench.bench_quality import jittered
from gpubspline.bench.bench_scale import watched
from gpubspline.bench.measure import Place, Row, WrongResult, best_of, check
from gpubspline.bench.recorder import Recorder
from gpubspline.ct.phantom import phantom
from gpubspline.ct.region import region_from_threshold
from gpubspline.device import Device, open_device
from gpubspline.export import write
from gpubspline.material.mapping import apply_material
from gpubspline.mesh.elements import ELEMENTS
from gpubspline.mesh.mesh import Mesh
from gpubspline.mesh.sample import sample
from gpubspline.mesh.structure import has_node, lattice_counts
from gpubspline.spline.fit import fit
from gpubspline.spline.lattice import control_lattice

OPERATOR = {"full": 101, "quick": 61, "tiny": 6}  # nodes a direction
HEX20 = {"full": 31, "quick": 21, "tiny": 3}  # corner nodes a direction
SOLVED = {"full": (21, 21, 69), "quick": (21, 21, 69), "tiny": (5, 5, 9)}
GROWTH = {
    "full": [(15, 15, 52), (31, 31, 112), (66, 66, 238)],
    "quick": [(15, 15, 52), (31, 31, 112)],
    "tiny": [(5, 5, 9)],
}
CONTROL = (11, 18, 34)
"""Of the child's femur in the paper's Fig. 4a."""

BYTES = {"float32": 100, "float64": 200}
OPERATIONS = 1824
CONNECTIVITY_BYTES = 32
HEX20_BYTES = {"float32": 440, "float64": 800}
HEX20_OPERATIONS = 13527
SOLVERS = {
    "CalculiX SPOOLES": ("*STATIC", 1e-6),
    "CalculiX Cholesky": ("*STATIC, SOLVER=ITERATIVE CHOLESKY", 1e-3),
    "CalculiX scaling": ("*STATIC, SOLVER=ITERATIVE SCALING", 1e-3),
}
"""What each of its solvers is asked for by, and how far its displacements may be from ours."""

Floats = NDArray[np.float64]


def operator(place: Place) -> Iterator[Row]:
    """Time the product of the stiffness with a displacement, in both precisions."""
    mesh = _material(jittered(OPERATOR[place.scale]))
    yield from _products(place, mesh, "", BYTES, OPERATIONS)
    read = {precision: moved + CONNECTIVITY_BYTES for precision, moved in BYTES.items()}
    yield from _products(place, without_structure(mesh), " without structure", read, OPERATIONS)
    yield from _products(place, _material(_hex20(HEX20[place.scale])), "", HEX20_BYTES, HEX20_OPERATIONS)


def _products(place: Place, mesh: Mesh, kind: str, moved: dict[str, int], operations: int) -> Iterator[Row]:
    for precision in ("float32", "float64"):
        device = place.device if precision == "float32" else open_device(place.device.name, precision)
        k = stiffness(mesh, device)
        free, out = device.put(np.ones(3 * mesh.n_nodes)), device.empty(3 * mesh.n_nodes)
        u = np.random.default_rng(5).standard_normal((3, mesh.n_nodes))
        recorder = Recorder(place.device if precision == "float32" else device)
        replace(k, device=recorder).apply(device.put(u), free, out)
        forces = np.reshape(recorder.get(out), (3, mesh.n_nodes))
        check("the operator by its formula", forces, nodal_forces(mesh, u), 1e-4)
        seconds = best_of(recorder.replay)
        done = operations / arithmetic(device.name, precision, 1 << 16 if place.scale != "tiny" else 1 << 8)
        size = f"{mesh.n_elements:,} {mesh.element_type}{kind}, {precision}"
        floor = mesh.n_elements * max(moved[precision] / place.triad, done)
        yield Row("elasticity-operator", size, place.device.name, seconds, mesh.n_elements, floor / seconds)


def _hex20(n: int) -> Mesh:
    """n x n x n corner nodes two millimetres apart, each node moved by up to a tenth of that."""
    element = ELEMENTS["hex20"]
    counts = lattice_counts(element, (n, n, n))
    planes = np.indices(counts[::-1]).reshape(3, -1)[::-1]
    moved = planes + np.random.default_rng(3).uniform(-0.2, 0.2, planes.shape)
    return Mesh(moved.T[has_node(element, (n, n, n))], "hex20", structure=(n, n, n))


def without_structure(mesh: Mesh) -> Mesh:
    """Give the mesh with a table of its elements, in disorder."""
    order = np.random.default_rng(6).permutation(mesh.n_elements)
    return replace(mesh, structure=None, connectivity=mesh.cells[order])


def _material(mesh: Mesh) -> Mesh:
    x, y, z = mesh.points.T / np.ptp(mesh.points)
    return mesh.with_fields({"E_MPa": 1000 * (1 + x + y * y), "nu": 0.2 + 0.2 * z})


def nodal_forces(mesh: Mesh, u: Floats, chunk: int = 1 << 14) -> Floats:
    """Forces (3, n), N."""
    found = np.zeros((3, mesh.n_nodes))
    for begin in range(0, mesh.n_elements, chunk):
        elements = np.arange(begin, min(begin + chunk, mesh.n_elements))
        cells = mesh.cells_of(elements).T.ravel()
        for total, forces in zip(found, _forces(mesh, u, elements), strict=True):
            total += np.bincount(cells, forces.ravel(), mesh.n_nodes)
    return found


def _forces(mesh: Mesh, u: Floats, elements: NDArray[Any]) -> Floats:
    """Forces (3, 8, m) of elements on their nodes, by matrices, in float64."""
    cells, (at, weights) = mesh.cells_of(elements), mesh.element.gauss()
    slopes, shape = mesh.element.gradient(at), mesh.element.shape(at)
    tangents = np.einsum("dga,mac->mgdc", slopes, mesh.points[cells].astype(np.float64))
    inverse = np.linalg.inv(tangents)
    gradient = np.einsum("mgcd,dga->mgac", inverse, slopes)
    displaced = np.einsum("mgac,kma->mgkc", gradient, u[:, cells])
    e, nu = (np.einsum("ga,ma->mg", shape, mesh.fields[name][cells]) for name in ("E_MPa", "nu"))
    lam, mu = e * nu / (1 + nu) / (1 - 2 * nu), e / 2 / (1 + nu)
    stress = mu[..., None, None] * (displaced + displaced.swapaxes(2, 3))
    stress += (lam * np.trace(displaced, axis1=2, axis2=3))[..., None, None] * np.eye(3)
    volume = np.linalg.det(tangents) * weights
    return np.asarray(np.einsum("mgkc,mgac,mg->kam", stress, gradient, volume))


@cache
def arithmetic(name: str, precision: str, n: int) -> float:
    """Operations a second of products and sums in registers, on ``n`` elements."""
    device, rounds = open_device(name, precision), 1000
    start = device.put(np.random.default_rng(7).random(n))
    out = device.empty(n)

    def run() -> None:
        device.launch("arithmetic.multiply_add", n, start, 0.5, 0.25, rounds, n, out)
        device.wait()

    run()
    check("multiply_add", device.get(out), np.full(n, 4.0), 1e-3)
    return 16 * rounds * n / best_of(run)


@cache
def femur(nodes: tuple[int, int, int]) -> Mesh:
    """Mesh of a child's femur, with one Poisson's ratio and a carrier of the modulus that a deck's table can follow."""
    device, volume = open_device(), phantom("child-femur").scan()
    control = tuple(min(counts) for counts in zip(CONTROL, nodes, strict=True)) if nodes[0] < 10 else CONTROL
    lattice = control_lattice(volume, region_from_threshold(volume, 100.0), control)
    mesh, _ = apply_material(sample(fit(lattice, device=device).patch, nodes, device=device), device=device)
    modulus = np.asarray(mesh.fields["E_MPa"], dtype=np.float64)
    fields = {"HU": modulus * (2000 / modulus.max()), "E_MPa": modulus, "nu": np.full(mesh.n_nodes, 0.3)}
    return replace(mesh, fields=fields)


def solves(place: Place) -> Iterator[Row]:
    """Solve the femur, beside CalculiX's direct and iterative solvers."""
    mesh = femur(SOLVED[place.scale])
    loads = assemble(load_case("stance"), mesh)
    found = _solve(mesh, loads, place.device)
    seconds = best_of(lambda: _solve(mesh, loads, place.device), warm_up=False, budget=10.0)
    peers: dict[str, float | None] = {}
    for name, (_, tolerance) in SOLVERS.items():
        theirs = calculix(SOLVED[place.scale], name)
        if theirs is not None:
            _compare(name, found.displacement_mm, theirs[1], tolerance)
        peers[name] = theirs[0] if theirs else None
    size = f"{mesh.n_elements:,} hex8, {found.iterations} iterations"
    yield Row("elasticity-solve", size, place.device.name, seconds, mesh.n_elements, peers=peers)


def _solve(mesh: Mesh, loads: AssembledLoads, device: Device) -> Solution:
    return solve(mesh, loads.fixed, loads.forces_n, modulus="element", device=device)


def _compare(name: str, ours: Floats, theirs: Floats, tolerance: float) -> None:
    difference, size = np.abs(ours - theirs).max(), np.abs(theirs).max()
    if not difference <= tolerance * size:
        raise WrongResult(f"expected displacements within {tolerance:g} of {name}'s, got {difference / size:.2g}")


@cache
def calculix(nodes: tuple[int, int, int], solver: str) -> tuple[float, Floats] | None:
    """Seconds and displacements (n, 3), mm, of CalculiX; None where it is not installed."""
    if shutil.which("ccx") is None:
        return None
    mesh = femur(nodes)
    loads = assemble(load_case("stance"), mesh)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write(mesh, folder / "femur.inp", step=step(loads, SOLVERS[solver][0]))
        start = perf_counter()
        run = subprocess.run(
            ["ccx", "-i", "femur"],
            cwd=folder,
            env={**os.environ, "OMP_NUM_THREADS": str(os.cpu_count() or 1)},
            capture_output=True,
            text=True,
        )
        seconds = perf_counter() - start
        if run.returncode or "*ERROR" in run.stdout:
            raise WrongResult(f"expected {solver} to solve the deck, got {run.stdout[-300:]!r}")
        return seconds, displacements((folder / "femur.dat").read_text(), mesh.n_nodes)


def step(loads: AssembledLoads, static: str) -> str:
    """Give a deck's supports and its step; CalculiX reads twenty characters of a number."""
    lines = ["*BOUNDARY", *(f"{node + 1},{c + 1}" for node, c in np.argwhere(loads.fixed)), "*STEP", static, "*CLOAD"]
    lines += [f"{node + 1},{c + 1},{loads.forces_n[node, c]:.12E}" for node, c in np.argwhere(loads.forces_n)]
    return "\n".join([*lines, "*NODE PRINT, NSET=all_nodes", "U", "*END STEP", ""])


def displacements(printed: str, n_nodes: int) -> Floats:
    """Displacements (n, 3) that CalculiX printed."""
    rows = re.findall(r"^\s+(\d+)((?:\s+-?\d\.\d+E[+-]\d+){3})\s*$", printed, re.M)
    found = np.zeros((n_nodes, 3))
    for node, values in rows:
        found[int(node) - 1] = [float(value) for value in values.split()]
    return found


def growth(place: Place) -> Iterator[Row]:
    """Solve ever finer femurs, each in a process of its own, whose memory is watched."""
    for nodes in GROWTH[place.scale]:
        with tempfile.TemporaryDirectory() as folder:
            out = Path(folder) / "solved.json"
            counts = ",".join(map(str, nodes))
            module = [sys.executable, "-m", "gpubspline.bench.bench_elasticity"]
            _, peak = watched([*module, place.device.name, counts, str(out)])
            found = json.loads(out.read_text())
        size = f"{found['elements']:,} hex8, {found['iterations']} iterations"
        row = Row("elasticity-growth", size, place.device.name, found["seconds"], found["elements"], peak_bytes=peak)
        yield row


def _main(name: str, counts: str, path: str) -> None:
    """Solve one femur of ``growth``; what a process compiles first is left out of its time."""
    device = open_device(name)
    small = femur((5, 5, 9))
    _solve(small, assemble(load_case("stance"), small), device)
    n_u, n_v, n_w = (int(count) for count in counts.split(","))
    mesh = femur((n_u, n_v, n_w))
    loads = assemble(load_case("stance"), mesh)
    start = perf_counter()
    found = _solve(mesh, loads, device)
    seconds = perf_counter() - start
    balance = np.abs((found.reactions_n + loads.forces_n).sum(axis=0)).max()
    if not balance < 1e-5 * np.abs(loads.forces_n).sum():
        raise WrongResult(f"expected reactions that balance the loads, got {balance:.2g} N more")
    figures = {"elements": mesh.n_elements, "iterations": found.iterations, "seconds": seconds}
    Path(path).write_text(json.dumps(figures))


if __name__ == "__main__":
    _main(*sys.argv[1:])
