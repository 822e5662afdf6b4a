"""Surfaces as STL and PLY: read by VTK and meshio, closed, facing outward, where the mesh has them."""

import warnings
from dataclasses import replace

import meshio
import numpy as np
import pytest

from gpubspline.errors import GpubsplineWarning
from gpubspline.export import write
from gpubspline.mesh.mesh import Mesh

pyvista = pytest.importorskip("pyvista")


def written(mesh, path, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", GpubsplineWarning)
        write(mesh, path, **options)
    return pyvista.read(path)


@pytest.mark.parametrize("extension", [".stl", ".ply"])
@pytest.mark.parametrize("order", [1, 2])
def test_the_surface_of_a_femur_is_closed_and_faces_outward(extension, order, femur, femur20, tmp_path):
    """Its volume is the mesh's but for what triangles cut off curved and warped faces."""
    mesh = femur if order == 1 else femur20
    surface = written(mesh, tmp_path / f"femur{extension}").triangulate().clean()
    assert surface.is_manifold and surface.n_open_edges == 0
    assert surface.volume == pytest.approx(mesh.volume_mm3, rel=0.01)
    centres, normals = surface.cell_centers().points, surface.compute_normals(auto_orient_normals=False).cell_normals
    along = np.einsum("ij,ij->i", centres - mesh.points.mean(axis=0), normals)
    assert (along > 0).mean() > 0.9


def test_stl_has_two_triangles_for_a_face_and_its_unit(femur, tmp_path):
    written(femur, tmp_path / "femur.stl", units="m-N-Pa")
    back = meshio.read(tmp_path / "femur.stl")
    assert len(back.cells[0].data) == 2 * len(femur.boundary())
    own = femur.points[np.unique(femur.boundary())]
    np.testing.assert_allclose(np.sort(back.points.max(axis=0)), np.sort(1e-3 * own.max(axis=0)), rtol=1e-6)
    assert (tmp_path / "femur.stl").read_bytes()[:80].strip() == b"gpubspline, m"


def test_ply_keeps_the_nodal_fields_of_the_surface(femur, tmp_path):
    femur = replace(femur, element_sets={})
    with pytest.warns(GpubsplineWarning, match=r"\.ply holds no field material: left out"):
        write(femur, tmp_path / "femur.ply", load="stance")
    nodes = np.unique(femur.boundary())
    back = meshio.read(tmp_path / "femur.ply")
    np.testing.assert_array_equal(back.points, femur.points[nodes])
    for name, values in femur.fields.items():
        there = name.replace("density", "density_apparent")  # files tell the kind
        np.testing.assert_array_equal(back.point_data[there], values[nodes])
    assert back.point_data["force_n_z"].sum() == pytest.approx(-328)
    (quads,) = (block.data for block in back.cells)
    np.testing.assert_array_equal(nodes[quads], femur.boundary())
    assert b"comment Units: mm, N, MPa" in (tmp_path / "femur.ply").read_bytes()


@pytest.mark.parametrize("element_type", ["quad4", "quad8", "quad9"])
@pytest.mark.parametrize("extension", [".stl", ".ply"])
def test_quads_are_their_own_surface(element_type, extension, tmp_path):
    """A flat square of four quads: its area."""
    order = 1 if element_type == "quad4" else 2
    at = np.linspace(0, 2, 2 * order + 1)
    x, y = (each.ravel(order="F") for each in np.meshgrid(at, at, indexing="ij"))
    points = np.stack([x, y, 0 * x], axis=1)
    if element_type == "quad8":
        points = points[~((np.round(2 * x) % 2 == 1) & (np.round(2 * y) % 2 == 1))]
    surface = written(Mesh(points, element_type, structure=(3, 3)), tmp_path / f"square{extension}")
    assert surface.triangulate().area == pytest.approx(4)
