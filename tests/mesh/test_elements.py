"""Vertex order against VTK; shape functions as a basis."""

import numpy as np
import pytest

from gpubspline.errors import InputError
from gpubspline.mesh.elements import ELEMENTS, MESHABLE, find_element

vtk = pytest.importorskip("vtk")

VTK_CELLS = {
    "quad4": "vtkQuad",
    "quad8": "vtkQuadraticQuad",
    "quad9": "vtkBiQuadraticQuad",
    "hex8": "vtkHexahedron",
    "hex20": "vtkQuadraticHexahedron",
    "hex27": "vtkTriQuadraticHexahedron",
}


@pytest.mark.parametrize("name", MESHABLE)
def test_vertices_and_shape_functions_are_those_of_vtk(name):
    element, cell = ELEMENTS[name], getattr(vtk, VTK_CELLS[name])()
    assert cell.GetCellType() == element.vtk_type
    flat = [cell.GetParametricCoords()[i] for i in range(3 * cell.GetNumberOfPoints())]
    parametric = np.reshape(flat, (-1, 3))[:, : element.dimension]
    np.testing.assert_array_equal(parametric * 2, element.vertices)
    at = np.random.default_rng(1).random((20, element.dimension))
    for point, ours in zip(at, element.shape(at), strict=True):
        theirs = np.zeros(element.n_nodes)
        cell.InterpolateFunctions([*point, 0.0][:3], theirs)
        np.testing.assert_allclose(ours, theirs, atol=1e-14)


@pytest.mark.parametrize("name", ELEMENTS)
def test_shape_functions_are_one_at_their_own_vertex(name):
    element = ELEMENTS[name]
    np.testing.assert_allclose(element.shape(np.array(element.vertices) / 2), np.eye(element.n_nodes), atol=1e-14)


@pytest.mark.parametrize("name", ELEMENTS)
def test_gradient_is_the_derivative_of_the_shape_functions(name):
    element, step = ELEMENTS[name], 1e-6
    at = np.random.default_rng(2).random((5, element.dimension))
    for axis, gradient in enumerate(element.gradient(at)):
        move = step * np.eye(element.dimension)[axis]
        difference = (element.shape(at + move) - element.shape(at - move)) / (2 * step)
        np.testing.assert_allclose(gradient, difference, atol=1e-8)
        np.testing.assert_allclose(gradient.sum(axis=1), 0, atol=1e-13)


@pytest.mark.parametrize("name", MESHABLE)
def test_sides_lie_on_their_side_and_look_outward(name):
    element = ELEMENTS[name]
    vertices = np.array(element.vertices) / 2
    side_type = ELEMENTS[element.side_name]
    middle = np.full((1, side_type.dimension), 0.5)
    for side, numbers in element.sides.items():
        nodes = vertices[list(numbers)]
        axis, end = "uvw".index(side[0]), float(side[1])
        assert len(numbers) == side_type.n_nodes
        assert (nodes[:, axis] == end).all()
        np.testing.assert_allclose(side_type.shape(np.array(side_type.vertices) / 2) @ nodes, nodes, atol=1e-14)
        tangents = np.concatenate([gradient @ nodes for gradient in side_type.gradient(middle)])
        outward = np.cross(*tangents) if element.dimension == 3 else tangents[0] @ np.array([[0, -1], [1, 0]])
        assert outward[axis] * (2 * end - 1) > 0


def test_unknown_element_names_the_known():
    with pytest.raises(InputError, match=r"quad4.*hex27.*'tet4'"):
        find_element("tet4")
