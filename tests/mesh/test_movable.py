"""The energy of movable hexes: an oracle in float64, its gradient by differences, and what nodes may do."""

import numpy as np
import pytest

from gpubspline.errors import InputError
from gpubspline.mesh.movable import FIXED, FREE, Goal, movable, node_slots, put_level, put_pieces

CORNERS = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)])
NEIGHBOURS = [(1, 3, 4), (2, 0, 5), (3, 1, 6), (0, 2, 7), (7, 5, 0), (4, 6, 1), (5, 7, 2), (6, 4, 3)]
EDGES = [[(0, 1), (3, 2), (4, 5), (7, 6)], [(0, 3), (1, 2), (4, 7), (5, 6)], [(0, 4), (1, 5), (2, 6), (3, 7)]]


def block(n=2, noise=0.25, seed=1):
    """Cells (m, 8) and jittered nodes of n x n x n hexes of size 1."""
    side = n + 1
    first = np.stack(np.meshgrid(*[np.arange(n)] * 3, indexing="ij"), axis=-1).reshape(-1, 1, 3)
    cells = ((first + CORNERS) @ np.array([side * side, side, 1])).astype(np.int32)
    at = np.stack(np.meshgrid(*[np.arange(side)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)[:, ::-1]
    cells = cells[:, [0, 3, 2, 1, 4, 7, 6, 5]]  # i runs fastest in the nodes' numbers and last in the corners'
    points = at + np.random.default_rng(seed).normal(size=at.shape) * noise
    return cells[:, [4, 5, 6, 7, 0, 1, 2, 3]] if volume(at[cells[0]]) < 0 else cells, points


def volume(corners):
    return np.linalg.det([corners[1] - corners[0], corners[3] - corners[0], corners[4] - corners[0]])


def oracle(points, cells, goal, log_lengths):
    """Energy, slow and obvious."""
    total = 0.0
    for cell, lengths in zip(cells, log_lengths.T, strict=True):
        x = points[cell]
        for corner, around in enumerate(NEIGHBOURS):
            units = [(x[k] - x[corner]) / np.linalg.norm(x[k] - x[corner]) for k in around]
            total += max(0.0, goal.jacobian - np.linalg.det(units)) ** goal.power
        for edges, target in zip(EDGES, lengths, strict=True):
            total += goal.edges * sum((np.log(np.sum((x[b] - x[a]) ** 2)) - target) ** 2 for a, b in edges)
    return total


def sphere_level(device, radius=1.2, centre=1.0, step=0.25):
    line = np.arange(-2, 4 + step / 2, step)
    z, y, x = np.meshgrid(line, line, line, indexing="ij")
    phi = np.sqrt((x - centre) ** 2 + (y - centre) ** 2 + (z - centre) ** 2) - radius
    to_index = np.hstack([np.eye(3) / step, np.full((3, 1), 2 / step)])
    return put_level(phi, to_index, device)


def evaluate(hexes, x, goal):
    gradient = hexes.device.empty(3 * hexes.n_nodes)
    buffer = hexes.device.put(np.ascontiguousarray(x.T))
    return hexes.evaluate(buffer, goal, gradient), np.array(hexes.device.get(gradient)).reshape(3, -1).T


@pytest.mark.parametrize("goal", [Goal(1.0, 2, 0.05), Goal(0.9, 4, 0.0), Goal(0.3, 2, 0.2)])
def test_energy_and_gradient_against_the_oracle(goal, any_device):
    """Inverted hexes among them; central differences of the oracle for the gradient."""
    cells, points = block(noise=0.3)
    lengths = np.random.default_rng(2).normal(size=(3, len(cells))) * 0.3
    n = len(points)
    hexes = movable(cells, n, np.full(n, FREE), sphere_level(any_device), any_device, lengths)
    energy, gradient = evaluate(hexes, points, goal)
    rounding = 1e-5 if any_device.real == np.float32 else 1e-12
    assert energy == pytest.approx(oracle(points, cells, goal, lengths), rel=rounding)
    step, slopes = 1e-6, np.zeros_like(points)
    for node, axis in np.ndindex(*points.shape):
        moved = np.zeros_like(points)
        moved[node, axis] = step
        difference = oracle(points + moved, cells, goal, lengths) - oracle(points - moved, cells, goal, lengths)
        slopes[node, axis] = difference / (2 * step)
    rounding = 2e-5 if any_device.real == np.float32 else 1e-7
    assert np.abs(gradient - slopes).max() < rounding * np.abs(slopes).max()


def test_gradient_vanishes_where_every_corner_is_right(device64):
    cells, points = block(noise=0.0)
    hexes = movable(cells, len(points), np.full(len(points), FREE), sphere_level(device64), device64)
    energy, gradient = evaluate(hexes, points, Goal(1.0, 2, 1.0))
    assert energy == 0 and not gradient.any()


def test_nodes_slide_on_the_level_and_stay_within_their_slack(any_device):
    """Trilinear samples of a sphere a quarter of an element apart: the zero level itself to rounding."""
    cells, points = block(noise=0.2)
    n = len(points)
    slack = np.zeros(n)
    slack[::3], slack[1::5] = 0.2, FIXED
    hexes = movable(cells, n, slack, sphere_level(any_device), any_device)
    x = any_device.put(np.ascontiguousarray(points.T))
    hexes.slide(x)
    slid = np.array(any_device.get(x)).reshape(3, -1).T
    far = np.linalg.norm(slid - 1.0, axis=1) - 1.2
    centre = np.linalg.norm(points - 1.0, axis=1) < 0.5  # the distance has a kink there
    assert np.abs(far[(slack == 0) & ~centre]).max() < 0.02
    assert np.abs(far[(slack > 0) & ~centre]).max() < 0.22
    assert np.array_equal(slid[slack < 0], points[slack < 0].astype(any_device.real))
    normal = np.array(any_device.get(hexes.normal)).reshape(3, -1).T
    on = (slack == 0) & ~centre
    assert np.allclose(np.linalg.norm(normal[on], axis=1), 1, atol=1e-5)
    _, gradient = evaluate(hexes, slid, Goal(1.0, 2, 0.1))
    along = np.einsum("nc,nc->n", gradient, normal)
    assert np.abs(along[on]).max() < 1e-5 * np.abs(gradient).max()
    assert not gradient[slack < 0].any()


def test_nodes_of_a_curve_go_along_it(any_device):
    """Two levels, the planes z = 1 and x = 0.5 + y / 2: their curve has the direction (1, 2, 0)."""
    cells, points = block(noise=0.2)
    n, step = len(points), 0.5
    line = np.arange(-2, 4 + step / 2, step)
    z, y, x = np.meshgrid(line, line, line, indexing="ij")
    to_index = np.hstack([np.eye(3) / step, np.full((3, 1), 2 / step)])
    level = put_level(np.stack([z - 1, (x - 0.5 - 0.5 * y) / np.sqrt(1.25)]), to_index, any_device)
    levels = np.stack([np.arange(n) % 2, np.full(n, -1)]).astype(np.int32)
    levels[:, ::3] = [[0], [1]]
    hexes = movable(cells, n, np.zeros(n), level, any_device, levels=levels)
    buffer = any_device.put(np.ascontiguousarray(points.T))
    hexes.slide(buffer)
    slid = np.array(any_device.get(buffer)).reshape(3, -1).T
    flat, leaning = slid[:, 2] - 1, slid[:, 0] - 0.5 - 0.5 * slid[:, 1]
    assert np.abs(flat[(levels == 0).any(axis=0)]).max() < 1e-5
    assert np.abs(leaning[(levels == 1).any(axis=0)]).max() < 1e-5
    _, gradient = evaluate(hexes, slid, Goal(1.0, 2, 0.1))
    along, size = np.array([1, 2, 0]) / np.sqrt(5), np.abs(gradient).max()
    of_curve = gradient[::3]
    assert np.abs(of_curve - (of_curve @ along)[:, None] * along).max() < 1e-5 * size
    assert np.abs(of_curve).max() > 0.01 * size


def test_slots_name_each_vertex_of_each_hex_once():
    cells, points = block()
    start, slots = node_slots(cells, len(points))
    assert np.array_equal(np.sort(slots), np.arange(cells.size))
    owner = np.repeat(np.arange(len(points)), np.diff(start))
    vertex, element = np.divmod(slots, len(cells))
    assert np.array_equal(cells[element, vertex], owner)


def quad_oracle(points, cells, goal, log_lengths):
    """Energy of quads in space, slow and obvious."""
    total = 0.0
    for cell, lengths in zip(cells, log_lengths.T, strict=True):
        x = points[cell]
        edges = np.roll(x, -1, axis=0) - x
        units = edges / np.linalg.norm(edges, axis=1)[:, None]
        normal = np.cross(x[2] - x[0], x[3] - x[1])
        normal /= np.linalg.norm(normal)
        for corner in range(4):
            jacobian = np.dot(normal, np.cross(units[corner - 1], units[corner]))
            total += max(0.0, goal.jacobian - jacobian) ** goal.power
        total += goal.edges * np.sum((np.log((edges**2).sum(axis=1)) - np.tile(lengths, 2)) ** 2)
    return total


@pytest.mark.parametrize("goal", [Goal(1.0, 2, 0.05), Goal(0.9, 4, 0.0)])
def test_energy_of_quads_and_gradient_against_the_oracle(goal, any_device):
    """A bent sheet of 3 x 3, folded over in one place."""
    v, u = np.meshgrid(*[np.arange(4.0)] * 2, indexing="ij")
    points = np.stack([u, v, 0.2 * u * v], axis=-1).reshape(-1, 3)
    points += np.random.default_rng(3).normal(size=points.shape) * 0.15
    points[5] += [1.2, 0.9, 0.0]
    first = (np.arange(3)[:, None] * 4 + np.arange(3)).ravel()
    cells = (first[:, None] + [0, 1, 5, 4]).astype(np.int32)
    lengths = np.random.default_rng(2).normal(size=(2, 9)) * 0.3
    n = len(points)
    quads = movable(cells, n, np.full(n, FREE), sphere_level(any_device), any_device, lengths)
    energy, gradient = evaluate(quads, points, goal)
    rounding = 1e-5 if any_device.real == np.float32 else 1e-12
    assert energy == pytest.approx(quad_oracle(points, cells, goal, lengths), rel=rounding)
    step, slopes = 1e-6, np.zeros_like(points)
    for node, axis in np.ndindex(*points.shape):
        moved = np.zeros_like(points)
        moved[node, axis] = step
        ends = [quad_oracle(points + sign * moved, cells, goal, lengths) for sign in (1, -1)]
        slopes[node, axis] = (ends[0] - ends[1]) / (2 * step)
    rounding = 3e-5 if any_device.real == np.float32 else 1e-7
    assert np.abs(gradient - slopes).max() < rounding * np.abs(slopes).max()


def test_pieces_are_no_more_than_a_plane_of_the_coordinates_can_number(device):
    """From 2^24 on float32 leaves numbers out."""
    many = np.broadcast_to(np.zeros(1, np.float32), (2**24 + 1, 3, 3))
    with pytest.raises(InputError, match="at most 16,777,216 pieces"):
        put_pieces(many, many, np.zeros(1), np.zeros(1), device)


def test_a_sliver_lifts_a_node_no_farther_than_its_normals_say(device):
    """Triangles next to a line, whose area float32 does not know: at most the normals' slope times half a side."""
    rng, n, side, slope = np.random.default_rng(0), 4000, 0.06, 0.3
    a, way, aside = rng.uniform(-30, 30, (n, 3)), rng.normal(size=(n, 3)), rng.normal(size=(n, 3))
    way /= np.linalg.norm(way, axis=1)[:, None]
    b = a + way * rng.uniform(0.2, 0.8, (n, 1)) * side + rng.choice([0, 1e-7, 1e-6, 3e-6, 1e-5], (n, 1)) * aside
    corners = np.stack([a, b, a + side * way], axis=1)
    upright = np.cross(way, aside)
    upright /= np.linalg.norm(upright, axis=1)[:, None]
    normals = upright[:, None] + slope * rng.uniform(-1, 1, (n, 3, 1)) * way[:, None]
    normals /= np.linalg.norm(normals, axis=2)[..., None]
    level = put_pieces(corners, normals, np.zeros(n + 1, np.int32), np.zeros(1, np.int32), device)
    points = np.einsum("nk,nkc->nc", rng.dirichlet([1, 1, 1], n), corners)
    x, places, normal = device.put(np.vstack([points.T, np.arange(n)])), device.empty(3 * n), device.empty(3 * n)
    levels = device.put(np.stack([np.zeros(n), np.full(n, -1)]).astype(np.int32))
    slack = device.put(np.zeros(n))
    device.launch("optimize.slide", n, x, n, slack, levels, *level.arguments, places, normal)
    off = np.linalg.norm(np.array(device.get(places)).reshape(3, -1).T - points, axis=1)
    assert 0.001 < off.max() < 0.5 * slope * side + 1e-4
