"""Contours of sections, the places matched on them, and points inside them."""

import numpy as np
import pytest

from gpubspline.errors import GpubsplineWarning, InputError
from gpubspline.mesh.butterfly.contours import cut_sections, signed_area
from gpubspline.mesh.butterfly.matching import match_loops, resample
from gpubspline.mesh.butterfly.placement import Layout, corner_sines, harmonic, transfinite


def oval(n=400, a=24.0, b=16.0, turn=0.0, centre=(0.0, 0.0)):
    t = 2 * np.pi * np.arange(n) / n
    x, y = a * np.cos(t), b * np.sin(t)
    return np.stack([x * np.cos(turn) - y * np.sin(turn), x * np.sin(turn) + y * np.cos(turn)], axis=1) + centre


GRIDS = {
    "cubic": np.eye(3),
    "flat voxels": np.diag([0.9, 0.8, 2.0]),
    "sheared in plane": np.array([[0.9, 0.2, 0], [0, 0.8, 0], [0, 0, 1.5]]),
    "tilted gantry": np.array([[0.9, 0, 0], [0, 0.8, 0], [0, -0.3, 1.5]]),
    "left-handed": np.diag([-0.9, 0.8, 1.5]),
}


@pytest.mark.parametrize("grid", GRIDS)
def test_areas_of_ellipses_between_voxels(make_region, ellipse_level, grid):
    """pi a b to 0.3 %, with ends anywhere between voxel centres, on every kind of grid; points lie on the ellipse."""
    region = make_region(ellipse_level(17.3, 12.1), GRIDS[grid])
    sections = cut_sections(region, 7)
    if grid == "tilted gantry":  # sections lie in the slices' plane, in which the upright cylinder is cut askew
        assert len(sections.loops) == 7
        return
    for loop in sections.loops:
        assert signed_area(loop) == pytest.approx(np.pi * 17.3 * 12.1, rel=3e-3)
    points = sections.to_mm(np.stack([resample(loop, 50) for loop in sections.loops], axis=1))
    np.testing.assert_allclose(np.hypot(points[..., 0] / 17.3, points[..., 1] / 12.1), 1, atol=0.01)


def test_contours_run_to_the_border_where_the_scan_ends(make_region):
    region = make_region(lambda x, y, z: np.maximum(np.abs(y) - 10.3, x - 8.2))
    for loop in cut_sections(region, 3).loops:
        assert signed_area(loop) == pytest.approx(20.6 * (8.2 + 34.5), rel=1e-3)


@pytest.mark.parametrize(
    ("level", "what"),
    [
        (lambda x, y, z: np.minimum(np.hypot(x - 15, y), np.hypot(x + 15, y)) - 12 + 0 * z, "2 parts"),
        (lambda x, y, z: np.abs(np.hypot(x, y) - 18) - 6, "a hole"),
    ],
)
def test_branches_and_holes_are_refused_with_their_place(make_region, level, what):
    with pytest.raises(InputError, match=rf"got a section with {what} at \(.*-11.*\) mm: blocks mesh any shape"):
        cut_sections(make_region(level), 5)


def test_specks_are_left_out_with_a_word(make_region):
    region = make_region(lambda x, y, z: np.minimum(np.hypot(x, y) - 20, np.hypot(x - 28, y - 20) - 1.6))
    with pytest.warns(GpubsplineWarning, match=r"5 of 5 sections have parts or holes of up to 0\.\d+ %"):
        sections = cut_sections(region, 5)
    assert signed_area(sections.loops[0]) == pytest.approx(np.pi * 400, rel=3e-3)


def test_counts_that_make_no_sections(make_region, ellipse_level):
    with pytest.raises(InputError, match="at least 2 sections"):
        cut_sections(make_region(ellipse_level()), 1)
    with pytest.raises(InputError, match="one slice"):
        cut_sections(make_region(ellipse_level(), shape=(1, 60, 70)))


def test_matched_points_are_on_the_contours_and_turn_with_nothing():
    """A growing, wandering, flattening oval keeps its matched points in one direction from its centre."""
    loops = [oval(a=24 - n, b=16 - n, centre=(3.0 * n, -2.0 * n)) for n in range(5)]
    points = match_loops(loops, 32, 0.0)
    middle = points - np.array([[3.0 * n, -2.0 * n] for n in range(5)])
    axes = np.array([[24.0 - n, 16.0 - n] for n in range(5)])
    np.testing.assert_allclose(np.linalg.norm(middle / axes, axis=-1), 1, atol=1e-3)
    angles = np.unwrap(np.arctan2(middle[..., 1] / axes[:, 1], middle[..., 0] / axes[:, 0]), axis=0)
    assert np.abs(angles - angles[:, :1]).max() < 0.01  # radians: no twist


def test_where_a_contour_begins_does_not_matter():
    loop = oval(turn=0.4)
    one, other = (match_loops([np.roll(loop, n, axis=0)], 24, 0.3) for n in (0, 137))
    np.testing.assert_allclose(one, other, atol=0.02)


def test_an_ear_moves_its_neighbours_little():
    """Against the same contour without it: a bump of a sixth of the width, folded back over itself."""
    plain = oval(2000, 20, 20)
    angle = np.arctan2(plain[:, 1], plain[:, 0])
    bump = np.exp(-((angle / 0.06) ** 2))
    eared = plain * (1 + 0.35 * bump)[:, None]
    eared[:, 1] += 3 * bump
    one, other = (match_loops([loop], 36, 0.25)[:, 0] for loop in (plain, eared))
    away = np.abs(np.arctan2(one[:, 1], one[:, 0])) > 0.5
    assert np.linalg.norm((one - other)[away], axis=1).max() < 1.6


@pytest.mark.parametrize("layout", [Layout(7, 7, 4), Layout(9, 4, 3), Layout(2, 2, 2), Layout(3, 6, 7)])
def test_layouts_are_one_sheet_of_quads(layout):
    """Every point is used, inner edges belong to two quads, the border is the contour: Euler's V - E + F = 1."""
    quads = layout.quads
    assert np.array_equal(np.unique(quads), np.arange(layout.count))
    assert len(quads) == (layout.u - 1) * (layout.v - 1) + layout.around * (layout.r - 1)
    sides = np.concatenate([quads[:, [a, (a + 1) % 4]] for a in range(4)])
    edges, count = np.unique(np.sort(sides, axis=1), axis=0, return_counts=True)
    assert layout.count - len(edges) + len(quads) == 1
    assert set(count.tolist()) <= {1, 2}
    assert set(edges[count == 1].ravel()) == set(layout.ring[:, -1].tolist())
    assert len(np.unique(sides, axis=0)) == len(sides)  # neighbours run along a shared edge in opposite directions


@pytest.mark.parametrize("place", [harmonic, transfinite])
def test_placement_commutes_with_affine_maps(place):
    layout = Layout(7, 5, 4)
    border = oval(layout.around, turn=0.7)[:, None]
    matrix, shift = np.array([[1.3, 0.4], [-0.2, 0.8]]), np.array([5.0, -3.0])
    np.testing.assert_allclose(
        place(layout, border @ matrix.T + shift), place(layout, border) @ matrix.T + shift, atol=1e-10
    )
    np.testing.assert_array_equal(place(layout, border)[layout.ring[:, -1]], border)


@pytest.mark.parametrize(("place", "least"), [(harmonic, 0.85), (transfinite, 0.70)])
def test_a_disc_is_filled_well(place, least):
    """The square's corners, where three quads meet at 120 degrees, have the sine 0.866: nothing is much worse."""
    layout = Layout(9, 9, 5)
    t = 2 * np.pi * (np.arange(layout.around) / layout.around + 0.625)
    sines = corner_sines(layout, place(layout, np.stack([np.cos(t), np.sin(t)], axis=1)[:, None]))
    assert least < sines.min() < 0.867 or place is transfinite
    assert sines.min() > least and sines.mean() > 0.95


def test_harmonic_points_do_not_fold_in_convex_contours():
    """Tutte's theorem, on random convex polygons."""
    rng = np.random.default_rng(6)
    layout = Layout(6, 8, 4)
    for _ in range(20):
        t = np.sort(rng.uniform(0, 2 * np.pi, layout.around))
        border = np.stack([np.cos(t), np.sin(t)], axis=1) @ rng.normal(size=(2, 2))
        border = border if signed_area(border) > 0 else border[::-1]
        placed = harmonic(layout, border[:, None])
        corners = placed[layout.quads][:, :, 0]
        areas = [signed_area(quad) for quad in corners]
        assert min(areas) > 0
