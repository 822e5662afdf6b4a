"""Structured numbering, boundary, sets, volume and area; the way into meshio and PyVista."""

import numpy as np
import pytest

from gpubspline.errors import InputError
from gpubspline.mesh import mesh as mesh_module
from gpubspline.mesh import structure
from gpubspline.mesh.elements import ELEMENTS, MESHABLE
from gpubspline.mesh.mesh import Mesh

COUNTS = (4, 3, 5)


def lattice_mesh(element_type, counts=COUNTS, place=None):
    """A structured mesh of the unit box, its points moved by ``place``."""
    element = ELEMENTS[element_type]
    counts = counts[: element.dimension]
    axes = [np.linspace(0, 1, n) for n in structure.lattice_counts(element, counts)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, element.dimension, order="F")
    kept = structure.has_node(element, counts)
    grid = grid if kept is None else grid[kept]
    points = np.zeros((len(grid), 3))
    points[:, : element.dimension] = grid
    return Mesh(points if place is None else place(points), element_type, structure=counts)


def twisted(p):
    """Smooth and one to one on the unit box."""
    x, y, z = p.T
    return np.stack([x + 0.1 * y * y * z, y + 0.1 * x * z, z * (1 + 0.2 * x)], axis=1)


@pytest.mark.parametrize("element_type", MESHABLE)
def test_structured_numbering_puts_every_vertex_in_its_place(element_type):
    mesh = lattice_mesh(element_type)
    element = mesh.element
    assert mesh.n_elements == np.prod([n - 1 for n in mesh.structure])
    assert np.unique(mesh.cells).size == mesh.n_nodes
    size = 1 / (np.array(mesh.structure) - 1)
    first = np.stack(np.unravel_index(np.arange(mesh.n_elements), structure.element_counts(mesh.structure), order="F"))
    expected = (first.T[:, None, :] + np.array(element.vertices) / 2) * size
    np.testing.assert_allclose(mesh.points[mesh.cells][..., : element.dimension], expected, atol=1e-15)


@pytest.mark.parametrize("element_type", MESHABLE)
def test_boundary_is_the_same_structured_and_explicit(element_type):
    mesh = lattice_mesh(element_type, place=twisted)
    explicit = Mesh(mesh.points, element_type, connectivity=mesh.cells)
    ours, theirs = mesh.boundary(), explicit.boundary()
    assert sorted(map(tuple, ours.tolist())) == sorted(map(tuple, theirs.tolist()))
    counts = structure.element_counts(mesh.structure)
    assert len(ours) == sum(2 * np.prod(counts) // n for n in counts)


@pytest.mark.parametrize("element_type", MESHABLE)
def test_a_side_holds_exactly_the_nodes_that_lie_on_it(element_type):
    mesh = lattice_mesh(element_type)
    for side in mesh.element.sides:
        on_side = np.flatnonzero(mesh.points[:, "uvw".index(side[0])] == float(side[1]))
        np.testing.assert_array_equal(np.unique(mesh.boundary(side)), on_side)
        np.testing.assert_array_equal(mesh.boundary_nodes(side), on_side)
    on_any = np.flatnonzero(np.isin(mesh.points[:, : mesh.element.dimension], (0, 1)).any(axis=1))
    for each in (mesh, Mesh(mesh.points, element_type, connectivity=mesh.cells)):
        np.testing.assert_array_equal(each.boundary_nodes(), on_any)


@pytest.mark.parametrize("element_type", [name for name in MESHABLE if name.startswith("hex")])
def test_volume_is_the_sum_of_the_elements_by_gauss(element_type):
    """Against the integral over each element, which shares no code with the surface integral."""
    mesh = lattice_mesh(element_type, place=twisted)
    at, weights = mesh.element.gauss()
    jacobian = np.einsum("dgk,mkc->mgdc", mesh.element.gradient(at), mesh.points[mesh.cells])
    assert mesh.volume_mm3 == pytest.approx(float((np.linalg.det(jacobian) @ weights).sum()), rel=1e-13)


def test_volume_of_a_sheared_box_and_of_a_ball():
    box = lattice_mesh("hex8", place=lambda p: p @ np.array([[2.0, 0, 0], [0.7, 3, 0], [-1, 0.4, 5]]) + 1000)
    assert box.volume_mm3 == pytest.approx(30, rel=1e-12)
    for element_type, tolerance in (("hex8", 0.04), ("hex20", 2e-3), ("hex27", 2e-4)):
        ball = lattice_mesh(element_type, (7, 7, 7), place=ball_of_box)
        assert ball.volume_mm3 == pytest.approx(4 / 3 * np.pi, rel=tolerance), element_type
        assert ball.area_mm2 == pytest.approx(4 * np.pi, rel=tolerance), element_type


def ball_of_box(p):
    """Unit box to unit ball: each cube of half side s goes to the sphere of radius s."""
    q = 2 * p - 1
    size, length = np.abs(q).max(axis=1), np.linalg.norm(q, axis=1)
    return q * (size / np.where(length > 0, length, 1))[:, None]


@pytest.mark.parametrize("element_type", [name for name in MESHABLE if name.startswith("quad")])
def test_area_of_flat_quads_is_exact(element_type):
    mesh = lattice_mesh(element_type, place=lambda p: p @ np.array([[2.0, 0, 1], [0.5, 3, 0.0], [0, 0, 1]]))
    assert mesh.area_mm2 == pytest.approx(np.linalg.norm(np.cross([2, 0, 1], [0.5, 3, 0])), rel=1e-13)


def test_volume_of_quads_is_refused():
    with pytest.raises(InputError, match="area_mm2"):
        _ = lattice_mesh("quad4").volume_mm3


def test_connectivity_is_built_once_and_only_when_asked_for():
    mesh = lattice_mesh("hex20")
    _ = mesh.volume_mm3, mesh.boundary(), mesh.n_elements
    assert "cells" not in vars(mesh)
    assert mesh.cells is mesh.cells


@pytest.mark.parametrize("element_type", MESHABLE)
@pytest.mark.parametrize("counts", [(4, 3, 5), (2, 2, 9), (6, 7, 3)])
@pytest.mark.parametrize("most", [1, 4, 5, 12, 25, 1000])
def test_cells_in_blocks_are_all_cells_in_order(element_type, counts, most, monkeypatch):
    """Blocks of less than a row, of some rows with a rest, of some layers with a rest, of everything."""
    monkeypatch.setattr(structure, "_BLOCK", most)
    monkeypatch.setattr(mesh_module, "_PART", most)
    mesh = lattice_mesh(element_type, counts)
    for given in (mesh, Mesh(mesh.points, element_type, connectivity=mesh.cells)):
        blocks = [(first, cells.copy()) for first, cells in given.cell_blocks()]
        assert [first for first, _ in blocks] == np.cumsum([0, *(len(cells) for _, cells in blocks)])[:-1].tolist()
        np.testing.assert_array_equal(np.concatenate([cells for _, cells in blocks]), mesh.cells)


def test_points_are_planes_without_a_copy():
    planes = np.random.default_rng(0).random((3, 8), dtype=np.float32)
    mesh = Mesh(planes.T, "hex8", structure=(2, 2, 2))
    assert mesh.planes.flags.c_contiguous
    assert np.shares_memory(mesh.points, planes)


def test_with_fields_adds_and_replaces():
    mesh = lattice_mesh("quad4").with_fields({"HU": np.zeros(12)})
    more = mesh.with_fields({"HU": np.ones(12), "nu": np.ones(12)}).with_cell_fields({"material": np.ones(6)})
    assert set(more.fields) == {"HU", "nu"}
    assert more.fields["HU"].sum() == 12
    assert mesh.fields["HU"].sum() == 0
    assert set(more.cell_fields) == {"material"}


BAD = {
    "shape": (dict(points=np.zeros((8, 2)), structure=(2, 2, 2)), r"\(n, 3\)"),
    "neither": (dict(points=np.zeros((8, 3))), "either a structure or connectivity"),
    "flat": (dict(points=np.zeros((4, 3)), structure=(2, 2)), "3 counts of at least 2"),
    "count": (dict(points=np.zeros((9, 3)), structure=(2, 2, 2)), "expected 8 nodes"),
    "cells": (dict(points=np.zeros((8, 3)), connectivity=np.zeros((1, 4))), r"\(m, 8\)"),
    "number": (dict(points=np.zeros((8, 3)), connectivity=np.full((1, 8), 8)), "from 0 to 7, got 8 to 8"),
    "field": (dict(points=np.zeros((8, 3)), structure=(2, 2, 2), fields={"HU": np.zeros(7)}), "expected 8 values"),
    "set": (dict(points=np.zeros((8, 3)), structure=(2, 2, 2), element_sets={"body": np.array([1])}), "set body"),
}


@pytest.mark.parametrize("name", BAD)
def test_what_does_not_fit_is_refused(name):
    given, message = BAD[name]
    with pytest.raises(InputError, match=message):
        Mesh(**{"element_type": "hex8", **given})


def test_a_side_that_is_not_there_is_refused():
    with pytest.raises(InputError, match="u0, u1, v0, v1, got 'w0'"):
        lattice_mesh("quad4").boundary("w0")
    explicit = Mesh(np.eye(8, 3), "hex8", connectivity=np.arange(8)[None])
    with pytest.raises(InputError, match="explicit cells"):
        explicit.boundary("u0")


@pytest.mark.parametrize("element_type", MESHABLE)
def test_meshio_and_pyvista_see_the_same_mesh(element_type):
    pytest.importorskip("pyvista")
    mesh = lattice_mesh(element_type, place=twisted)
    mesh = mesh.with_fields({"HU": np.arange(mesh.n_nodes, dtype=np.float32)})
    mesh = mesh.with_cell_fields({"material": np.arange(mesh.n_elements, dtype=np.int32)})
    grid, other = mesh.to_pyvista(), mesh.to_meshio()
    np.testing.assert_array_equal(grid.points, mesh.points)
    np.testing.assert_array_equal(grid.point_data["HU"], mesh.fields["HU"])
    np.testing.assert_array_equal(grid.cell_data["material"], mesh.cell_fields["material"])
    assert (grid.celltypes == mesh.element.vtk_type).all()
    np.testing.assert_array_equal(other.cells[0].data, mesh.cells)
    np.testing.assert_array_equal(other.cell_data["material"][0], mesh.cell_fields["material"])
    if mesh.element.dimension == 3 and mesh.element.order == 1:
        assert grid.compute_cell_sizes().cell_data["Volume"].sum() == pytest.approx(mesh.volume_mm3, rel=1e-3)


@pytest.mark.parametrize(("element_type", "skfem_type"), [("hex8", "MeshHex"), ("quad4", "MeshQuad")])
def test_scikit_fem_measures_the_same(element_type, skfem_type):
    """scikit-fem integrates 1 over our cells, brought into its order by meshio's reader."""
    skfem = pytest.importorskip("skfem")
    from skfem.io import from_meshio

    mesh = lattice_mesh(element_type, place=twisted if element_type == "hex8" else None)
    given = mesh.to_meshio()
    given.point_sets, given.cell_sets = {}, {}
    if element_type == "quad4":
        given.points = given.points[:, :2]
    other = from_meshio(given)
    assert type(other).__name__.startswith(skfem_type)
    element = skfem.ElementHex1() if element_type == "hex8" else skfem.ElementQuad1()
    ones = skfem.Functional(lambda w: 1.0 + 0 * w.x[0]).assemble(skfem.Basis(other, element, intorder=4))
    assert ones == pytest.approx(mesh.volume_mm3 if element_type == "hex8" else mesh.area_mm2, rel=1e-12)


@pytest.mark.parametrize("counts", [(4, 3, 5), (2, 2, 2), (2, 5, 3), (6, 2, 2), (2, 2, 7)])
@pytest.mark.parametrize("element_type", MESHABLE)
def test_structure_is_known_from_the_numbering(element_type, counts):
    """Of any counts; not where an element, a vertex, a node or the order is another."""
    mesh = lattice_mesh(element_type, counts)
    element, cells, n = mesh.element, mesh.cells, mesh.n_nodes
    assert structure.recognise(element, cells, n) == mesh.structure
    assert structure.recognise(element, cells, n + 1) is None
    assert structure.recognise(element, cells[:0], 0) is None
    if len(cells) > 1:
        assert structure.recognise(element, cells[::-1], n) is None
        assert structure.recognise(element, cells[:-1], n) is None
    turned = cells.copy()
    turned[-1] = np.roll(turned[-1], 1)
    assert structure.recognise(element, turned, n) is None
    assert structure.recognise(element, (cells + 1) % n, n) is None
