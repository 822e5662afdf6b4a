"""Surfaces with small faults come back whole, with a word; what is not small is refused."""

import warnings

import meshio
import numpy as np
import pytest

from gpubspline.errors import GpubsplineWarning, InputError
from gpubspline.surface.check import closed
from gpubspline.surface.crossings import check_apart, self_crossings
from gpubspline.surface.mend import MOST_EDGES, mended
from gpubspline.surface.read import read_surface
from gpubspline.surface.region import region_from_surface
from gpubspline.surface.surface import Surface


def said(surface):
    """What is left after mending, closed, and the phrases of what was done."""
    whole, done = mended(surface)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return closed(whole), [str(mending) for mending in done]


def triangles_of(surface):
    """Each triangle as the coordinates of its corners from the least on: what two equal surfaces have in common."""
    corners = [np.roll(c, -min(range(3), key=lambda n: tuple(c[n])), axis=0) for c in surface.corners]
    return {tuple(c.ravel()) for c in corners}


def with_triangles(surface, points, triangles):
    return Surface(np.concatenate([surface.points, points]), np.concatenate([surface.triangles, triangles]))


def test_a_whole_surface_stays_as_it_is(shapes):
    body = shapes.sphere()
    assert mended(body) == (body, [])


@pytest.mark.parametrize("missing", [[500], [500, 501], [500, 900]])
def test_missing_triangles_are_put_back(shapes, missing):
    body = shapes.sphere()
    whole, words = said(Surface(body.points, np.delete(body.triangles, missing, axis=0)))
    assert triangles_of(whole) >= triangles_of(body) - triangles_of(Surface(body.points, body.triangles[missing]))
    assert whole.euler == 2 and len(words) == 1 and "edges closed, the longest" in words[0]
    assert whole.volume_mm3 == pytest.approx(body.volume_mm3, rel=1e-4)
    if len(missing) == 1:
        assert triangles_of(whole) == triangles_of(body)


def test_holes_that_share_a_point_are_closed_one_by_one(shapes):
    body = shapes.sphere()
    at = np.flatnonzero((body.triangles == body.triangles[500, 0]).any(axis=1))
    apart = next(
        n for n in at if len(np.intersect1d(body.triangles[n], body.triangles[at[0]])) == 1
    )  # of the triangles round a point, one that shares nothing but that point with the first
    whole, words = said(Surface(body.points, np.delete(body.triangles, [at[0], apart], axis=0)))
    assert triangles_of(whole) == triangles_of(body) and words[0].startswith("2 holes of up to 3 edges")


def test_triangles_given_twice_either_way_round_are_dropped(shapes):
    body = shapes.sphere()
    twice = np.concatenate([body.triangles[40:43], body.triangles[50:52, ::-1]])
    whole, words = said(with_triangles(body, np.zeros((0, 3)), twice))
    assert triangles_of(whole) == triangles_of(body) and words[0].startswith("5 triangles given twice")


def test_fins_inner_walls_and_loose_bits_are_dropped(shapes):
    """A fin on an edge, a wall between four points of a ring inside, a triangle that touches nothing."""
    body = shapes.sphere()
    a, b, c = body.triangles[300]
    n = len(body.points)
    outside = 1.05 * body.corners[300].mean(axis=0) - 0.05 * body.points.mean(axis=0)
    fin, wall, loose = [[a, b, n]], [[a, b, c]], [[n + 1, n + 2, n + 3]]
    far = body.points.mean(axis=0) + np.array([[20, 0, 0], [21, 0, 0], [20, 1, 0]])
    points = np.concatenate([[outside], far])
    around = np.array([[a, n, c], [n, b, c]])  # a tent on a triangle that stays: with the fin, a body that shares it
    for more, count in ((fin, 1), (loose, 1), (np.concatenate([fin, loose]), 2), (np.concatenate([wall, fin]), 1)):
        whole, words = said(with_triangles(body, points, more))
        assert triangles_of(whole) == triangles_of(body)
        assert any(word.startswith(f"{count} triangle{'s' * (count > 1)} of fins") for word in words), words
    tent = with_triangles(body, points, np.concatenate([fin, around]))
    whole, words = said(tent)  # of triangle and tent, which both close the body, the smaller goes
    assert triangles_of(whole) == triangles_of(Surface(tent.points, np.delete(tent.triangles, [300], axis=0)))


def test_large_faults_are_left(shapes):
    """A missing wall of a box, a wing, many holes: no one way to mend them."""
    box, body = shapes.box(), shapes.sphere(n=12)
    wing = with_triangles(box, [[9.0, 9.0, 9.0]], [[0, 1, 8]])
    with pytest.raises(InputError, match=r"1 edges that are shared by more than two triangles, .*: remove fins"):
        said(wing)
    with pytest.raises(InputError, match="3 edges that are open"):
        said(Surface(box.points, box.triangles[1:]))
    with pytest.raises(InputError, match=f"{12 * 3} edges that are open"):
        said(Surface(body.points, np.delete(body.triangles, np.arange(100, 220, 10), axis=0)))
    cap = np.flatnonzero((shapes.sphere(n=24).corners[..., 2] > 49.8).all(axis=1))
    fine = shapes.sphere(n=24)
    assert len(cap) > MOST_EDGES
    with pytest.raises(InputError, match="48 edges that are open"):
        said(Surface(fine.points, np.delete(fine.triangles, cap, axis=0)))


def test_open_bodies_beside_a_larger_closed_one_are_left_out(shapes):
    scrap = shapes.box((8, 8, 8), (50, 0, 0))
    both = shapes.join(Surface(scrap.points, np.delete(scrap.triangles, [0, 6], axis=0)), shapes.sphere())
    whole, words = said(both)
    assert triangles_of(whole) == triangles_of(shapes.sphere()) and words[0].startswith("1 open shell smaller")
    with pytest.raises(InputError, match="open"):
        said(shapes.join(Surface(scrap.points, np.delete(scrap.triangles, [0, 6], axis=0)), shapes.sphere(0.5, n=12)))


def test_a_seam_is_joined(shapes, tmp_path):
    """Two halves whose edges differ by a hundred-thousandth of the body; points inside them stay apart."""
    body = shapes.sphere()
    below = body.corners[..., 2].mean(axis=1) < 40
    halves = [Surface(body.points, body.triangles[side]) for side in (below, ~below)]
    apart = shapes.join(halves[0], Surface(body.points + np.array([1e-4, 0, 0]), halves[1].triangles))
    meshio.write_points_cells(tmp_path / "a.ply", apart.points, [("triangle", apart.triangles)])
    with pytest.warns(GpubsplineWarning, match=r"mended: 48 points of open edges closer than 0\.0002 mm joined, the f"):
        whole = read_surface(tmp_path / "a.ply")
    assert (len(whole.points), whole.euler) == (len(body.points), 2)
    assert whole.volume_mm3 == pytest.approx(body.volume_mm3, rel=1e-4)


def test_bodies_that_touch_along_an_edge_are_one(shapes, device):
    both = shapes.join(shapes.box((2, 2, 2)), shapes.box((2, 2, 2), (2, 2, 0)))
    _, first, number = np.unique(both.points, axis=0, return_index=True, return_inverse=True)
    whole, words = said(Surface(both.points[first], number.reshape(-1)[both.triangles]))
    assert words == [] and whole.volume_mm3 == pytest.approx(16)
    assert region_from_surface(whole, device, spacing_mm=0.1).volume_mm3 == pytest.approx(16, rel=0.01)


def test_a_small_fold_is_taken_with_a_word_and_a_large_one_is_not(shapes, device):
    """A point pushed past its neighbours makes triangles that cross: inside is still what it was."""
    body = shapes.sphere(n=24)
    points = body.points.copy()
    points[500] += 1.6 * (points[501] - points[500])
    folded = Surface(points, body.triangles)
    assert len(self_crossings(folded)) > 0
    with pytest.warns(GpubsplineWarning, match=r"a passes through itself at \d+ edges, the first at .* mm: what it"):
        check_apart(folded, "a")
    volume = region_from_surface(folded, device, spacing_mm=0.3).volume_mm3
    assert volume == pytest.approx(body.volume_mm3, rel=3e-3)
    points[:] = body.points
    points[:200] = points[:200] * [1, 1, -1] + [0, 0, 70.0]  # the upper cap turned over, through the lower one
    with pytest.raises(InputError, match=r"\d % of the volume held twice or inside out: mend it"):
        check_apart(Surface(points, body.triangles))
