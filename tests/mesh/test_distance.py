"""Distance of a mesh's surface from a region whose boundary is known."""

import numpy as np
import pytest

from gpubspline.ct.region import Region
from gpubspline.mesh import structure
from gpubspline.mesh.distance import sample_distance, surface_distance, surface_points
from gpubspline.mesh.elements import ELEMENTS
from gpubspline.mesh.mesh import Mesh

OBLIQUE = np.array([[0.9, -0.2, 0.1, -30], [0.3, 1.1, 0.25, 12], [0.0, 0.2, 1.7, 400], [0, 0, 0, 1]])
"""Oblique, sheared, and left-handed once its first column is turned."""


def place(affine, shape):
    k, j, i = np.meshgrid(*[np.arange(n) for n in shape], indexing="ij")
    return np.stack([i, j, k], axis=-1) @ affine[:3, :3].T + affine[:3, 3]


def ball_region(radius, affine=OBLIQUE, shape=(30, 44, 50)):
    points = place(affine, shape)
    distance = np.linalg.norm(points - points.reshape(-1, 3).mean(axis=0), axis=-1) - radius
    return Region(distance < 0, distance.astype(np.float32), affine), points.reshape(-1, 3).mean(axis=0)


def ball_mesh(radius, centre, element_type="hex27", n=9):
    element = ELEMENTS[element_type]
    counts = (n,) * 3
    axes = [np.linspace(-1, 1, m) for m in structure.lattice_counts(element, counts)]
    cube = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3, order="F")
    kept = structure.has_node(element, counts)
    cube = cube if kept is None else cube[kept]
    length = np.linalg.norm(cube, axis=1)
    points = cube * (np.abs(cube).max(axis=1) / np.where(length > 0, length, 1))[:, None] * radius + centre
    return Mesh(points, element_type, structure=counts)


@pytest.mark.parametrize("turn", [1, -1])
def test_a_ball_of_another_radius_is_off_by_the_difference(turn, device):
    region, centre = ball_region(12.0, OBLIQUE @ np.diag([turn, 1.0, 1, 1]))
    found = surface_distance(ball_mesh(11.0, centre), region, device)
    assert found.mean == pytest.approx(1.0, abs=0.06)  # the trilinear error of a sphere over voxels of 1 to 2 mm
    assert found.max < 1.15
    assert found.mean <= found.p95 <= found.max
    assert found.to_dict() == {"mean": found.mean, "p95": found.p95, "max": found.max}


def test_points_between_nodes_count(device):
    """Nodes on the sphere, chords inside it: the farthest point is the sagitta away."""
    region, centre = ball_region(12.0)
    coarse = ball_mesh(12.0, centre, "hex8", n=3)
    at_nodes = sample_distance(region, coarse.points[np.unique(coarse.boundary())], device)
    assert np.abs(at_nodes).max() < 0.15
    assert surface_distance(coarse, region, device).max > 1.4


def test_surface_points_weigh_the_area(device64):
    mesh = ball_mesh(10.0, np.zeros(3))
    points, weights = surface_points(mesh)
    assert weights.sum() == pytest.approx(4 * np.pi * 100, rel=2e-3)
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), 10, atol=0.05)
    square = Mesh(np.array([[0.0, 0, 0], [3, 0, 0], [0, 2, 0], [3, 2, 0]]), "quad4", structure=(2, 2))
    assert surface_points(square)[1].sum() == pytest.approx(10)


def test_trilinear_distance_against_scipy(device64):
    from scipy.ndimage import map_coordinates

    region, centre = ball_region(9.0)
    points = centre + np.random.default_rng(0).normal(size=(300, 3)) * 6
    index = (points - OBLIQUE[:3, 3]) @ np.linalg.inv(OBLIQUE[:3, :3]).T
    expected = map_coordinates(region.distance_mm.astype(float), index.T[::-1], order=1, mode="nearest")
    np.testing.assert_allclose(sample_distance(region, points, device64), expected, atol=1e-9)


def cylinder(shape=(12, 40, 40), radius=14.0):
    """A cylinder along k that the scan cuts at both ends."""
    affine = np.diag([1.0, 1.0, 3.0, 1.0])
    points = place(affine, shape)
    distance = np.hypot(points[..., 0] - 19.5, points[..., 1] - 19.5) - radius
    return Region(distance < 0, distance.astype(np.float32), affine)


def box_in_cylinder(first_mm, last_mm):
    half = 14.0 / np.sqrt(2)
    low, high = 19.5 - half, 19.5 + half
    axes = [np.linspace(low, high, 5), np.linspace(low, high, 5), np.linspace(first_mm, last_mm, 4)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3, order="F")
    return Mesh(points, "hex8", structure=(5, 5, 4))


def test_the_cut_ends_of_a_scan_are_boundary(device64):
    whole = box_in_cylinder(0, 33)
    assert surface_distance(whole, cylinder(), device64, side="w0").max < 0.02  # trilinear distance of a circle
    short = box_in_cylinder(6, 33)
    found = surface_distance(short, cylinder(), device64, side="w0")
    assert found.max == pytest.approx(6, abs=1e-6)  # from the cut plane; the cylinder's side is nearer at the corners
    sides = surface_distance(whole, cylinder(), device64)
    assert sides.max == pytest.approx(14 - 14 / np.sqrt(2), abs=0.1)  # middle of a side to the circle


@pytest.mark.parametrize("n_k", [1, 12])
def test_a_slice_is_not_cut_along_its_normal(n_k, device64):
    axes = [np.linspace(12.5, 26.5, 8)] * 2
    flat = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2, order="F")
    mesh = Mesh(np.column_stack([flat, np.zeros(64)]), "quad4", structure=(8, 8))
    found = surface_distance(mesh, cylinder((n_k, 40, 40)), device64)
    assert found.max == pytest.approx(7, abs=0.05)
    assert found.mean > 5


def test_outside_the_region_the_border_does_not_help(device64):
    """A mesh that sticks out of the region by 3 mm is 3 mm off, however near the border it is."""
    affine, shape = np.eye(4), (20, 20, 20)
    distance = (place(affine, shape)[..., 0] - 10.0).astype(np.float32)
    region = Region(distance < 0, distance, affine)
    axes = [np.linspace(2, 13, 3), np.linspace(0, 19, 3), np.linspace(0, 19, 3)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3, order="F")
    mesh = Mesh(points, "hex8", structure=(3, 3, 3))
    assert surface_distance(mesh, region, device64, side="u1").mean == pytest.approx(3, abs=1e-6)
    assert surface_distance(mesh, region, device64, side="u0").max == pytest.approx(2, abs=1e-6)
