"""Mass: exact for what the elements interpolate, and of what has one."""

import numpy as np
import pytest

from gpubspline.mesh.elements import ELEMENTS
from gpubspline.mesh.mass import mass_g
from gpubspline.mesh.mesh import Mesh

HEXES = ("hex8", "hex20", "hex27")


def box(element_type: str, n: int = 3) -> Mesh:
    """The unit box, mm, with the nodes in their places on a lattice."""
    axes = [np.linspace(0, 1, n)] * 3
    corners = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3, order="F")
    mesh = Mesh(corners, "hex8", structure=(n, n, n))
    if element_type == "hex8":
        return mesh
    vertices = np.array(ELEMENTS[element_type].vertices) / 2
    points = (mesh.points[mesh.cells[:, :1]] + vertices / (n - 1)).reshape(-1, 3)
    return Mesh(points, element_type, connectivity=np.arange(len(points), dtype=np.int32).reshape(-1, len(vertices)))


@pytest.mark.parametrize("element_type", HEXES)
def test_mass_of_a_linear_density_in_a_sheared_box(element_type: str) -> None:
    mesh = box(element_type)
    shear = np.array([[20.0, 3.0, 0.0], [0.0, 10.0, -4.0], [1.0, 0.0, 30.0]])
    points = mesh.points @ shear.T + 5
    density = 1.5 + points @ np.array([0.01, -0.02, 0.03])
    moved = Mesh(points, element_type, mesh.structure, mesh.connectivity, {"density_g_cm3": density})
    centre = shear @ [0.5, 0.5, 0.5] + 5
    expected = np.linalg.det(shear) * (1.5 + centre @ [0.01, -0.02, 0.03]) * 1e-3
    assert mass_g(moved) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("element_type", HEXES)
def test_mass_of_one_density_in_a_twisted_box_is_its_volume(element_type: str) -> None:
    mesh = box(element_type)
    x, y, z = mesh.points.T
    points = np.stack([x + 0.1 * y * y * z, y + 0.1 * x * z, z * (1 + 0.2 * x)], axis=1)
    moved = Mesh(points, element_type, mesh.structure, mesh.connectivity, {"density_g_cm3": np.full(len(points), 2.0)})
    assert mass_g(moved) == pytest.approx(2e-3 * moved.volume_mm3, rel=1e-12)


def test_what_has_no_mass() -> None:
    assert mass_g(box("hex8")) is None
    quad = Mesh(np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]), "quad4", connectivity=np.array([[0, 1, 2, 3]]))
    assert mass_g(quad.with_fields({"density_g_cm3": np.ones(4)})) is None
