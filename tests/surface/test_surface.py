"""Checks of surfaces: what is closed, which way it faces, where it passes through itself."""

import warnings

import numpy as np
import pytest

from gpubspline.errors import GpubsplineWarning, InputError
from gpubspline.surface.check import closed
from gpubspline.surface.crossings import check_apart, self_crossings
from gpubspline.surface.surface import Surface


def kept(surface, name="the surface"):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return closed(surface, name)


def test_volume_area_and_euler_of_a_box_and_a_sphere(shapes):
    box = shapes.box()
    assert (box.volume_mm3, box.area_mm2, box.euler) == (pytest.approx(24), pytest.approx(52), 2)
    fine, coarse = (shapes.sphere(n=n) for n in (48, 24))
    errors = [4 / 3 * np.pi * 1000 - body.volume_mm3 for body in (fine, coarse)]
    assert errors[0] > 0 and errors[1] / errors[0] == pytest.approx(4, rel=0.02)  # second order


def test_an_outward_surface_comes_back_as_it_is(shapes):
    body = kept(shapes.sphere())
    assert body.volume_mm3 == pytest.approx(shapes.sphere().volume_mm3) and body.euler == 2


def test_an_inside_out_surface_is_turned_with_a_word(shapes):
    with pytest.warns(GpubsplineWarning, match="knee is inside out: turned"):
        body = closed(shapes.turn(shapes.box()), "knee")
    assert body.volume_mm3 == pytest.approx(24)


def test_single_triangles_that_face_the_wrong_way_are_turned(shapes):
    body = shapes.sphere()
    triangles = body.triangles.copy()
    triangles[40:90] = triangles[40:90, ::-1].copy()
    with pytest.warns(GpubsplineWarning, match=r"50 of 2,208 triangles"):
        mended = closed(Surface(body.points, triangles))
    assert mended.volume_mm3 == pytest.approx(body.volume_mm3)


@pytest.mark.parametrize("cavity_outwards", [True, False])
def test_a_cavity_faces_into_itself(shapes, cavity_outwards):
    inner = shapes.sphere(5)
    both = shapes.join(shapes.sphere(), inner if cavity_outwards else shapes.turn(inner))
    expected = shapes.sphere().volume_mm3 - inner.volume_mm3
    if cavity_outwards:
        with pytest.warns(GpubsplineWarning, match="1 of 2 closed parts inside out"):
            body = closed(both)
    else:
        body = kept(both)
    assert body.volume_mm3 == pytest.approx(expected) and body.euler == 4


def test_of_several_bodies_the_largest_is_kept_with_its_cavity(shapes):
    bodies = [shapes.sphere(2), shapes.sphere(10), shapes.turn(shapes.sphere(8)), shapes.box(low=(50, 0, 0))]
    with pytest.warns(GpubsplineWarning, match="2 more than the largest"):
        body = closed(shapes.join(*bodies))
    assert body.volume_mm3 == pytest.approx(bodies[1].volume_mm3 + bodies[2].volume_mm3)


def test_a_hole_is_refused_with_its_place(shapes):
    box = shapes.box()
    with pytest.raises(InputError, match=r"bone\.ply.*3 edges that are open, the first at \(.*\) mm: close its holes"):
        kept(Surface(box.points, box.triangles[1:]), "bone.ply")


def test_a_fin_is_refused_with_its_place(shapes):
    box = shapes.box()
    fin = Surface(np.vstack([box.points, [[9, 9, 9]]]), np.vstack([box.triangles, [[0, 1, 8]]]))
    with pytest.raises(InputError, match=r"1 edges that are shared by more than two triangles, .*: remove fins"):
        kept(fin)
    wall = Surface(box.points, np.vstack([box.triangles, box.triangles[:1]]))
    with pytest.raises(InputError, match=r"3 edges that are shared by more than two triangles, the first at"):
        kept(wall)


def test_places_of_models_in_metres_keep_their_digits(shapes):
    """The first triangle left out has its first side from (0, 0, 0) to (0, 0.03, 0) m."""
    small = shapes.box(size=(0.04, 0.03, 0.02))
    with pytest.raises(InputError, match=r"the first at \(0\.00000, 0\.01500, 0\.00000\) mm"):
        kept(Surface(small.points, small.triangles[1:]))


def klein_bottle(n=12):
    """A closed surface with one side: a torus whose second direction is glued mirrored."""
    u, v = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
    number = u * n + v

    def at(i, j):
        wraps = i >= n
        return number[i % n, np.where(wraps, -j, j) % n]

    a, b, c, d = (x.ravel() for x in (at(u, v), at(u + 1, v), at(u + 1, v + 1), at(u, v + 1)))
    points = np.random.default_rng(1).normal(size=(n * n, 3))
    return Surface(points, np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]))


def test_a_one_sided_surface_is_refused():
    assert klein_bottle().euler == 0
    with pytest.raises(InputError, match=r"one-sided surface.* at \("):
        kept(klein_bottle())


def test_bodies_through_each_other_are_refused_with_a_place(shapes):
    both = shapes.join(shapes.sphere(10, (0, 0, 0)), shapes.sphere(10, (12.1, 0.3, 0.2)))
    with pytest.raises(InputError, match=r"not to pass through itself, got \d+ edges.*mend it"):
        check_apart(both)
    places = self_crossings(both)
    # two spheres meet in a circle half way between their centres
    middle = np.array([12.1, 0.3, 0.2]) / 2
    axis = middle / np.linalg.norm(middle)
    assert np.abs((places - middle) @ axis).max() < 0.3
    radius = np.sqrt(100 - middle @ middle)
    np.testing.assert_allclose(np.linalg.norm(places - middle, axis=1), radius, atol=0.3)


def test_crossings_agree_with_vtk(shapes):
    """Every crossing lies on the line that VTK's intersection filter finds, and covers its whole length."""
    pyvista = pytest.importorskip("pyvista")
    one, other = shapes.sphere(10, (0, 0, 0), stretch=(1, 1, 2)), shapes.sphere(8, (7.3, 1.1, 5.7))
    meshes = [pyvista.make_tri_mesh(s.points, s.triangles) for s in (one, other)]
    line, _, _ = meshes[0].intersection(meshes[1], split_first=False, split_second=False)
    places = self_crossings(shapes.join(one, other))
    theirs = line.points.astype(float)
    from scipy.spatial import KDTree

    assert KDTree(theirs).query(places)[0].max() < 1e-4
    assert KDTree(places).query(theirs)[0].max() < 2.0  # an edge may cross several triangles and counts once


@pytest.mark.parametrize("body", ["sphere", "box"])
def test_whole_surfaces_do_not_cross_themselves(shapes, body):
    assert len(self_crossings(getattr(shapes, body)())) == 0


def test_an_edge_that_runs_through_the_edge_of_two_triangles_is_found(shapes):
    """On the diagonal of a box's top, which neither of its two triangles holds alone."""
    blade = Surface(np.array([[1.0, 0.75, 5], [2.0, 1.5, 1], [3.0, 2.25, 5]]), np.array([[0, 1, 2]]))  # down and up
    places = self_crossings(shapes.join(shapes.box(), blade))
    np.testing.assert_allclose(np.sort(places, axis=0), [[1.75, 1.3125, 2], [2.25, 1.6875, 2]])


def test_a_fold_is_found(shapes):
    """One point of a sphere pushed through the other side."""
    body = shapes.sphere(10, (0, 0, 0))
    points = body.points.copy()
    points[0] = [0, 0, -13]
    assert len(self_crossings(Surface(points, body.triangles))) > 0


def test_shapes_that_do_not_fit_are_refused():
    with pytest.raises(InputError, match=r"points \(n, 3\)"):
        Surface(np.zeros((4, 2)), np.zeros((1, 3), int))
    with pytest.raises(InputError, match="points 0 to 2"):
        Surface(np.zeros((3, 3)), np.array([[0, 1, 3]]))
    with pytest.raises(InputError, match="NaN or infinity in 1 of 3"):
        Surface(np.array([[0, 0, 0], [1, 0, np.nan], [0, 1, 0]]), np.array([[0, 1, 2]]))
