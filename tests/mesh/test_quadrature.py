"""Quadrature on devices: its rule, and integrals against exact ones."""

import numpy as np
import pytest

from gpubspline.device import Device
from gpubspline.errors import InputError
from gpubspline.mesh.elements import ELEMENTS, find_element
from gpubspline.mesh.mesh import Mesh
from gpubspline.mesh.quadrature import integral, rule


@pytest.mark.parametrize("name", ["quad4", "hex8", "hex20"])
def test_the_rule_is_that_of_the_element(name: str) -> None:
    element = ELEMENTS[name]
    for ours, theirs in zip(rule(element, element.order + 1), element.gauss(), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-15)


@pytest.mark.parametrize("n", [1, 2, 3, 5])
def test_the_rule_is_exact_to_degree_2n_less_1(n: int) -> None:
    at, weights = rule(find_element("hex8"), n)
    degree = 2 * n - 1
    for powers in ((degree, 0, 0), (0, degree, degree), (degree,) * 3):
        expected = np.prod([1 / (power + 1) for power in powers])
        assert np.sum(weights * np.prod(at ** np.array(powers), axis=1)) == pytest.approx(expected, rel=1e-13)
    with pytest.raises(InputError, match="at least one quadrature point"):
        rule(find_element("hex8"), 0)


def bent(name: str) -> Mesh:
    """Two by three by two crooked elements with a nodal field."""
    order, counts = find_element(name).order, (3, 4, 3)
    axes = [np.linspace(0, 1, order * (n - 1) + 1) for n in counts]
    u, v, w = (a.ravel(order="F") for a in np.meshgrid(*axes, indexing="ij"))
    if name == "hex20":
        odd = sum(np.meshgrid(*[np.arange(len(a)) % 2 for a in axes], indexing="ij")).ravel(order="F")
        u, v, w = u[odd < 2], v[odd < 2], w[odd < 2]
    points = np.stack([20 * u + 3 * v * w, 30 * v - 4 * u * u, 10 * w + 2 * u * v], axis=1) + 100
    return Mesh(points, name, structure=counts, fields={"density_g_cm3": 1 + 0.3 * u - 0.2 * v * w})


HEXES = ("hex8", "hex20", "hex27")


@pytest.mark.parametrize("name", HEXES)
def test_integral_of_crooked_elements(name: str, device: Device) -> None:
    """Against six points a direction in float64, far more than the polynomials need."""
    mesh = bent(name)
    at, weights = np.polynomial.legendre.leggauss(6)
    grid = np.stack(np.meshgrid(*[(at + 1) / 2] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    jacobian = np.einsum("dgk,mkx->mgdx", mesh.element.gradient(grid), mesh.points[mesh.cells])
    values = np.linalg.det(jacobian) * (mesh.fields["density_g_cm3"][mesh.cells] @ mesh.element.shape(grid).T)
    expected = np.sum(values * np.prod(np.meshgrid(*[weights / 2] * 3, indexing="ij"), axis=0).ravel())
    assert integral(mesh, "density_g_cm3", device) == pytest.approx(expected, rel=2e-6)


def box(name: str, n: int = 3) -> Mesh:
    """The unit box, mm, with the nodes in their places on a lattice."""
    axes = [np.linspace(0, 1, n)] * 3
    corners = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3, order="F")
    mesh = Mesh(corners, "hex8", structure=(n, n, n))
    if name == "hex8":
        return mesh
    vertices = np.array(ELEMENTS[name].vertices) / 2
    points = (mesh.points[mesh.cells[:, :1]] + vertices / (n - 1)).reshape(-1, 3)
    return Mesh(points, name, connectivity=np.arange(len(points), dtype=np.int32).reshape(-1, len(vertices)))


@pytest.mark.parametrize("name", HEXES)
def test_integral_of_a_linear_field_in_a_sheared_box(name: str, device64: Device) -> None:
    mesh = box(name)
    shear = np.array([[20.0, 3.0, 0.0], [0.0, 10.0, -4.0], [1.0, 0.0, 30.0]])
    points = mesh.points @ shear.T + 5
    moved = Mesh(points, name, mesh.structure, mesh.connectivity, {"f": 1.5 + points @ np.array([0.01, -0.02, 0.03])})
    centre = shear @ [0.5, 0.5, 0.5] + 5
    expected = np.linalg.det(shear) * (1.5 + centre @ [0.01, -0.02, 0.03])
    assert integral(moved, "f", device64) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("name", HEXES)
def test_integral_of_one_is_the_volume_within_the_faces(name: str, device64: Device) -> None:
    mesh = box(name)
    x, y, z = mesh.points.T
    points = np.stack([x + 0.1 * y * y * z, y + 0.1 * x * z, z * (1 + 0.2 * x)], axis=1)
    moved = Mesh(points, name, mesh.structure, mesh.connectivity, {"f": np.full(len(points), 2.0)})
    assert integral(moved, "f", device64) == pytest.approx(2 * moved.volume_mm3, rel=1e-12)


def test_integral_over_quads(device64: Device) -> None:
    """1 + x over a parallelogram of sides (4, 0, 3) and (0, 2, 0): 10 mm2 times the mean 1 + 2."""
    u, v = (a.ravel(order="F") for a in np.meshgrid(np.linspace(0, 1, 3), np.linspace(0, 1, 4), indexing="ij"))
    mesh = Mesh(np.stack([4 * u, 2 * v, 3 * u], axis=1), "quad4", structure=(3, 4), fields={"f": 1 + 4 * u})
    assert integral(mesh, "f", device64) == pytest.approx(30.0, rel=1e-13)
