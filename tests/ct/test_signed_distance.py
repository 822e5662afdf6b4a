"""The signed distance against exact distances of planes, spheres and ellipsoids on grids of every kind."""

import numpy as np
import pytest
from scipy.ndimage import map_coordinates
from scipy.special import erf

from gpubspline.ct.signed_distance import find_crossings, signed_distance

SHAPE = (30, 34, 36)
GRIDS = {
    "cubic": np.eye(3),
    "flat voxels": np.diag([0.8, 0.8, 2.0]),
    "tilted gantry": np.array([[0.8, 0, 0], [0, 0.76, 0], [0, -0.25, 1.7]]),
    "left-handed": np.diag([-1.0, 0.9, 1.1]),
}


def affine_of(steps):
    affine = np.eye(4)
    affine[:3, :3] = steps
    affine[:3, 3] = 10, -20, 5
    return affine


def centres(affine):
    k, j, i = np.indices(SHAPE)
    return np.stack([i, j, k], axis=-1) @ affine[:3, :3].T + affine[:3, 3]


def middle(affine):
    return affine[:3, :3] @ [17.3, 16.6, 14.7] + affine[:3, 3]


def plane(points, origin):
    normal = np.array([0.9, 0.3, 0.2])
    return (points - origin) @ (normal / np.linalg.norm(normal))


def sphere(points, origin):
    return np.linalg.norm(points - origin, axis=-1) - 9.0


BODIES = {"plane": plane, "sphere": sphere}


@pytest.mark.parametrize("grid", GRIDS)
@pytest.mark.parametrize("body", BODIES)
def test_distance_is_exact_near_the_boundary(grid, body):
    """Within two layers planes to 0.02 voxels, spheres of 9 mm to 0.1; beyond three the nearest foot is approximate,
    the more so on sheared grids.
    """
    affine = affine_of(GRIDS[grid])
    exact = BODIES[body](centres(affine), middle(affine))
    inside = exact < 0
    distance = signed_distance(inside, exact.astype(np.float32), affine)
    assert distance.dtype == np.float32
    np.testing.assert_array_equal(distance < 0, inside)
    voxel = np.linalg.norm(affine[:3, :3], axis=0).max()
    error = np.abs(distance - exact) / voxel
    assert error[np.abs(exact) < 1.5 * voxel].max() < (0.02 if body == "plane" else 0.1)
    assert error[np.abs(exact) < 4 * voxel].max() < (0.5 if grid == "tilted gantry" else 0.3)


@pytest.mark.parametrize("grid", GRIDS)
def test_interpolation_along_a_grid_edge_returns_the_crossing_of_a_plane(grid):
    affine = affine_of(GRIDS[grid])
    exact = plane(centres(affine), middle(affine))
    distance = signed_distance(exact < 0, exact.astype(np.float32), affine).reshape(-1)
    for edge in find_crossings(exact < 0, exact):
        a, b = distance[edge.near], distance[edge.far]
        np.testing.assert_allclose(a / (a - b), edge.fraction, atol=2e-3)


def test_blurred_edges_are_found_to_a_twentieth_of_a_voxel():
    """HU through a scanner's blur: the iso-level is sub-voxel, so the surface's distance is zero on it."""
    affine = affine_of(GRIDS["cubic"])
    exact = sphere(centres(affine), middle(affine))
    hu = -1000 + 540 * (1 - erf(exact / (np.sqrt(2) * 0.7)))
    level = (-460 - hu).astype(np.float32)
    distance = signed_distance(level < 0, level, affine)
    directions = np.random.default_rng(0).normal(size=(2000, 3))
    surface = middle(affine) + 9 * directions / np.linalg.norm(directions, axis=1)[:, None]
    index = np.linalg.solve(affine[:3, :3], (surface - affine[:3, 3]).T)
    on_surface = map_coordinates(distance, index[::-1], order=1)
    assert np.abs(on_surface).max() < 0.08
    assert np.abs(on_surface.mean()) < 0.02 + 1 / (6 * 9)  # chords of a sphere lie 1 / 6 R inside it
    assert on_surface.std() < 0.025


def test_where_level_and_mask_disagree_the_boundary_is_halfway():
    mask = np.zeros((1, 1, 8), dtype=bool)
    mask[..., 3:] = True
    distance = signed_distance(mask, np.full(mask.shape, 7.0), np.diag([2.0, 1, 1, 1]))
    np.testing.assert_allclose(distance[0, 0], 2 * (2.5 - np.arange(8)), atol=1e-5)


def test_no_boundary_is_invented_at_the_border():
    mask = np.zeros((4, 5, 20), dtype=bool)
    mask[..., :12] = True
    level = np.broadcast_to(np.arange(20) - 11.25, mask.shape)
    distance = signed_distance(mask, level, np.eye(4))
    np.testing.assert_allclose(distance, level, atol=1e-3)
    assert (signed_distance(np.ones((3, 4, 5), bool), np.zeros((3, 4, 5)), np.eye(4)) < -7).all()


def test_a_sheet_of_one_voxel_keeps_its_thickness():
    mask = np.zeros((9, 12, 12), dtype=bool)
    mask[4] = True
    level = np.where(mask, -0.5, 0.5)
    distance = signed_distance(mask, level, np.eye(4))
    np.testing.assert_allclose(distance[2:7, 6, 6], [1.5, 0.5, -0.5, 0.5, 1.5], atol=1e-3)


def test_far_from_the_mask_the_distance_is_an_upper_bound():
    k, j, i = np.indices((40, 40, 60))
    exact = np.sqrt((k - 10.0) ** 2 + (j - 12.0) ** 2 + (i - 9.0) ** 2) - 5
    distance = signed_distance(exact < 0, exact, np.eye(4))
    far = exact > 15
    assert (distance[far] > exact[far] - 0.3).all()
    assert (distance[far] < 1.8 * exact[far] + 1).all()
