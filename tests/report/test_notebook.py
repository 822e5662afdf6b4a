"""What notebooks show: slices as radiology has them, pictures that can be saved, and nothing that is too much."""

import base64
import re
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

import gpubspline as gb
from gpubspline.ct.volume import Volume
from gpubspline.errors import InputError
from gpubspline.mesh.mesh import Mesh
from gpubspline.report import notebook


def cube(n: int = 3) -> Mesh:
    grid = np.meshgrid(*(np.arange(float(n)),) * 3, indexing="ij")
    points = np.stack([a.ravel(order="F") for a in grid], axis=1)
    return Mesh(points, "hex8", structure=(n,) * 3, fields={"E_MPa": 1 + points[:, 0], "HU": points[:, 2]})


def pictures(html: str) -> list[np.ndarray]:
    found = re.findall(r"data:image/png;base64,([^\"]+)", html)
    return [np.asarray(imread(BytesIO(base64.b64decode(text)))) for text in found]


def test_slices_of_a_volume_lie_as_radiology_has_them() -> None:
    hu = np.zeros((8, 9, 10), dtype=np.int16)
    hu[4, :, :] = 1  # the middle slices
    hu[4, :3, :3] = 1000  # anterior (low j), left (low i: i runs from left to right)
    affine = np.diag([-1.0, 1.0, 2.0, 1.0])
    axial, coronal, sagittal = pictures(Volume(hu, affine)._repr_html_())
    assert axial[0, -1, 0] > 0.9 and axial[-1, 0, 0] < 0.1
    assert axial.shape[:2] == (9, 10) and coronal.shape[:2] == (8, 10) and sagittal.shape[:2] == (8, 9)


def test_a_mesh_is_told_of_and_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    html = cube()._repr_html_()
    assert "8 hex8" in html and "<th>HU</th><td>0 to 2</td>" in html and len(pictures(html)) == 1
    monkeypatch.setattr(notebook, "DRAWN_ELEMENTS", 7)
    assert "8 hex8" in cube()._repr_html_() and not pictures(cube()._repr_html_())
    bare = Mesh(cube().points, "hex8", structure=(3, 3, 3))
    assert "27" in bare._repr_html_() and not pictures(bare._repr_html_())


def test_a_picture_is_saved_as_it_is_shown(tmp_path: Path) -> None:
    picture = cube().plot("E", clip="x", edges=True)
    picture.save(tmp_path / "cube.png")
    assert (tmp_path / "cube.png").read_bytes() == picture._repr_png_()
    assert picture._repr_png_() != cube().plot("E", clip="x", edges=False)._repr_png_()
    assert picture._repr_png_() != cube().plot("E", clip="z", edges=True)._repr_png_()
    with pytest.raises(InputError, match=r"field of the mesh \(E_MPa, HU\), got 'stress'"):
        cube().plot("stress")
    with pytest.raises(InputError, match="across x, y or z, got 'w'"):
        cube().plot(clip="w")
    with pytest.raises(InputError, match=r"ends in \.png"):
        picture.save(tmp_path / "cube.jpg")


@pytest.mark.parametrize("element_type", ["hex8", "hex20", "hex27"])
def test_pyvista_and_back(element_type: str) -> None:
    pytest.importorskip("pyvista")
    patch = gb.bezier(
        np.concatenate(
            [np.stack(np.meshgrid(*[[0.0, 1.0]] * 3, indexing="ij"), axis=-1), np.ones((2, 2, 2, 1))], axis=-1
        )
    )
    mesh = gb.sample(patch, (3, 4, 5), element_type=element_type)
    mesh = mesh.with_cell_fields({"number": np.arange(mesh.n_elements)})
    back = gb.from_pyvista(mesh.to_pyvista())
    np.testing.assert_array_equal(back.points, mesh.points)
    np.testing.assert_array_equal(back.cells, mesh.cells)
    assert back.element_type == element_type and back.volume_mm3 == pytest.approx(1.0)
    np.testing.assert_array_equal(back.fields["HU"], mesh.fields["HU"])
    np.testing.assert_array_equal(back.cell_fields["number"], mesh.cell_fields["number"])


def test_other_grids_of_pyvista() -> None:
    pyvista = pytest.importorskip("pyvista")
    image = pyvista.ImageData(dimensions=(3, 4, 5)).cast_to_structured_grid()
    image.point_data["v"] = np.arange(180.0).reshape(60, 3)
    mesh = gb.from_pyvista(image)
    assert (mesh.element_type, mesh.n_elements, list(mesh.fields)) == ("hex8", 24, ["v_0", "v_1", "v_2"])
    assert mesh.volume_mm3 == pytest.approx(24.0)
    assert gb.from_pyvista(pyvista.Plane(i_resolution=3, j_resolution=2)).element_type == "quad4"
    with pytest.raises(InputError, match="expected hexes or quads"):
        gb.from_pyvista(pyvista.Sphere())
    with pytest.raises(InputError, match="a grid of PyVista, got list"):
        gb.from_pyvista([1])
