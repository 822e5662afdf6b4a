"""Displacements: patch tests, rigid motions, closed forms, then scikit-fem and CalculiX on the same mesh."""

import re
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest

from gpubspline.analysis.elasticity import solve
from gpubspline.analysis.stiffness import numbers_of, stiffness
from gpubspline.analysis.transfer import spacing_of
from gpubspline.errors import InputError, SolveError
from gpubspline.material.orthotropy import with_orthotropy
from gpubspline.mesh import structure
from gpubspline.mesh.elements import ELEMENTS
from gpubspline.mesh.mesh import Mesh

FORMS = [("hex8", "full"), ("hex8", "incompatible"), ("hex8", "bbar"), ("hex20", "full"), ("hex27", "full")]
E, NU = 1000.0, 0.3


def parameters(element_type, counts):
    """Parameters (n, 3) in 0..1 of the nodes of a structured mesh."""
    element = ELEMENTS[element_type]
    axes = [np.linspace(0, 1, n) for n in structure.lattice_counts(element, counts)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3, order="F")
    kept = structure.has_node(element, counts)
    return grid if kept is None else grid[kept]


def box(element_type, counts, sizes_mm=(1.0, 1.0, 1.0), jitter=0.0, modulus=None):
    """A box of nodes, those inside moved by up to ``jitter``; the modulus a function of the place (n, 3)."""
    at = parameters(element_type, counts)
    points = at * sizes_mm
    inside = np.all((at > 1e-9) & (at < 1 - 1e-9), axis=1)
    points += inside[:, None] * np.random.default_rng(0).uniform(-jitter, jitter, points.shape)
    values = np.full(len(points), E) if modulus is None else modulus(points)
    mesh = Mesh(points, element_type, structure=counts, fields={"E_MPa": values, "nu": np.full(len(points), NU)})
    return replace(mesh, node_sets={side: np.unique(mesh.boundary(side)) for side in mesh.element.sides})


def explicit(mesh):
    return replace(mesh, structure=None, connectivity=mesh.cells)


def graded(x):
    return E * (1 + x[:, 0] + 3 * x[:, 2] ** 2 + 0.5 * np.sin(4 * x[:, 1]))


def held(mesh, side, directions=(0, 1, 2)):
    fixed = np.zeros((mesh.n_nodes, 3), dtype=bool)
    for direction in directions:
        fixed[mesh.node_sets[side], direction] = True
    return fixed


@pytest.mark.parametrize("table", [False, True], ids=["structured", "explicit"])
@pytest.mark.parametrize(("element_type", "formulation"), FORMS)
def test_patch_of_distorted_elements_is_exact(element_type, formulation, table, device64):
    """A linear displacement on the boundary goes on inside, 1e-10; its energy is that of the constant strain."""
    mesh = box(element_type, (4, 3, 4), jitter=0.04)
    gradient = np.random.default_rng(1).normal(size=(3, 3)) * 0.01
    expected = mesh.points @ gradient.T
    at = parameters(element_type, (4, 3, 4))
    fixed = np.repeat(np.any((at < 1e-9) | (at > 1 - 1e-9), axis=1)[:, None], 3, axis=1)
    assert not fixed.all()
    mesh = explicit(mesh) if table else mesh
    nothing = np.zeros((mesh.n_nodes, 3))
    how = {"formulation": formulation, "tolerance": 1e-13, "device": device64}
    solution = solve(mesh, fixed, nothing, prescribed_mm=expected, **how)
    assert np.abs(solution.displacement_mm - expected).max() < 1e-10 * np.abs(expected).max()
    strain = (gradient + gradient.T) / 2
    energy = E * NU / (1 + NU) / (1 - 2 * NU) * np.trace(strain) ** 2 / 2 + E / 2 / (1 + NU) * np.sum(strain**2)
    assert solution.strain_energy_nmm == pytest.approx(energy, rel=1e-10)


@pytest.mark.parametrize(("element_type", "formulation"), FORMS)
def test_rigid_motions_cost_no_force(element_type, formulation, any_device):
    """Six motions of a graded, distorted mesh: 1e-12 of the forces of a strain as large, 1e-5 in float32."""
    mesh = box(element_type, (4, 3, 4), jitter=0.04, modulus=graded)
    k = stiffness(mesh, any_device, formulation=formulation)
    x, y, z = mesh.points.T - 0.5
    none, one = 0 * x, 1 + 0 * x
    motions = [(one, none, none), (none, one, none), (none, none, one), (none, -z, y), (z, none, -x), (-y, x, none)]
    free, out = any_device.put(np.ones(3 * mesh.n_nodes)), any_device.empty(3 * mesh.n_nodes)

    def force(motion):
        k.apply(any_device.put(np.concatenate(motion)), free, out)
        return np.abs(any_device.get(out)).max()

    size = force((x, none, none))
    tolerance = 1e-12 if any_device.real == np.float64 else 1e-5
    assert all(force(motion) < tolerance * size for motion in motions)


class OneByOne:
    """A device that says it is a GPU, so that work is cut up as for one."""

    def __init__(self, device):
        self._device, self.cores = device, 0

    def __getattr__(self, name):
        return getattr(self._device, name)


@pytest.mark.parametrize("gpu", [False, True], ids=["cpu", "gpu"])
@pytest.mark.parametrize("counts", [(2, 2, 2), (4, 3, 4), (12, 4, 3), (42, 3, 4), (19, 10, 18), (3, 17, 9)])
def test_a_table_of_elements_changes_no_force(counts, gpu, any_device):
    """Rows shorter and longer than a vector, one brick and several: forces as with connectivity, 0 where held."""
    mesh = box("hex8", counts, jitter=0.2 / max(counts), modulus=graded)
    rng = np.random.default_rng(3)
    u, held_back = rng.normal(size=(3, mesh.n_nodes)), rng.random((3, mesh.n_nodes)) < 0.2
    free, out = any_device.put(np.where(held_back, 0.0, 1.0)), any_device.empty(3 * mesh.n_nodes)
    found = []
    for each in (mesh, explicit(mesh)):
        k = stiffness(each, OneByOne(any_device) if gpu else any_device)
        assert (k.structure is None) == (each.structure is None)
        for _ in range(2):  # what is left of the first time must not count
            k.apply(any_device.put(u), free, out)
        found.append(np.reshape(any_device.get(out), (3, -1)).copy())
    assert np.abs(found[1]).max() > 1 and not found[0][held_back].any()
    tolerance = 4 * np.finfo(any_device.real).eps
    assert np.abs(found[0] - found[1]).max() < tolerance * np.abs(found[1]).max()


@pytest.mark.parametrize(("element_type", "formulation"), FORMS)
def test_the_stiffness_is_symmetric(element_type, formulation, device64):
    """v K u = u K v for any two displacements, 1e-12."""
    mesh = box(element_type, (3, 4, 3), jitter=0.05, modulus=graded)
    k = stiffness(mesh, device64, formulation=formulation)
    free, out = device64.put(np.ones(3 * mesh.n_nodes)), device64.empty(3 * mesh.n_nodes)
    u, v = np.random.default_rng(2).normal(size=(2, 3 * mesh.n_nodes))
    products = []
    for a, b in ((u, v), (v, u)):
        k.apply(device64.put(a), free, out)
        products.append(float(b @ device64.get(out)))
    assert products[0] == pytest.approx(products[1], rel=1e-11)


@pytest.mark.parametrize("modulus", ["graded", "element"])
@pytest.mark.parametrize("element_type", ["hex8", "hex20"])
def test_a_bar_graded_along_its_length(element_type, modulus, device64):
    """Strain F / (E(z) A), E linear: F = A u E' / ln(E1 / E0), approached at the order of the element or faster."""
    errors = []
    for n in (5, 9):
        mesh = box(element_type, (2, 2, n), (2.0, 2.0, 12.0), modulus=lambda x: 100.0 + 50.0 * x[:, 2])
        mesh = mesh.with_fields({"nu": np.zeros(mesh.n_nodes)})
        fixed = held(mesh, "u0", [0]) | held(mesh, "v0", [1]) | held(mesh, "w0", [2]) | held(mesh, "w1", [2])
        moved = np.zeros((mesh.n_nodes, 3))
        moved[mesh.node_sets["w1"], 2] = 0.1
        solution = solve(mesh, fixed, 0 * moved, prescribed_mm=moved, modulus=modulus, device=device64)
        force = solution.reactions_n[mesh.node_sets["w1"], 2].sum()
        errors.append(abs(force / (4 * 0.1 * 50 / np.log(700 / 100)) - 1))
    order = np.log2(errors[0] / errors[1])
    assert order > (3 if element_type == "hex20" and modulus == "graded" else 1.5)
    assert errors[1] < 0.02


def test_incompatible_modes_bend_freely(device64):
    """A cantilever one element thick, 10 times as long as thick: F l^3 / 3 E I + shear, 1 %; full integration locks."""
    mesh = box("hex8", (11, 2, 2), (10.0, 1.0, 1.0))
    mesh = mesh.with_fields({"nu": np.zeros(mesh.n_nodes)})
    forces = np.zeros((mesh.n_nodes, 3))
    forces[mesh.node_sets["u1"], 2] = 0.25
    tips = []
    for formulation in ("full", "incompatible"):
        solution = solve(mesh, held(mesh, "u0"), forces, formulation=formulation, device=device64)
        tips.append(solution.displacement_mm[mesh.node_sets["u1"], 2].mean())
    expected = 10.0**3 / (3 * E / 12) + 1.2 * 10 / (E / 2)
    assert tips[1] == pytest.approx(expected, rel=0.01)
    assert tips[0] < 0.75 * expected


def test_mean_dilatation_does_not_lock_when_nearly_incompressible(device64):
    """A plane-strain bend at nu = 0.4999: full integration is several times as stiff as the mean dilatation."""
    mesh = box("hex8", (9, 2, 9), (4.0, 0.5, 4.0))
    mesh = mesh.with_fields({"nu": np.full(mesh.n_nodes, 0.4999)})
    fixed = held(mesh, "w0") | held(mesh, "v0", [1]) | held(mesh, "v1", [1])
    forces = np.zeros((mesh.n_nodes, 3))
    forces[mesh.node_sets["w1"], 0] = 1.0
    tips = [
        solve(mesh, fixed, forces, formulation=name, device=device64).displacement_mm[:, 0].max()
        for name in ("full", "bbar")
    ]
    assert tips[1] > 1.3 * tips[0]


@pytest.mark.parametrize("element_type", ["hex8", "hex20"])
def test_reactions_balance_the_loads(element_type, device):
    """Of a solve on a device of float32: forces and moments, 1e-6."""
    mesh = box(element_type, (4, 5, 6), (2.0, 3.0, 4.0), jitter=0.1, modulus=graded)
    forces = np.zeros((mesh.n_nodes, 3))
    forces[mesh.node_sets["w1"]] = np.random.default_rng(3).normal(size=(len(mesh.node_sets["w1"]), 3))
    solution = solve(mesh, held(mesh, "w0"), forces, device=device)
    assert solution.residual < 1e-8
    total = solution.reactions_n + forces
    np.testing.assert_allclose(total.sum(axis=0), 0, atol=1e-6 * np.abs(forces).sum())
    np.testing.assert_allclose(np.cross(mesh.points, total).sum(axis=0), 0, atol=1e-5 * np.abs(forces).sum())
    assert solution.strain_energy_nmm == pytest.approx(np.sum(forces * solution.displacement_mm) / 2, rel=1e-6)


def reference_displacement(mesh, fixed, forces):
    """The same system by scikit-fem, solved directly."""
    skfem = pytest.importorskip("skfem")
    from scipy.spatial import cKDTree
    from skfem.helpers import ddot, eye, sym_grad, trace
    from skfem.io.meshio import from_meshio

    corners = Mesh(mesh.points, "hex8", connectivity=mesh.cells[:, :8])
    used, numbers = np.unique(corners.cells, return_inverse=True)
    corners = Mesh(mesh.points[used], "hex8", connectivity=numbers.reshape(-1, 8))
    grid = from_meshio(corners.to_meshio())
    kind = {"hex8": skfem.ElementHex1, "hex20": skfem.ElementHexS2}[mesh.element_type]()
    basis = skfem.Basis(grid, skfem.ElementVector(kind), intorder=2 * mesh.element.order + 1)
    scalar = basis.with_element(kind)
    away, node = cKDTree(mesh.points).query(scalar.doflocs.T)
    assert away.max() < 1e-9

    @skfem.BilinearForm
    def form(u, v, w):
        strain = sym_grad(u)
        lam = w["e"] * w["nu"] / (1 + w["nu"]) / (1 - 2 * w["nu"])
        return ddot(lam * eye(trace(strain), 3) + w["e"] / (1 + w["nu"]) * strain, sym_grad(v))

    fields = {name: scalar.interpolate(mesh.fields[of][node]) for name, of in (("e", "E_MPa"), ("nu", "nu"))}
    away, node = cKDTree(mesh.points).query(basis.doflocs.T)
    direction = np.empty(basis.N, dtype=int)
    for dofs in (basis.nodal_dofs, basis.edge_dofs[: 3 * (mesh.element.order - 1)]):
        direction[dofs.ravel()] = np.repeat(np.arange(dofs.shape[0]) % 3, dofs.shape[1])
    system = skfem.condense(
        form.assemble(basis, **fields), forces[node, direction], D=fixed[node, direction].nonzero()[0]
    )
    found = np.zeros((mesh.n_nodes, 3))
    found[node, direction] = skfem.solve(*system)
    return found


@pytest.mark.parametrize("element_type", ["hex8", "hex20"])
def test_agrees_with_scikit_fem(element_type, device64):
    """A distorted box of graded material, modulus and Poisson's ratio: 1e-8 of the largest displacement."""
    mesh = box(element_type, (5, 4, 6), (2.0, 3.0, 4.0))
    x, y, z = mesh.points.T  # trilinear in each element, so that edges stay straight
    at = parameters(element_type, (5, 4, 6))
    bend = np.interp(at[:, 2], np.linspace(0, 1, 6), [0, 0.3, 0.1, 0.4, 0.2, 0])
    points = np.stack([x + bend, y + 0.5 * bend, z], axis=1)
    nu = 0.2 + 0.2 * at[:, 1] ** 2
    mesh = replace(mesh, points=points, fields={"E_MPa": graded(points), "nu": nu})
    forces = np.zeros((mesh.n_nodes, 3))
    forces[mesh.node_sets["w1"]] = np.random.default_rng(3).normal(size=(len(mesh.node_sets["w1"]), 3))
    expected = reference_displacement(mesh, held(mesh, "w0"), forces)
    found = solve(mesh, held(mesh, "w0"), forces, tolerance=1e-11, device=device64).displacement_mm
    assert np.abs(found - expected).max() < 1e-8 * np.abs(expected).max()


def calculix_displacement(mesh, kind, fixed, forces, folder):
    """The same system by CalculiX, each element with its own mean modulus; five to seven digits are printed."""
    cells, vertices = mesh.cells + 1, mesh.cells.shape[1]
    order = list(range(8)) if vertices == 8 else [*range(12), *range(12, 20)]
    lines = ["*NODE, NSET=all"]
    lines += [f"{i + 1},{x:.17g},{y:.17g},{z:.17g}" for i, (x, y, z) in enumerate(mesh.points)]
    for number, row in enumerate(cells[:, order]):
        lines.append(f"*ELEMENT, TYPE={kind}, ELSET=e{number}")
        numbers = [str(number + 1), *map(str, row)]
        lines += [",".join(numbers[i : i + 10]) + "," for i in range(0, len(numbers) - 10, 10)]
        lines.append(",".join(numbers[len(range(0, len(numbers) - 10, 10)) * 10 :]))
    for number, row in enumerate(mesh.cells):
        modulus, nu = mesh.fields["E_MPa"][row].mean(), mesh.fields["nu"][row].mean()
        lines += [f"*MATERIAL, NAME=m{number}", "*ELASTIC", f"{modulus:.17g},{nu:.17g}"]
        lines.append(f"*SOLID SECTION, ELSET=e{number}, MATERIAL=m{number}")
    lines.append("*BOUNDARY")
    lines += [f"{node + 1},{direction + 1}" for node, direction in np.argwhere(fixed)]
    lines += ["*STEP", "*STATIC", "*CLOAD"]
    lines += [f"{node + 1},{d + 1},{forces[node, d]:.17g}" for node, d in np.argwhere(forces)]
    lines += ["*NODE PRINT, NSET=all", "U", "*END STEP"]
    (folder / "model.inp").write_text("\n".join(lines) + "\n")
    done = subprocess.run(["ccx", "-i", "model"], cwd=folder, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0 and "*ERROR" not in done.stdout, done.stdout[-2000:]
    rows = re.findall(r"^\s+(\d+)((?:\s+-?\d\.\d+E[+-]\d+){3})\s*$", (folder / "model.dat").read_text(), re.M)
    found = np.zeros((mesh.n_nodes, 3))
    for number, values in rows:
        found[int(number) - 1] = [float(v) for v in values.split()]
    return found


@pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX is not installed: apt-get install calculix-ccx")
@pytest.mark.parametrize(("kind", "formulation"), [("C3D8", "full"), ("C3D8I", "incompatible"), ("C3D20", "full")])
def test_agrees_with_calculix(kind, formulation, tmp_path, device64):
    """Distorted, each element of its own modulus: 1e-6 of the largest displacement, the digits that it prints.

    C3D8I leaves out the ratio of determinants in its modes, with which ours pass the patch test: the two are the same
    where elements are parallelepipeds.
    """
    jitter = 0.0 if kind == "C3D8I" else 0.05
    mesh = box("hex20" if kind == "C3D20" else "hex8", (4, 4, 5), (2.0, 3.0, 4.0), jitter=jitter, modulus=graded)
    mesh = replace(mesh, points=mesh.points + np.outer(mesh.points[:, 2], [0.3, 0.2, 0.0]))
    forces = np.zeros((mesh.n_nodes, 3))
    forces[mesh.node_sets["w1"]] = [1.0, 2.0, -3.0]
    expected = calculix_displacement(mesh, kind, held(mesh, "w0"), forces, tmp_path)
    how = {"modulus": "element", "formulation": formulation, "tolerance": 1e-11, "device": device64}
    found = solve(mesh, held(mesh, "w0"), forces, **how).displacement_mm
    assert np.abs(found - expected).max() < 1e-6 * np.abs(expected).max()


@pytest.mark.parametrize(("element_type", "formulation"), FORMS)
def test_multigrid_finds_what_the_nodes_own_blocks_find(element_type, formulation, any_device, monkeypatch):
    """A distorted, graded box of uneven counts and spacing, held by part of a side: 1e-7 of the displacement.

    By grids, and by aggregates where the numbering says nothing.
    """
    counts = (8, 11, 14) if element_type == "hex8" else (5, 6, 7)
    mesh = box(element_type, counts, (2.0, 9.0, 4.0), jitter=0.05, modulus=graded)
    fixed = held(mesh, "w0") & (mesh.points[:, :1] < 1.2)
    forces = np.zeros((mesh.n_nodes, 3))
    forces[mesh.node_sets["w1"]] = [1.0, 2.0, -3.0]
    how = {"formulation": formulation, "tolerance": 1e-10, "device": any_device}
    grids, aggregates = solve(mesh, fixed, forces, **how), solve(explicit(mesh), fixed, forces, **how)
    monkeypatch.setattr("gpubspline.analysis.elasticity.SMALL", mesh.n_nodes)
    slow = solve(mesh, fixed, forces, **how)
    for fast in (grids, aggregates):
        assert np.abs(fast.displacement_mm - slow.displacement_mm).max() < 1e-7 * np.abs(slow.displacement_mm).max()
    assert grids.iterations < 50 < slow.iterations and 2 * aggregates.iterations < slow.iterations


def test_iterations_hardly_grow(device):
    """From 1,728 to 46,656 hexes, with a tenfold modulus in a half: at most 1.5 times as many iterations."""
    iterations = []
    for n in (13, 37):
        mesh = box("hex8", (n, n, n), modulus=lambda x: np.where(x[:, 0] > 0.5, 10000.0, 1000.0))
        forces = np.zeros((mesh.n_nodes, 3))
        forces[mesh.node_sets["w1"], 0] = 1.0
        iterations.append(solve(mesh, held(mesh, "w0"), forces, device=device).iterations)
    assert iterations[1] <= 1.5 * iterations[0]


def test_an_edge_without_length_does_not_keep_the_grids_from_coarsening(device64):
    mesh = box("hex8", (9, 9, 30), (1.0, 1.0, 3.0))
    mesh.points[1] = mesh.points[0]
    forces = np.zeros((mesh.n_nodes, 3))
    forces[mesh.node_sets["w1"], 0] = 1.0
    assert min(spacing_of(mesh.structure, mesh.points)) > 0.05
    assert solve(mesh, held(mesh, "w0"), forces, device=device64).iterations < 60


@pytest.mark.parametrize(("element_type", "formulation"), [*FORMS, ("hex8", "orthotropic")])
def test_the_limit_of_elements_counts_the_longest_array(element_type, formulation, device64, monkeypatch):
    """Kernels index with 32 bits: what is refused must follow from the numbers that an element has in any array."""
    mesh, longest = box(element_type, (5, 4, 4)), [0]
    if formulation == "orthotropic":
        full = np.ones(mesh.n_elements)
        mesh, formulation = with_orthotropy(mesh, 900.0 * full, 2500.0 * full, 0.36 * full), "full"
    empty = device64.empty

    def noted(shape, dtype=None):
        longest[0] = max(longest[0], int(np.prod(shape)))
        return empty(shape, dtype)

    monkeypatch.setattr(device64, "empty", noted)
    k = stiffness(explicit(mesh), device64, formulation=formulation)
    k.inverse_blocks(device64.put(np.ones((3, mesh.n_nodes))))
    assert longest[0] <= numbers_of(mesh, formulation) * k.n_elements


def test_bad_input_is_one_line(device64):
    mesh = box("hex8", (3, 3, 3))
    nothing, fixed = np.zeros((mesh.n_nodes, 3)), held(mesh, "w0")
    flat = mesh.fields

    def message(mesh=mesh, fixed=fixed, forces=nothing, **options):
        with pytest.raises(InputError) as caught:
            solve(mesh, fixed, forces, device=device64, **options)
        return str(caught.value)

    assert "without nu" in message(replace(mesh, fields={"E_MPa": flat["E_MPa"]}))
    assert "positive moduli" in message(mesh.with_fields({"E_MPa": 0 * flat["E_MPa"]}))
    assert "below 0.5" in message(mesh.with_fields({"nu": 0 * flat["nu"] + 0.5}))
    assert "6 of 6 rigid motions" in message(fixed=np.zeros_like(fixed))
    assert "3 of 6 rigid motions" in message(fixed=held(mesh, "w0", [2]))
    moved = mesh.points.copy()
    moved[13] += [0.9, 0.0, 0.0]
    assert "inverted element" in message(replace(mesh, points=moved))
    assert "finite forces" in message(forces=nothing * np.nan)
    assert "shape" in message(forces=nothing[1:])
    assert "formulation" in message(formulation="reduced")
    assert "hexes" in message(Mesh(mesh.points[:9], "quad4", structure=(3, 3)), fixed[:9], nothing[:9])
    two = Mesh(
        np.concatenate([mesh.points, mesh.points + 5]),
        "hex8",
        connectivity=np.concatenate([mesh.cells, mesh.cells + 27]),
    )
    two = two.with_fields({name: np.tile(values, 2) for name, values in flat.items()})
    lower = np.concatenate([fixed, np.zeros_like(fixed)])
    assert "6 of 6" in message(two, lower, np.zeros((54, 3)))


def test_a_solve_that_does_not_converge_is_an_error(device64):
    """Which says what rounding leaves where that is why: a tolerance ten times above it is reached."""
    mesh = box("hex8", (9, 9, 9), modulus=graded)
    forces = np.zeros((mesh.n_nodes, 3))
    forces[mesh.node_sets["w1"], 0] = 1.0
    with pytest.raises(SolveError, match=r"did not converge: .*; rounding alone leaves") as caught:
        solve(mesh, held(mesh, "w0"), forces, tolerance=1e-30, device=device64)
    left = float(re.search(r"leaves (\S+):", str(caught.value))[1])
    assert solve(mesh, held(mesh, "w0"), forces, tolerance=10 * left, device=device64).residual < 10 * left


def test_roundings_of_displacements_do_not_count(device64):
    """A beam 60 times as long as thin: the last digit of each displacement leaves 3e-10, steps that add up 3e-9."""
    mesh = box("hex8", (25, 3, 3), (6.0, 0.2, 0.1))
    forces = np.zeros((mesh.n_nodes, 3))
    forces[mesh.node_sets["u1"], 1] = 1.0
    how = {"formulation": "incompatible", "device": device64}
    solution = solve(mesh, held(mesh, "u0"), forces, tolerance=1e-11, **how)
    coarse = solve(mesh, held(mesh, "u0"), forces, tolerance=1e-6, **how)
    assert solution.residual < 1e-11
    reached = np.ptp(coarse.displacement_mm)
    np.testing.assert_allclose(solution.displacement_mm, coarse.displacement_mm, atol=1e-6 * reached)


def test_a_long_beam_of_many_elements_reaches_the_tolerance(device):
    """MacNeal and Harder's in 24,576 hexes, of whose loads the displacements' last digit leaves 1e-8; 0.4321 to 5 %."""
    mesh = box("hex8", (193, 17, 9), (6.0, 0.2, 0.1)).with_fields({"E_MPa": np.full(193 * 17 * 9, 1e7)})
    forces = np.zeros((mesh.n_nodes, 3))
    tip = mesh.node_sets["u1"]
    forces[tip, 2] = 1 / len(tip)
    solution = solve(mesh, held(mesh, "u0"), forces, device=device)
    assert solution.residual < 1e-8
    assert solution.displacement_mm[tip, 2].mean() == pytest.approx(0.4321, rel=0.05)


def test_progress_shows_the_residual(device64):
    mesh = box("hex8", (4, 4, 4))
    forces = np.zeros((mesh.n_nodes, 3))
    forces[mesh.node_sets["w1"], 0] = 1.0
    seen = []
    solution = solve(mesh, held(mesh, "w0"), forces, device=device64, progress=lambda *row: seen.append(row))
    assert [number for number, _ in seen] == list(range(1, solution.iterations + 1))
    assert seen[-1][1] <= 1e-8 < seen[-2][1]
