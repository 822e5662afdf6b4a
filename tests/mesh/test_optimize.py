"""Optimisation of any hexes: better, the surface kept, fields carried, sets kept."""

from dataclasses import replace

import numpy as np
import pytest

from gpubspline.errors import InputError
from gpubspline.mesh.carry import carry_fields
from gpubspline.mesh.colouring import colour_nodes
from gpubspline.mesh.mesh import Mesh
from gpubspline.mesh.optimize import optimize
from gpubspline.mesh.own_surface import smooth_parts
from gpubspline.mesh.pieces import edges_of
from gpubspline.mesh.quality import assess
from gpubspline.mesh.validity import certify

COUNTS = (7, 6, 5)


def jittered(noise=0.33, seed=0):
    """A box of hexes 2 x 2 x 2 mm whose nodes are moved, those of the surface within it."""
    rng = np.random.default_rng(seed)
    at = np.stack(np.meshgrid(*[np.arange(n) for n in COUNTS], indexing="ij"), axis=-1).reshape(-1, 3, order="F")
    inside = (at > 0) & (at < np.array(COUNTS) - 1)
    points = 2.0 * (at + noise * rng.uniform(-1, 1, at.shape) * inside) + np.array([50.0, -20.0, 100.0])
    fields = {"HU": points @ np.array([3.0, -2.0, 5.0]) + 7.0}
    sets = {"left": np.flatnonzero(at[:, 0] == 0).astype(np.int32)}
    return Mesh(points, "hex8", structure=COUNTS, fields=fields, node_sets=sets)


def disc(n=9, layers=7, shear=0.0):
    """A cylinder whose sections are squares blown up to circles: hexes at their four edges are flat there."""
    line = np.linspace(-1, 1, n)
    w, v, u = np.meshgrid(np.linspace(0, 12, layers), line, line, indexing="ij")
    size = np.maximum(np.abs(u), np.abs(v))
    stretch = 8 * size / np.maximum(np.hypot(u, v), 1e-9)
    points = np.stack([u * stretch + shear * w, v * stretch, w], axis=-1).reshape(-1, 3)
    return Mesh(points, "hex8", structure=(n, n, layers))


def test_a_jittered_box_is_straightened(device):
    mesh = jittered()
    before = assess(mesh, device)[1]
    made, report = optimize(mesh, device)
    after = assess(made, device)[1]
    assert before.min < 0.5 < 0.7 < after.min
    assert report.before == pytest.approx(before.min) and report.after == pytest.approx(after.min)
    assert np.ptp(made.points, axis=0) == pytest.approx(np.ptp(mesh.points, axis=0), abs=1e-3)
    assert made.volume_mm3 == pytest.approx(mesh.volume_mm3, rel=1e-4)  # sharp edges are not cut
    assert made.structure == mesh.structure and np.array_equal(made.node_sets["left"], mesh.node_sets["left"])
    expected = made.points @ np.array([3.0, -2.0, 5.0]) + 7.0
    assert made.fields["HU"] == pytest.approx(expected, abs=0.02)  # a linear field is carried to rounding


def test_corners_of_a_disc_spread_along_its_rim(device):
    """Flat corners, where the determinant is near 0, open as their nodes go along the side and along the rims."""
    mesh = disc()
    before = assess(mesh, device)[1]
    made, report = optimize(mesh, device)
    after = assess(made, device)[1]
    assert before.min < 0.15 and after.min > 0.35
    surface = made.points[np.unique(made.boundary())]
    on_cap = np.minimum(np.abs(surface[:, 2]), np.abs(surface[:, 2] - 12)) < 1e-3
    radius = np.hypot(surface[:, 0], surface[:, 1])
    assert np.all(on_cap | (np.abs(radius - 8) < 0.2))
    assert report.boundary_mm < 0.05


def test_a_floor_that_many_hexes_are_hardly_above_is_crept_up_to(device):
    """A disc sheared until no hex is good: floors a twentieth apart are not reached, 0.115 and 0.135 all they give."""
    mesh = disc(13, 5, 5.0)
    _, report = optimize(mesh, device)
    assert report.before < 0.02 and report.after > 0.145 and report.boundary_mm < 0.02


@pytest.mark.parametrize("sound", [True, False])
def test_of_what_is_reached_the_last_that_is_valid_is_taken(sound, device, monkeypatch):
    """An inner node a tenth of an edge farther on, or through the hexes beside it, called better each time."""
    mesh, found = jittered(), []

    def persisted(hexes, colours, best, effort):
        x = np.array(hexes.device.get(best.x)).reshape(-1, mesh.n_nodes)
        x[0, 7 * 6 * 2 + 7 * 3 + 3] += 0.1 if sound else 3.0
        found.append(replace(best, x=hexes.device.put(x), least=0.9))
        return [best, found[-1]]

    monkeypatch.setattr("gpubspline.mesh.optimize.persist", lambda hexes, colours, best, effort: [best])
    plain, _ = optimize(mesh, device)
    monkeypatch.setattr("gpubspline.mesh.optimize.persist", persisted)
    made, _ = optimize(mesh, device)
    way = np.linalg.norm(made.points - plain.points, axis=1)
    assert len(found) == 1 and np.count_nonzero(way > 1e-6) == sound and certify(made, device).certificate.valid


def test_a_start_whose_elements_fold_inside_is_not_better(device, monkeypatch):
    """However good their corners: a valid mesh is kept."""
    starts = iter([(0.0, (True, 0.1)), (0.5, (False, 0.9))])

    def improved(self, points, at, boundary, effort):
        way, rank = next(starts)
        return self.mesh.points + np.array([way, 0.0, 0.0]), rank

    monkeypatch.setattr("gpubspline.mesh.optimize._Start.opened", lambda self, patch: (self.points, self.held.at))
    monkeypatch.setattr("gpubspline.mesh.optimize._Start.improved", improved)
    monkeypatch.setattr("gpubspline.mesh.optimize._moved", lambda mesh, points: moved.append(points) or mesh)
    mesh, moved = jittered(), []
    optimize(mesh, device)
    assert np.array_equal(moved[0], mesh.points) and not list(starts)


def round_slice(n=13):
    """Quads of a square blown up to a circle of 8 mm: flat at its four corners; a set of nodes, and a linear field."""
    v, u = np.meshgrid(*[np.linspace(-1, 1, n)] * 2, indexing="ij")
    stretch = 8 * np.maximum(np.abs(u), np.abs(v)) / np.maximum(np.hypot(u, v), 1e-9)
    points = np.stack([u * stretch, v * stretch, np.full_like(u, 30.0)], axis=-1).reshape(-1, 3)
    sets = {"first": np.arange(n, dtype=np.int32)}
    return Mesh(points, "quad4", structure=(n, n), fields={"HU": 4 * points[:, 0] - points[:, 1]}, node_sets=sets)


def test_quads_of_a_slice(device):
    """Nodes of the contour slide on it, those inside stay in the plane; sets are kept, fields carried."""
    mesh = round_slice()
    made, report = optimize(mesh, device)
    assert report.before < 0.2 and report.after > 0.35
    rim = made.points[np.unique(made.boundary())]
    assert np.hypot(rim[:, 0], rim[:, 1]) == pytest.approx(8.0, abs=0.01)
    assert made.points[:, 2] == pytest.approx(30.0, abs=1e-4) and report.boundary_mm < 0.1
    assert made.area_mm2 == pytest.approx(mesh.area_mm2, rel=0.03)  # chords of other lengths cut off more
    assert np.array_equal(made.node_sets["first"], mesh.node_sets["first"]) and made.structure == mesh.structure
    expected = np.clip(4 * made.points[:, 0] - made.points[:, 1], mesh.fields["HU"].min(), mesh.fields["HU"].max())
    assert made.fields["HU"] == pytest.approx(expected, abs=0.02)


def test_quads_of_a_surface_in_space(device):
    """Nodes of a dome of radius 20 mm stay on it, those of its rim at its height."""
    flat = round_slice()
    rng = np.random.default_rng(3)
    inside = np.setdiff1d(np.arange(flat.n_nodes), flat.boundary())
    points = flat.points.astype(np.float64)
    points[inside, :2] += rng.uniform(-0.3, 0.3, (len(inside), 2))
    points[:, 2] = np.sqrt(400 - points[:, 0] ** 2 - points[:, 1] ** 2)
    mesh = Mesh(points, "quad4", structure=flat.structure)
    made, report = optimize(mesh, device)
    assert report.before < 0.2 and report.after > 0.35
    assert np.linalg.norm(made.points, axis=1) == pytest.approx(20.0, abs=0.02)
    on = np.unique(mesh.boundary())
    assert made.points[on, 2] == pytest.approx(np.sqrt(400 - 64), abs=0.02)
    stayed, _ = optimize(mesh, device, boundary="stay")
    assert np.array_equal(stayed.points[on], mesh.points[on])


def test_a_bent_sheet_keeps_to_its_sheets(device):
    """A slab folded on itself, 0.4 mm apart: nodes of one side never get to the other, which is nearer than an edge."""
    u, v, w = np.meshgrid(np.linspace(0, 1, 25), np.linspace(0, 1, 7), np.linspace(0, 1, 3), indexing="ij")
    angle, radius = np.pi * np.clip(3 * u - 1, 0, 1), 0.2 + 2 * w
    straight = 12 * (np.minimum(u, 1 / 3) - 1 / 3) - 12 * (np.maximum(u, 2 / 3) - 2 / 3)
    at = np.stack([straight + radius * np.sin(angle), 8 * v, -radius * np.cos(angle)], axis=-1)
    rng = np.random.default_rng(1)
    at[1:-1, 1:-1, 1] += rng.uniform(-0.5, 0.5, at[1:-1, 1:-1, 1].shape)
    mesh = Mesh(at.reshape(-1, 3, order="F"), "hex8", structure=(25, 7, 3))
    mesh = mesh if mesh.volume_mm3 > 0 else Mesh(at[::-1].reshape(-1, 3, order="F"), "hex8", structure=(25, 7, 3))
    made, report = optimize(mesh, device)
    assert report.after > report.before + 0.1 and report.boundary_mm < 0.02
    upper = np.abs(mesh.points[:, 2] - 0.2) < 1e-6
    assert upper.sum() > 30 and (made.points[upper, 2] > 0).all()


def test_a_boundary_that_stays(device):
    mesh = jittered()
    made, report = optimize(mesh, device, boundary="stay")
    on = np.unique(mesh.boundary())
    assert np.array_equal(made.points[on], mesh.points[on])
    assert report.after > report.before and report.boundary_mm < 1e-4


def test_same_mesh_each_time(device):
    first, second = (optimize(jittered(), device)[0].points for _ in range(2))
    assert np.array_equal(first, second)


def test_a_perfect_mesh_stays_as_it_is(device):
    mesh = jittered(noise=0.0)
    made, report = optimize(mesh, device)
    assert report.after == pytest.approx(1.0, abs=1e-5) and np.abs(made.points - mesh.points).max() < 1e-3


def test_curved_elements_and_other_words_are_refused(device):
    curved = Mesh(np.zeros((8, 3)), "quad8", connectivity=np.arange(8)[None])
    with pytest.raises(InputError, match=r"hex8 or quad4 .* --order 1"):
        optimize(curved, device)
    with pytest.raises(InputError, match="slide or stay"):
        optimize(jittered(), device, boundary="fly")


def test_colours_of_nodes():
    mesh = jittered()
    colours = colour_nodes(mesh.cells, mesh.n_nodes)
    assert all(len(set(row)) == 8 for row in colours[mesh.cells])
    assert colours.max() < 27 and np.array_equal(colours, colour_nodes(mesh.cells, mesh.n_nodes))


def test_a_box_has_six_smooth_parts():
    mesh = jittered(noise=0.0)
    quads = mesh.boundary()
    parts = smooth_parts(mesh.points, quads, edges_of(quads))
    assert sorted(np.bincount(parts)) == [20, 20, 24, 24, 30, 30]
    assert np.bincount(parts)[0] == 30


def test_fields_of_nodes_that_did_not_move():
    mesh = jittered()
    assert np.array_equal(carry_fields(mesh, mesh.points)["HU"], mesh.fields["HU"])
