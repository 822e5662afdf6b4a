"""Multigrid of hexes of any topology: the matrix that it is made of, its iterations, the same result each time."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from gpubspline.analysis.aggregation import aggregation, assemble
from gpubspline.analysis.elasticity import solve
from gpubspline.analysis.stiffness import stiffness
from gpubspline.bench.closed_forms import block
from gpubspline.device import Device
from gpubspline.mesh.mesh import Mesh


def shuffled(mesh: Mesh) -> Mesh:
    """Nodes and elements in any order, and a node of no element."""
    rng = np.random.default_rng(0)
    order = rng.permutation(mesh.n_nodes)
    place = np.argsort(order)
    cells = place[mesh.cells][rng.permutation(mesh.n_elements)]
    fields = {name: np.append(values[order], values[0]) for name, values in mesh.fields.items()}
    points = np.concatenate([mesh.points[order], [[9.0, 9, 9]]])
    return Mesh(points, mesh.element_type, connectivity=cells, fields=fields)


def bone(element_type: str, n: int) -> Mesh:
    """A bent column, two hundred times as stiff in its shell as inside."""

    def place(at: Any) -> Any:
        x, y, z = (at * [1, 1, 3]).T
        return np.stack([x + 0.2 * z**2 + 0.1 * x * y, y + 0.1 * np.sin(2 * x), z], axis=1)

    mesh = block(element_type, (n, n, 3 * n), place, nu=0.3)
    inside = np.ones(mesh.n_nodes, dtype=bool)
    inside[np.unique(mesh.boundary())] = False
    return mesh.with_fields({"E_MPa": np.where(inside, 50.0, 10_000.0)})


def loaded(mesh: Mesh) -> tuple[Any, Any]:
    low, high = mesh.points[:, 2] < 1e-9, np.abs(mesh.points[:, 2] - 3) < 1e-9
    forces = np.zeros((mesh.n_nodes, 3))
    forces[high] = [1.0, 0.5, -2.0]
    return np.repeat(low[:, None], 3, axis=1), forces


def test_what_cancels_between_parts_keeps_its_place(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of cubes, such as voxels are, couplings of one direction with another cancel; SciPy's sums leave them out."""
    mesh = block("hex8", (5, 4, 4), lambda at: at * [4.0, 3, 3], nu=0.3)
    mesh = Mesh(mesh.points, "hex8", connectivity=mesh.cells, fields=mesh.fields)
    held = np.zeros((mesh.n_nodes, 3), dtype=bool)
    whole = assemble(mesh, held, "graded").toarray()
    monkeypatch.setattr("gpubspline.analysis.aggregation._CHUNK", 5)
    assert np.abs(assemble(mesh, held, "graded").toarray() - whole).max() < 1e-6 * whole.max()


@pytest.mark.parametrize("modulus", ["graded", "element"])
@pytest.mark.parametrize("element_type", ["hex8", "hex20"])
def test_the_matrix_is_that_of_the_elements(element_type: str, modulus: str, device64: Device) -> None:
    """Times a displacement, the kernels' product, 1e-6: in float32, held directions left alone."""
    mesh = shuffled(bone(element_type, 3))
    held, _ = loaded(mesh)
    held[-1] = True
    u = np.random.default_rng(1).normal(size=(mesh.n_nodes, 3)) * ~held
    k, out = stiffness(mesh, device64, modulus), device64.empty(3 * mesh.n_nodes)
    k.apply(device64.put(np.ascontiguousarray(u.T)), device64.put(np.ascontiguousarray(~held.T, dtype=float)), out)
    expected = np.reshape(device64.get(out), (3, -1)).T
    found = (assemble(mesh, held, modulus) @ u.ravel()).reshape(-1, 3)
    assert np.abs(found - expected).max() < 1e-6 * np.abs(expected).max()


def test_the_cycle_is_symmetric_and_definite() -> None:
    """x M y = y M x and x M x > 0, to rounding of float32; what is held stays."""
    mesh = shuffled(bone("hex8", 5))
    held, _ = loaded(mesh)
    held[-1] = True
    made = aggregation(mesh, held, "graded")
    x, y = np.random.default_rng(2).normal(size=(2, 3, mesh.n_nodes))
    mx, my = made.cycle(x), made.cycle(y)
    assert np.sum(x * my) == pytest.approx(np.sum(y * mx), rel=1e-4, abs=1e-5 * np.sum(x * mx))
    assert np.sum(x * mx) > 0 and not mx[:, held.all(axis=1)].any()


@pytest.mark.parametrize("element_type", ["hex8", "hex20"])
def test_iterations_of_a_mesh_without_structure(element_type: str, device: Device, monkeypatch: Any) -> None:
    """At most a fifth of those over the nodes' own blocks, and the same displacement, 1e-5; the same bits each time."""
    mesh = shuffled(bone(element_type, 8 if element_type == "hex8" else 4))
    assert mesh.structure is None
    fixed, forces = loaded(mesh)
    found, again = (solve(mesh, fixed, forces, device=device) for _ in range(2))
    monkeypatch.setattr("gpubspline.analysis.elasticity.SMALL", mesh.n_nodes)
    slow = solve(mesh, fixed, forces, device=device)
    assert 5 * found.iterations < slow.iterations
    assert np.abs(found.displacement_mm - slow.displacement_mm).max() < 1e-5 * np.abs(slow.displacement_mm).max()
    np.testing.assert_array_equal(found.displacement_mm, again.displacement_mm)


def test_a_structure_left_out_changes_little(device: Device) -> None:
    mesh = bone("hex8", 6)
    fixed, forces = loaded(mesh)
    whole = solve(mesh, fixed, forces, device=device)
    table = solve(replace(mesh, structure=None, connectivity=mesh.cells), fixed, forces, device=device)
    assert np.abs(whole.displacement_mm - table.displacement_mm).max() < 1e-6 * np.abs(whole.displacement_mm).max()
