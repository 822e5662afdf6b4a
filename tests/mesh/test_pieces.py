"""Surfaces to walk on: quads that bulge as their normals say, what touches what, nodes that go along."""

import numpy as np
import pytest

from gpubspline.mesh.movable import FIXED, movable
from gpubspline.mesh.own_surface import hold
from gpubspline.mesh.pieces import bilinear, bulged, edges_of, number, touching, triangles_of


def sheet(n, height):
    """Points and quads of n x n over a square of side 2, at a height of x and y."""
    y, x = np.meshgrid(*[np.linspace(-1, 1, n + 1)] * 2, indexing="ij")
    points = np.stack([x, y, height(x, y)], axis=-1).reshape(-1, 3)
    first = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    return points, first[:, None] + [0, 1, n + 2, n + 1]


def test_a_bulge_is_of_second_order():
    """A paraboloid's own normals: what is left falls by 8 and more as edges halve, chords' by 4."""
    left, flat = [], []
    for n in (4, 8):
        points, quads = sheet(n, lambda x, y: 0.3 * x**2 - 0.2 * y**2 + 0.1 * x * y)
        slopes = np.stack([0.6 * points[:, 0] + 0.1 * points[:, 1], 0.1 * points[:, 0] - 0.4 * points[:, 1]], axis=1)
        normals = np.column_stack([-slopes, np.ones(len(points))])
        normals /= np.linalg.norm(normals, axis=1)[:, None]
        for made, out in ((bulged(points[quads], normals[quads], 4), left), (bilinear(points[quads], 4), flat)):
            x, y, z = np.moveaxis(made, -1, 0)
            out.append(np.abs(z - 0.3 * x**2 + 0.2 * y**2 - 0.1 * x * y).max())
    assert left[0] > 6 * left[1] and 3 < flat[0] / flat[1] < 5 and left[1] < flat[1] / 10


def test_cut_quads_share_the_points_of_their_edges():
    points, quads = sheet(3, lambda x, y: 0 * x)
    turned = np.array([np.roll(quad, shift) for shift, quad in enumerate(quads)])
    numbers = number(turned, edges_of(turned), len(points), 4)
    places = {}
    for point, place in zip(numbers.ravel(), bilinear(points[turned], 4).reshape(-1, 3), strict=True):
        assert places.setdefault(point, place) == pytest.approx(place, abs=1e-12)
    assert len(places) == 13 * 13 and numbers.max() == 13 * 13 - 1


def test_pieces_touch_those_of_their_own_group():
    numbers = np.arange(9).reshape(1, 3, 3)
    triangles = triangles_of(numbers)
    start, around = touching(triangles, np.zeros(8, dtype=np.int64), np.zeros(0, dtype=np.int64))
    for piece, corners in enumerate(triangles):
        expected = {other for other in range(8) if other != piece and set(corners) & set(triangles[other])}
        assert set(around[start[piece] : start[piece + 1]]) == expected
    apart = np.arange(8) // 4
    start, around = touching(triangles, apart, np.zeros(0, dtype=np.int64))
    assert all(
        apart[around[start[p] : start[p + 1]]].tolist() == [apart[p]] * (start[p + 1] - start[p]) for p in range(8)
    )


def test_nodes_walk_on_a_sphere_and_along_its_rim(any_device):
    """Pushed off and along, they come back on to the sphere, none farther along than it was pushed."""
    points, quads = sheet(10, lambda x, y: np.sqrt(9 - x**2 - y**2))
    held = hold(points, quads, any_device)
    corners = [0, 10, 110, 120]
    assert np.array_equal(np.flatnonzero(held.slack == FIXED), corners)  # the rim turns by 90 degrees there
    rim = np.flatnonzero(held.levels[1] >= 0)
    assert len(rim) == 36
    n = len(points)
    nodes = movable(quads.astype(np.int32), n, held.slack, held.level, any_device, levels=held.levels)
    pushed = points + np.random.default_rng(0).uniform(-0.25, 0.25, points.shape)
    x = any_device.put(np.ascontiguousarray(np.vstack([pushed.T, held.at])))
    nodes.slide(x)
    slid = np.array(any_device.get(nodes.slid(x))).reshape(3, -1).T
    moves = np.setdiff1d(np.arange(n), corners)
    assert np.linalg.norm(slid[moves], axis=1) == pytest.approx(3.0, abs=2e-3)
    assert np.abs(slid - points).max() < 0.5
    assert np.array_equal(slid[corners], pushed[corners].astype(any_device.real))  # where it was put: it does not move
    on_side = np.abs(slid[rim][:, :2]).max(axis=1)
    assert on_side == pytest.approx(1.0, abs=1e-3)
    once = np.array(any_device.get(x)).reshape(4, -1)[:3].copy()
    nodes.slide(x)
    assert np.array(any_device.get(x)).reshape(4, -1)[:3] == pytest.approx(once, abs=1e-5)
    normal = np.array(any_device.get(nodes.normal)).reshape(3, -1).T
    inside = np.setdiff1d(np.flatnonzero(held.slack == 0), rim)
    assert np.einsum("nc,nc->n", normal[inside], slid[inside] / 3) == pytest.approx(1.0, abs=2e-3)
