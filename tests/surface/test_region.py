"""Sign and distance of surfaces on grids: formulas, VTK, SimpleITK."""

import numpy as np
import pytest

from gpubspline.errors import InputError
from gpubspline.surface.inside import winding_numbers
from gpubspline.surface.nearest import finder
from gpubspline.surface.read import read_surface
from gpubspline.surface.region import BAND, region_from_surface
from gpubspline.surface.surface import Surface


def centres(region):
    k, j, i = np.indices(region.mask.shape)
    return np.stack([i, j, k], axis=-1) @ region.affine[:3, :3].T + region.affine[:3, 3]


GRIDS = {
    "cubic": np.eye(3),
    "flat voxels": np.diag([0.8, 0.8, 2.0]),
    "tilted gantry": np.array([[0.8, 0, 0], [0, 0.76, 0], [0, -0.25, 1.7]]),
    "left-handed": np.diag([-1.0, 0.9, 1.1]),
}


@pytest.mark.parametrize("grid", GRIDS)
def test_boxes_on_grid_points_and_between_are_exact(shapes, grid, any_device):
    """The distance of a box has a formula; its faces, edges and corners pass through grid points."""
    affine = np.eye(4)
    affine[:3, :3] = GRIDS[grid]
    affine[:3, 3] = affine[:3, :3] @ [-12.0, -12.0, -12.0]
    size = np.array([8.0, 7.2, 6.8])
    box = shapes.box(size, -size / 2)
    region = region_from_surface(box, any_device, grid=(affine, (25, 24, 23)))
    off = np.abs(centres(region)) - size / 2
    exact = np.linalg.norm(np.maximum(off, 0), axis=-1) + np.minimum(off.max(axis=-1), 0)
    clear = np.abs(exact) > 1e-9
    np.testing.assert_array_equal(region.mask[clear], exact[clear] < 0)
    np.testing.assert_array_equal(region.distance_mm < 0, region.mask)
    spacing = np.linalg.norm(affine[:3, :3], axis=0).max()
    near = np.abs(exact) < BAND * spacing
    np.testing.assert_allclose(region.distance_mm[near], exact[near], atol=1.01e-3 * spacing)
    assert (np.abs(region.distance_mm) >= np.abs(exact) - 1e-4).all()  # an upper bound beyond


def test_grid_points_on_a_surface_are_counted_once(shapes):
    """Of boxes that fill space without gaps every grid point lies in exactly one, wherever the walls run."""
    affine, shape = np.eye(4), (9, 9, 9)
    total = np.zeros(shape, dtype=int)
    for low in np.ndindex(4, 4, 4):
        total += winding_numbers(shapes.box((2, 2, 2), 2 * np.array(low)), affine, shape)
    np.testing.assert_array_equal(total[:-1, :-1, :-1], 1)
    assert total.max() == 1


def test_rays_through_vertices_and_along_faces(shapes):
    """A rotated octahedron with vertices on grid lines, subdivided unevenly, against its formula."""
    points = 4.0 * np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
    signs = [(a, b, c) for a in (0, 1) for b in (2, 3) for c in (4, 5)]
    faces = [f if sum(n % 2 for n in f) % 2 == 0 else (f[0], f[2], f[1]) for f in signs]
    body = Surface(points, np.array(faces))
    assert body.volume_mm3 == pytest.approx(4 / 3 * 64)
    affine = np.eye(4)
    affine[:3, 3] = -6
    inside = winding_numbers(body, affine, (13, 13, 13)) > 0
    total = np.abs(np.indices((13, 13, 13)) - 6).sum(axis=0)
    np.testing.assert_array_equal(inside[total != 4], (total < 4)[total != 4])


def test_agrees_with_vtk_on_the_published_bone(data, device):
    """Sign everywhere, distance within the band to float32's rounding."""
    pyvista = pytest.importorskip("pyvista")
    bone = read_surface(data / "surfaces" / "bone.ply")
    region = region_from_surface(bone, device, spacing_mm=0.9)
    grid = pyvista.ImageData(dimensions=region.shape, spacing=region.spacing_mm, origin=region.affine[:3, 3])
    theirs = grid.compute_implicit_distance(pyvista.make_tri_mesh(bone.points, bone.triangles))["implicit_distance"]
    theirs = np.asarray(theirs).reshape(region.mask.shape)
    assert np.array_equal(region.mask, theirs < 0)
    near = np.abs(theirs) < BAND * 0.9
    np.testing.assert_allclose(region.distance_mm[near], theirs[near], atol=1.01e-3 * 0.9)
    assert (np.abs(region.distance_mm) > np.abs(theirs) - 1e-4).all()
    assert region.volume_mm3 == pytest.approx(bone.volume_mm3, rel=2e-4)


def test_agrees_with_the_distance_map_of_simpleitk(shapes, device):
    """SimpleITK measures from voxel to voxel: the same to a voxel's diagonal."""
    import SimpleITK as sitk

    region = region_from_surface(shapes.sphere(), device, spacing_mm=0.5)
    image = sitk.GetImageFromArray(region.mask.astype(np.uint8))
    image.SetSpacing([0.5, 0.5, 0.5])
    theirs = sitk.GetArrayFromImage(sitk.SignedMaurerDistanceMap(image, squaredDistance=False, useImageSpacing=True))
    near = np.abs(theirs) < 2
    assert np.abs(region.distance_mm[near] - theirs[near]).max() < 0.5 * np.sqrt(3)


def test_a_grid_of_its_own_lies_evenly_round_the_surface(shapes, device):
    region = region_from_surface(shapes.box((4.0, 3.3, 2.1), (7.0, -9.0, 50.0)), device, spacing_mm=0.25)
    ends = region.affine[:3, 3], region.affine[:3, :3] @ (np.array(region.mask.shape[::-1]) - 1) + region.affine[:3, 3]
    np.testing.assert_allclose(np.mean(ends, axis=0), [9.0, -7.35, 51.05])


def test_both_backends_give_one_region(shapes, both_devices):
    one, other = (region_from_surface(shapes.sphere(), device, spacing_mm=0.7) for device in both_devices)
    np.testing.assert_array_equal(one.distance_mm, other.distance_mm)


def test_a_cavity_is_outside(shapes, device):
    shell = shapes.join(shapes.sphere(), shapes.turn(shapes.sphere(6)))
    region = region_from_surface(shell, device, spacing_mm=0.4)
    assert region.volume_mm3 == pytest.approx(shell.volume_mm3, rel=2e-3)
    off = centres(region) - np.array([3.0, -7.0, 40.0])
    assert not region.mask[np.linalg.norm(off, axis=-1) < 5.9].any()


def test_the_nearest_triangle_is_the_nearest_of_all(shapes, any_device):
    """Against every triangle by brute force, near and far, in many bins, and with triangles far larger than these."""
    rng = np.random.default_rng(2)
    for body in (shapes.sphere(n=8), shapes.sphere(n=40), shapes.box((40, 3, 2))):
        points = body.points.mean(axis=0) + rng.normal(size=(500, 3)) * rng.choice([2, 10, 60], (500, 1))
        distance, triangle = finder(body, any_device).nearest(points)
        every = np.array([brute(points, corners) for corners in body.corners])
        np.testing.assert_allclose(distance, every.min(axis=0), rtol=1e-4, atol=1e-4)
        np.testing.assert_allclose(every[triangle, np.arange(500)], every.min(axis=0), rtol=1e-4, atol=1e-4)


def brute(points, corners):
    """Least distance of points from a triangle, by the minimum of a quadratic over it in barycentric coordinates."""
    a, b, c = corners
    best = np.full(len(points), np.inf)
    for p, q in ((a, b), (b, c), (c, a)):
        t = np.clip((points - p) @ (q - p) / ((q - p) @ (q - p)), 0, 1)
        best = np.minimum(best, np.linalg.norm(points - p - t[:, None] * (q - p), axis=1))
    frame = np.stack([b - a, c - a], axis=1)
    uv = np.linalg.lstsq(frame, (points - a).T, rcond=None)[0].T
    foot = np.linalg.norm(points - a - uv @ frame.T, axis=1)
    return np.where((uv >= 0).all(axis=1) & (uv.sum(axis=1) <= 1), np.minimum(best, foot), best)


def test_grids_that_hold_nothing_or_too_much_are_refused(shapes, device):
    sheet = shapes.box((40, 40, 0.01))
    affine = np.eye(4)
    affine[:3, 3] = 0.25
    with pytest.raises(InputError, match=r"40x40x0\.01 mm that holds none"):
        region_from_surface(sheet, device, grid=(affine, (5, 40, 40)))
    with pytest.raises(InputError, match="larger elements"):
        region_from_surface(shapes.sphere(), device, spacing_mm=1e-3)
    for spacing in (0.0, -1.0, np.nan):
        with pytest.raises(InputError, match="more than 0 mm"):
            region_from_surface(shapes.sphere(), device, spacing_mm=spacing)
