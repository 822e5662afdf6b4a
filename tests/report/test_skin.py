"""The skin of a mesh is a closed outward surface, whole or cut."""

import numpy as np
import pytest

from gpubspline.mesh.mesh import Mesh
from gpubspline.report.painter import Shell
from gpubspline.report.skin import cut_skin, skin

COUNTS = (5, 7, 9)
SIZE_MM = (30.0, 20.0, 40.0)
VIEWER = np.array([0.6, -0.7, 0.3])


def box(element_type: str = "hex8", explicit: bool = False) -> Mesh:
    """Sheared box of 4 x 6 x 8 elements, with a nodal field (x) and an element field (its own number)."""
    n = COUNTS if element_type == "hex8" else tuple(2 * count - 1 for count in COUNTS)
    u, v, w = np.meshgrid(*(np.linspace(0, 1, count) for count in n), indexing="ij")
    x, y, z = (s * a.ravel(order="F") for s, a in zip(SIZE_MM, (u, v, w), strict=True))
    points = np.stack([x + 0.2 * z, y - 0.1 * x, z], axis=1)
    mesh = Mesh(points, element_type, structure=COUNTS, fields={"x": points[:, 0]})
    mesh = mesh.with_cell_fields({"number": np.arange(mesh.n_elements)})
    if explicit:
        fields = {"fields": mesh.fields, "cell_fields": mesh.cell_fields}
        return Mesh(points, element_type, connectivity=mesh.cells, **fields)
    return mesh


def area_vector_and_volume(shell: Shell) -> tuple[np.ndarray, float]:
    """Sum of the faces' area vectors, and the volume inside by the divergence theorem."""
    a, b, c, d = np.moveaxis(shell.corners, 1, 0)
    vectors = np.cross(c - a, d - b) / 2
    return vectors.sum(axis=0), float(np.sum(vectors * shell.corners.mean(axis=1)) / 3)


@pytest.mark.parametrize(("element_type", "explicit"), [("hex8", False), ("hex8", True), ("hex27", False)])
def test_skin_is_closed_and_outward(element_type: str, explicit: bool) -> None:
    mesh = box(element_type, explicit)
    shell = skin(mesh, "x")
    assert shell.corners.shape == (2 * (4 * 6 + 6 * 8 + 4 * 8), 4, 3)
    vector, volume = area_vector_and_volume(shell)
    np.testing.assert_allclose(vector, 0, atol=1e-9)
    assert volume == pytest.approx(mesh.volume_mm3, rel=1e-12)
    np.testing.assert_allclose(shell.values, shell.corners[..., 0])
    np.testing.assert_allclose(np.linalg.norm(shell.normals, axis=1), 1)


@pytest.mark.parametrize("explicit", [False, True])
def test_cut_takes_the_half_of_the_viewer(explicit: bool) -> None:
    mesh = box(explicit=explicit)
    half, normal = cut_skin(mesh, "x", VIEWER)
    vector, volume = area_vector_and_volume(half)
    np.testing.assert_allclose(vector, 0, atol=1e-9)
    assert volume == pytest.approx(mesh.volume_mm3 / 2, rel=1e-12)
    assert normal @ VIEWER > 0
    # u-w is the greatest section of 30 x 20 x 40 mm: what is left lies behind the plane through the centre
    assert abs(normal[1]) > 0.9
    heights = half.corners.reshape(-1, 3) @ normal
    assert heights.max() == pytest.approx(mesh.points.mean(axis=0) @ normal, abs=0.1 * SIZE_MM[1])


def test_cut_from_the_other_side_is_the_other_half() -> None:
    mesh = box()
    front, back = cut_skin(mesh, "number", VIEWER)[0], cut_skin(mesh, "number", -VIEWER)[0]
    owners = [set(np.unique(shell.values)) for shell in (front, back)]
    assert not owners[0] & owners[1]


def test_element_field_is_that_of_the_owner() -> None:
    for mesh in (box(), box(explicit=True)):
        shell = skin(mesh, "number")
        centres = mesh.points[mesh.cells].mean(axis=1)[shell.values[:, 0].astype(int)]
        # half an element from the face's centre to its owner's
        away = np.abs(shell.corners.mean(axis=1) - centres)
        assert np.all(away.max(axis=1) < 1.01 * 30 / 4 / 2)


def test_quad_mesh_is_its_own_skin() -> None:
    points = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0], [1, 1, 0], [2, 1, 0]])
    mesh = Mesh(points, "quad4", structure=(3, 2), fields={"HU": np.arange(6.0)})
    assert skin(mesh, "HU").values.tolist() == [[0, 1, 4, 3], [1, 2, 5, 4]]
