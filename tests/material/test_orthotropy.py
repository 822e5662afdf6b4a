"""Orthotropic elements: their constants, axes from u, v, w, patch test, a pulled block, scikit-fem."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from gpubspline.analysis.elasticity import solve
from gpubspline.analysis.gauss import gauss_stress
from gpubspline.device import Device
from gpubspline.errors import InputError
from gpubspline.material.orthotropy import (
    element_axes,
    is_orthotropic,
    orthotropic,
    with_orthotropy,
)
from gpubspline.mesh.mesh import Mesh

Floats = NDArray[np.float64]
VOIGT = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))


def rotation(seed: int = 4) -> Floats:
    q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return q * np.sign(np.linalg.det(q))


def box(element_type: str = "hex8", counts: tuple[int, ...] = (4, 3, 5), jitter: float = 0.0) -> Mesh:
    """2 x 3 x 4 mm, turned in space; corners may be moved about."""
    order = 1 if element_type == "hex8" else 2
    axes = [np.linspace(0, s, order * (n - 1) + 1) for s, n in zip((2.0, 3.0, 4.0), counts, strict=True)]
    u, v, w = (a.ravel(order="F") for a in np.meshgrid(*axes, indexing="ij"))
    if element_type == "hex20":
        odd = sum(np.meshgrid(*[np.arange(len(a)) % 2 for a in axes], indexing="ij")).ravel(order="F")
        u, v, w = u[odd < 2], v[odd < 2], w[odd < 2]
    points = np.stack([u, v, w], axis=1)
    inner = np.all((points > 1e-9) & (points < np.array([2, 3, 4]) - 1e-9), axis=1)
    points[inner] += jitter * np.random.default_rng(1).uniform(-1, 1, (inner.sum(), 3))
    return Mesh(points @ rotation().T, element_type, structure=counts)


def made_of(mesh: Mesh, axial: float | Floats = 900.0, transverse: float | Floats = 2500.0, nu: float = 0.36) -> Mesh:
    full = np.ones(mesh.n_elements)
    return with_orthotropy(mesh, axial * full, transverse * full, nu * full)


def compliance(constants: dict[str, float]) -> Floats:
    """Voigt's 6 x 6 with engineering shear strains, from the constants as every solver defines them."""
    e1, e2, e3 = (constants[f"E{i}_MPa"] for i in (1, 2, 3))
    s = np.diag([1 / e1, 1 / e2, 1 / e3, *(1 / constants[f"G{pair}_MPa"] for pair in ("23", "13", "12"))])
    s[0, 1] = s[1, 0] = -constants["nu12"] / e1
    s[0, 2] = s[2, 0] = -constants["nu13"] / e1
    s[1, 2] = s[2, 1] = -constants["nu23"] / e2
    return s


def test_stress_is_that_of_the_engineering_constants() -> None:
    """The inverse of the compliance, turned to the axes, on six strains; positive definite whichever is stiffer."""
    mesh = made_of(box(counts=(2, 2, 2)))
    material = orthotropic(mesh)
    constants = {name: float(values[0]) for name, values in mesh.cell_fields.items()}
    stiff = np.linalg.inv(compliance(constants))
    assert np.linalg.eigvalsh(compliance(constants)).min() > 0
    turn = material.axes[..., 0]  # rows are the axes
    for row, column in VOIGT:
        strain = np.zeros((3, 3))
        strain[row, column] = strain[column, row] = 1e-3
        own = turn @ strain @ turn.T
        voigt = np.array([own[i, j] * (1 if i == j else 2) for i, j in VOIGT])
        stress = np.zeros((3, 3))
        for value, (i, j) in zip(stiff @ voigt, VOIGT, strict=True):
            stress[i, j] = stress[j, i] = value
        found = material.stress(strain[..., None])[..., 0]
        np.testing.assert_allclose(found, turn.T @ stress @ turn, atol=1e-12 * np.abs(stress).max())


def test_equal_moduli_are_isotropic() -> None:
    mesh = made_of(box(counts=(2, 2, 2)), 1200.0, 1200.0, 0.3)
    cells = mesh.cell_fields
    assert cells["nu12"][0] == cells["nu13"][0] == pytest.approx(0.3)
    assert cells["G12_MPa"][0] == cells["G23_MPa"][0] == pytest.approx(1200 / 2.6)
    assert cells["E_MPa"][0] == pytest.approx(1200)
    strain = np.random.default_rng(0).normal(size=(3, 3))
    strain += strain.T
    expected = 1200 / 1.3 * (strain + 0.3 / 0.4 * np.trace(strain) * np.eye(3))
    np.testing.assert_allclose(orthotropic(mesh).stress(strain[..., None])[..., 0], expected, rtol=1e-12)


def test_axes_follow_u_and_w() -> None:
    """A sheared and turned box: 3 along w, 1 in the plane of u and w, right-handed and of length 1."""
    mesh = box(counts=(3, 3, 3))
    sheared = replace(mesh, points=mesh.points @ np.array([[1, 0, 0], [0.2, 1, 0.1], [0.4, 0.3, 1]]).T)
    axes = element_axes(sheared)
    corners = sheared.points[sheared.cells]
    w, u = corners[:, 4] - corners[:, 0], corners[:, 1] - corners[:, 0]
    np.testing.assert_allclose(axes[2].T, w / np.linalg.norm(w, axis=1)[:, None], atol=1e-12)
    assert np.abs(np.einsum("mc,cm->m", np.cross(u, w), axes[0])).max() < 1e-12
    np.testing.assert_allclose(np.einsum("icm,jcm->ijm", axes, axes), np.eye(3)[..., None].repeat(8, 2), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(axes.transpose(2, 0, 1)), 1)


@pytest.mark.parametrize("element_type", ["hex8", "hex20", "hex27"])
def test_patch_of_distorted_elements(element_type: str, device64: Device) -> None:
    """A linear displacement on the boundary is found inside, exactly, and its stress is one and the same."""
    mesh = made_of(box(element_type, jitter=0.08 if element_type == "hex8" else 0.0))
    one = {name: np.full(mesh.n_elements, values[0]) for name, values in mesh.cell_fields.items()}
    mesh = replace(mesh, cell_fields=one)  # the same axes everywhere
    slope = np.random.default_rng(5).normal(size=(3, 3)) * 1e-3
    exact = mesh.points @ slope.T
    surface = np.zeros((mesh.n_nodes, 3), dtype=bool)
    surface[np.unique(mesh.boundary())] = True
    found = solve(mesh, surface, np.zeros((mesh.n_nodes, 3)), prescribed_mm=exact, tolerance=1e-12, device=device64)
    np.testing.assert_allclose(found.displacement_mm, exact, atol=1e-9 * np.abs(exact).max())
    stress = gauss_stress(mesh, found.displacement_mm).stress
    strain = (slope + slope.T) / 2
    expected = orthotropic(mesh).stress(np.repeat(strain[..., None], mesh.n_elements, 2))[..., 0]
    rows, columns = zip((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2), strict=True)
    expected = expected[list(rows), list(columns)]
    np.testing.assert_allclose(stress, np.broadcast_to(expected[:, None, None], stress.shape), rtol=1e-6, atol=1e-7)


def test_a_block_pulled_along_each_axis(device: Device) -> None:
    """One stress along an axis: the strain is stress over that axis's modulus, and Poisson's across it."""
    mesh = made_of(box(counts=(3, 3, 4)))
    c = {name: float(values[0]) for name, values in mesh.cell_fields.items()}
    local = mesh.points @ rotation()  # along u, v, w
    sizes = (2.0, 3.0, 4.0)
    for axis, modulus in ((0, c["E1_MPa"]), (2, c["E3_MPa"])):
        held = np.zeros((mesh.n_nodes, 3), dtype=bool)
        held[local[:, axis] < 1e-9] = held[local[:, axis] > sizes[axis] - 1e-9] = True
        moved = np.zeros((mesh.n_nodes, 3))
        strain = np.full(3, -1e-3) * np.array(
            {0: (-1, c["nu12"], c["nu13"]), 2: (c["nu13"] * c["E3_MPa"] / c["E1_MPa"],) * 2 + (-1,)}[axis]
        )
        moved[:] = (local * strain) @ rotation().T
        found = solve(mesh, held, np.zeros((mesh.n_nodes, 3)), prescribed_mm=moved, tolerance=1e-9, device=device)
        np.testing.assert_allclose(found.displacement_mm, moved, atol=1e-6 * np.abs(moved).max())
        volume = 24.0
        assert found.strain_energy_nmm == pytest.approx(0.5 * modulus * 1e-6 * volume, rel=1e-6)


def by_scikit_fem(mesh: Mesh, held: NDArray[np.bool_], forces: Floats) -> Floats:
    """The same system by scikit-fem, the stiffness of each element as the inverse of its compliance."""
    skfem = pytest.importorskip("skfem")
    from scipy.spatial import cKDTree
    from skfem.helpers import ddot, sym_grad
    from skfem.io.meshio import from_meshio

    grid = from_meshio(Mesh(mesh.points, "hex8", connectivity=mesh.cells).to_meshio())
    basis = skfem.Basis(grid, skfem.ElementVector(skfem.ElementHex1()), intorder=3)
    tensors = np.empty((mesh.n_elements, 3, 3, 3, 3))
    axes = orthotropic(mesh).axes
    for number in range(mesh.n_elements):
        constants = {name: float(values[number]) for name, values in mesh.cell_fields.items()}
        stiff, own = np.linalg.inv(compliance(constants)), np.zeros((3, 3, 3, 3))
        for a, (i, j) in enumerate(VOIGT):
            for b, (p, q) in enumerate(VOIGT):
                own[i, j, p, q] = own[j, i, p, q] = own[i, j, q, p] = own[j, i, q, p] = stiff[a, b]
        turn = axes[..., number]
        tensors[number] = np.einsum("ijkl,ia,jb,kc,ld->abcd", own, turn, turn, turn, turn)

    @skfem.BilinearForm
    def form(u, v, w):
        return ddot(np.einsum("eabcd,cdeg->abeg", tensors, sym_grad(u)), sym_grad(v))

    away, node = cKDTree(mesh.points).query(basis.doflocs.T)
    assert away.max() < 1e-9
    direction = np.empty(basis.N, dtype=int)
    direction[basis.nodal_dofs.ravel()] = np.repeat(np.arange(3), basis.nodal_dofs.shape[1])
    system = skfem.condense(form.assemble(basis), forces[node, direction], D=held[node, direction].nonzero()[0])
    found = np.zeros((mesh.n_nodes, 3))
    found[node, direction] = skfem.solve(*system)
    return found


def test_agrees_with_scikit_fem(device64: Device) -> None:
    """Distorted elements, each of its own moduli and axes: 1e-8 of the largest displacement."""
    mesh = box(counts=(5, 4, 6), jitter=0.08)
    rng = np.random.default_rng(7)
    axial, transverse = rng.uniform(300, 4000, (2, mesh.n_elements))
    mesh = with_orthotropy(mesh, axial, transverse, rng.uniform(0.2, 0.4, mesh.n_elements))
    local = mesh.points @ rotation()
    held = np.repeat((local[:, 2] < 1e-9)[:, None], 3, axis=1)
    forces = np.where(local[:, 2:] > 4 - 1e-9, rng.normal(size=(mesh.n_nodes, 3)), 0.0)
    expected = by_scikit_fem(mesh, held, forces)
    found = solve(mesh, held, forces, tolerance=1e-12, device=device64).displacement_mm
    assert np.abs(found - expected).max() < 1e-8 * np.abs(expected).max()


@pytest.mark.parametrize("element_type", ["hex8", "hex20"])
def test_multigrid_of_the_mean_modulus_preconditions(element_type: str, device: Device) -> None:
    counts = (9, 9, 17) if element_type == "hex8" else (5, 5, 9)
    mesh = made_of(box(element_type, counts), 3000.0, 900.0)
    local = mesh.points @ rotation()
    held = np.repeat((local[:, 2] < 1e-9)[:, None], 3, axis=1)
    forces = np.where(local[:, 2:] > 4 - 1e-9, 1.0, 0.0) * np.ones(3)
    found = solve(mesh, held, forces, tolerance=1e-8, device=device)
    assert found.iterations < 120
    np.testing.assert_allclose(found.reactions_n.sum(axis=0), -forces.sum(axis=0), rtol=1e-6)


def test_what_is_refused(device64: Device) -> None:
    mesh = box(counts=(3, 3, 3))
    explicit = Mesh(mesh.points, "hex8", connectivity=mesh.cells)
    with pytest.raises(InputError, match=r"structured mesh of hexes .* orthotropy from, got an explicit"):
        made_of(explicit)
    made = made_of(mesh)
    assert is_orthotropic(made) and not is_orthotropic(mesh)
    held = np.ones((made.n_nodes, 3), dtype=bool)
    with pytest.raises(InputError, match="'full' for orthotropic elements, got 'bbar'"):
        solve(made, held, np.zeros((made.n_nodes, 3)), formulation="bbar", device=device64)
    cells = {name: values for name, values in made.cell_fields.items() if name != "axis2_y"}
    with pytest.raises(InputError, match="got none of axis2_y"):
        orthotropic(replace(made, cell_fields=cells))
    with pytest.raises(InputError, match="at right angles"):
        orthotropic(made.with_cell_fields({"axis2_x": made.cell_fields["axis1_x"]}))
    with pytest.raises(InputError, match="positive moduli, got a least of 0"):
        orthotropic(made.with_cell_fields({"E2_MPa": np.zeros(made.n_elements)}))
