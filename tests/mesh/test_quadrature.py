"""Quadrature on devices: its rule, and integrals against the host's own and against exact ones."""

import numpy as np
import pytest

from gpubspline.device import Device
from gpubspline.errors import InputError
from gpubspline.mesh.elements import ELEMENTS, find_element
from gpubspline.mesh.mass import mass_g
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


@pytest.mark.parametrize("name", ["hex8", "hex20", "hex27"])
def test_integral_against_the_hosts(name: str, device: Device) -> None:
    mesh = bent(name)
    assert integral(mesh, "density_g_cm3", device) / 1000 == pytest.approx(mass_g(mesh), rel=2e-6)


def test_integral_over_quads(device64: Device) -> None:
    """1 + x over a parallelogram of sides (4, 0, 3) and (0, 2, 0): 10 mm2 times the mean 1 + 2."""
    u, v = (a.ravel(order="F") for a in np.meshgrid(np.linspace(0, 1, 3), np.linspace(0, 1, 4), indexing="ij"))
    mesh = Mesh(np.stack([4 * u, 2 * v, 3 * u], axis=1), "quad4", structure=(3, 4), fields={"f": 1 + 4 * u})
    assert integral(mesh, "f", device64) == pytest.approx(30.0, rel=1e-13)
