"""Reading mesh files that others wrote, and refusing those that are none."""

import meshio
import numpy as np
import pytest

from gpubspline.errors import GpubsplineWarning, InputError
from gpubspline.export import read_mesh
from gpubspline.mesh.elements import ELEMENTS

HEX = np.array(ELEMENTS["hex8"].vertices) / 2.0


def test_hexes_win_over_quads_and_several_blocks_are_joined(tmp_path):
    points = np.concatenate([HEX, HEX + np.array([2, 0, 0])])
    cells = [("quad", [[0, 1, 2, 3]]), ("hexahedron", [list(range(8))]), ("hexahedron", [list(range(8, 16))])]
    data = {"part": [np.array([7]), np.array([1]), np.array([2])]}
    meshio.write(tmp_path / "a.vtk", meshio.Mesh(points, cells, cell_data=data))
    with pytest.warns(GpubsplineWarning, match="left out cells of quad"):
        mesh = read_mesh(tmp_path / "a.vtk")
    assert mesh.element_type == "hex8"
    assert mesh.n_elements == 2
    assert mesh.volume_mm3 == pytest.approx(2)
    assert mesh.cell_fields["part"].tolist() == [1, 2]


def test_vectors_come_back_by_component(tmp_path):
    vectors = np.arange(24.0).reshape(8, 3)
    meshio.write(tmp_path / "a.vtu", meshio.Mesh(HEX, [("hexahedron", [list(range(8))])], point_data={"d": vectors}))
    mesh = read_mesh(tmp_path / "a.vtu")
    np.testing.assert_array_equal(np.column_stack([mesh.fields[f"d_{c}"] for c in range(3)]), vectors)


def test_flat_points_gain_a_third_coordinate(tmp_path):
    square = HEX[:4, :2]
    meshio.write(tmp_path / "a.msh", meshio.Mesh(square, [("quad", [[0, 1, 2, 3]])]), file_format="gmsh22")
    assert read_mesh(tmp_path / "a.msh").area_mm2 == pytest.approx(1)


def test_what_pyvista_writes_can_be_read(tmp_path):
    pyvista = pytest.importorskip("pyvista")
    grid = pyvista.UnstructuredGrid({12: np.arange(8)[None]}, HEX)
    grid.point_data["HU"] = np.arange(8.0)
    grid.save(tmp_path / "a.vtu")
    np.testing.assert_array_equal(read_mesh(tmp_path / "a.vtu").fields["HU"], np.arange(8.0))


def test_tetrahedra_alone_are_refused(tmp_path):
    meshio.write(tmp_path / "a.vtk", meshio.Mesh(HEX[:4], [("tetra", [[0, 1, 2, 3]])]))
    with pytest.raises(InputError, match=r"expected hexes or quads, got tetra in a\.vtk"):
        read_mesh(tmp_path / "a.vtk")


def test_hexes_of_two_orders_are_refused(tmp_path):
    points = np.array(ELEMENTS["hex20"].vertices) / 2.0
    cells = [("hexahedron", [list(range(8))]), ("hexahedron20", [list(range(20))])]
    meshio.write(tmp_path / "a.vtu", meshio.Mesh(points, cells))
    with pytest.raises(InputError, match="one type, got hex8, hex20"):
        read_mesh(tmp_path / "a.vtu")


@pytest.mark.parametrize(
    "name",
    [
        "a.vtu",
        "a.vts",
        "a.vtkhdf",
        "a.vtk",
        "a.msh",
        "a.inp",
        "a.xdmf",
        "a.ply",
        "a.dat",
        "a.exo",
        "a.med",
        "a.feb",
        "a.nothing",
        "a",
    ],
)
@pytest.mark.parametrize("content", [b"", b"no mesh at all\n", b"\x00\xff" * 100])
def test_a_file_that_is_no_mesh_is_refused(name, content, tmp_path, capfd):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=rf"got {name}:|in {name}"):
        read_mesh(tmp_path / name)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("name", ["a.vtu", "a.vtk", "a.msh", "a.inp"])
@pytest.mark.parametrize("share", [0.3, 0.6, 0.9])
def test_a_file_cut_short_is_refused_or_whole(name, share, tmp_path):
    mesh = meshio.Mesh(HEX, [("hexahedron", [list(range(8))])], point_data={"HU": np.arange(8.0)})
    meshio.write(tmp_path / name, mesh)
    whole = (tmp_path / name).read_bytes()
    (tmp_path / name).write_bytes(whole[: int(len(whole) * share)])
    try:
        assert read_mesh(tmp_path / name).n_elements == 1
    except InputError as error:
        assert len(str(error).splitlines()) == 1


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(InputError, match="is no file"):
        read_mesh(tmp_path / "a.vtu")
