"""Bezier blocks: exact where they can be, C0 however hexes are turned, on the surface to the order of the degree."""

from itertools import permutations, product

import numpy as np
import pytest

from gpubspline.device import Device
from gpubspline.errors import InputError
from gpubspline.mesh.bezier import KEPT, BezierBlocks, bezier_blocks
from gpubspline.mesh.mesh import Mesh
from gpubspline.mesh.quality import scaled_jacobian
from gpubspline.mesh.shared_lattice import CORNERS, SharedLattice
from gpubspline.mesh.validity import certify
from gpubspline.spline.hyperpatch import bezier

RADIUS = 10.0


def grid(counts: tuple[int, int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Points and hexes of a grid of unit cells."""
    number = np.arange(np.prod(counts)).reshape(counts)
    points = np.stack(np.meshgrid(*map(np.arange, counts), indexing="ij"), axis=-1).reshape(-1, 3).astype(float)
    u, v, w = (n - 1 for n in counts)
    hexes = np.stack([number[a : a + u, b : b + v, c : c + w].ravel() for a, b, c in CORNERS], axis=1)
    return points, hexes


def turned(hexes: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Each hex numbered from another corner and along other axes, as any of the 24 rotations of a cube has it."""
    rotations = []
    for axes, signs in product(permutations(range(3)), product((1, -1), repeat=3)):
        matrix = np.eye(3)[list(axes)] * signs
        if np.linalg.det(matrix) > 0:
            moved = (2 * CORNERS - 1) @ matrix
            rotations.append([int(np.flatnonzero((row == 2 * CORNERS - 1).all(axis=1))[0]) for row in moved])
    chosen = np.array(rotations)[rng.integers(0, 24, len(hexes))]
    assert len(rotations) == 24
    return np.take_along_axis(hexes, chosen, axis=1)


def ball() -> Mesh:
    """Seven blocks: a cube, and one on each of its faces that reaches the sphere."""
    inner = (2.0 * CORNERS - 1) * 3.0
    outer = (2.0 * CORNERS - 1) * RADIUS / np.sqrt(3)
    points = np.concatenate([inner, outer])
    sides = [(0, 4, 7, 3), (1, 2, 6, 5), (0, 1, 5, 4), (3, 7, 6, 2), (0, 3, 2, 1), (4, 5, 6, 7)]
    hexes = [range(8)] + [[*side, *(corner + 8 for corner in side)] for side in sides]
    core = np.array([0], dtype=np.int32)
    return Mesh(points, "hex8", connectivity=np.array(hexes), element_sets={"core": core})


def on_sphere(points: np.ndarray, normals: np.ndarray | None = None) -> np.ndarray:
    return points * (RADIUS / np.linalg.norm(points, axis=1))[:, None]


@pytest.mark.parametrize("degree", [1, 2, 3, 4])
def test_points_of_a_lattice_are_shared_however_the_hexes_are_turned(degree: int) -> None:
    rng = np.random.default_rng(degree)
    points, hexes = grid((3, 4, 3))
    renamed = rng.permutation(len(points))
    hexes, points = turned(renamed[hexes], rng), points[np.argsort(renamed)]
    lattice = SharedLattice(hexes, len(points), degree)
    t = np.linspace(0, 1, degree + 1)
    a, b, c = np.meshgrid(t, t, t, indexing="ij")
    shape = np.stack([(a if x else 1 - a) * (b if y else 1 - b) * (c if z else 1 - c) for x, y, z in CORNERS], axis=-1)
    places = np.einsum("abck,mkx->mabcx", shape, points[hexes])
    found = np.full((lattice.starts[-1], 3), np.nan)
    found[lattice.numbers] = places
    assert lattice.starts[-1] == np.prod([degree * (n - 1) + 1 for n in (3, 4, 3)])
    assert np.allclose(found[lattice.numbers], places, atol=1e-12)
    box = np.array([2.0, 3.0, 2.0])
    assert np.array_equal(lattice.on_boundary, np.any((np.abs(found) < 1e-9) | (np.abs(found - box) < 1e-9), axis=1))


@pytest.mark.parametrize("degree", [1, 2, 3])
@pytest.mark.parametrize("element_type", ["hex8", "hex20", "hex27"])
def test_blocks_of_straight_hexes_are_those_hexes(degree: int, element_type: str, device64: Device) -> None:
    rng = np.random.default_rng(3)
    points, hexes = grid((3, 3, 4))
    points += rng.uniform(-0.15, 0.15, points.shape)
    mesh = Mesh(points, "hex8", connectivity=turned(hexes, rng))
    blocks = bezier_blocks(mesh, lambda at, normals: at, degree)
    fine = blocks.sample(3, element_type)
    assert fine.n_elements == 27 * mesh.n_elements
    assert fine.volume_mm3 == pytest.approx(mesh.volume_mm3, rel=1e-12)
    assert scaled_jacobian(fine, device64).min() > 0.3


def test_a_block_is_a_bezier_hyperpatch(device64: Device) -> None:
    blocks = bezier_blocks(ball(), on_sphere, 3)
    number, t = 4, np.linspace(0, 1, 5)
    control = np.concatenate([blocks.block(number), np.zeros((4, 4, 4, 1))], axis=-1)
    patch = bezier(control).evaluate_grid([t, t, t], device64)[..., :3]
    ours = blocks.sample(4)
    own = ours.points[np.unique(ours.cells[number * 64 : (number + 1) * 64])]
    nearest = np.linalg.norm(patch.reshape(-1, 1, 3) - own[None], axis=2).min(axis=1)
    assert len(own) == 125 and nearest.max() < 1e-12


def test_the_surface_is_met_at_the_order_of_the_degree() -> None:
    """Chords of a sphere leave it by h^2, quadratics and cubics by h^4: each halving gains 4 and 16."""
    off: dict[int, list[float]] = {}
    for degree, refinement in product((1, 2, 3), (4, 8)):
        mesh = bezier_blocks(ball(), on_sphere, 1).sample(refinement, exact=True)
        fine = bezier_blocks(mesh, on_sphere, degree).sample(4)
        surface = fine.points[np.unique(fine.boundary())]
        off.setdefault(degree, []).append(float(np.abs(np.linalg.norm(surface, axis=1) - RADIUS).max()))
    gains = {degree: coarse / finer for degree, (coarse, finer) in off.items()}
    assert gains[1] > 3 and gains[2] > 11 and gains[3] > 11
    assert max(off[2][1], off[3][1]) < off[1][1] / 500


def test_curved_elements_fill_a_ball() -> None:
    exact = 4 / 3 * np.pi * RADIUS**3
    mesh = bezier_blocks(ball(), on_sphere, 1).sample(4, exact=True)
    blocks = bezier_blocks(mesh, on_sphere, 2)
    assert mesh.volume_mm3 < 0.95 * exact
    assert blocks.sample(1, "hex27").volume_mm3 == pytest.approx(exact, rel=2e-4)
    assert blocks.sample(1, "hex20").volume_mm3 == pytest.approx(exact, rel=2e-3)


def wild(points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Onto the sphere, but on one side by way of places up to three away: blocks that follow it fold."""
    return on_sphere(points + 3 * np.sin(points[:, [1, 2, 0]]) * (points[:, :1] > 3))


@pytest.mark.parametrize("degree", [2, 3])
def test_points_are_held_back_where_a_block_would_fold(
    degree: int, monkeypatch: pytest.MonkeyPatch, device64: Device
) -> None:
    mesh = bezier_blocks(ball(), on_sphere, 1).sample(3, exact=True)
    straight = certify(mesh, device64)

    def least(blocks: BezierBlocks) -> np.ndarray:
        if degree == 2:
            return certify(blocks.sample(1, "hex27"), device64).lower - KEPT * straight.lower
        return scaled_jacobian(blocks.sample(4), device64)

    held = bezier_blocks(mesh, wild, degree)
    assert least(held).min() > -1e-9
    assert scaled_jacobian(held.sample(3, exact=True), device64).min() > 0
    firm = bezier_blocks(mesh, wild, degree, floor=0.4).sample(4)  # no straight one is below
    assert scaled_jacobian(held.sample(4), device64).min() < 0.35 and scaled_jacobian(firm, device64).min() > 0.39
    count = held.lattice.on_boundary.sum()
    assert 0 < held.held_back["count"] < count and 0 < held.held_back["max_mm"] < 3 * np.sqrt(3)
    monkeypatch.setattr("gpubspline.mesh.bezier.KEPT", -np.inf)
    assert least(bezier_blocks(mesh, wild, degree, floor=-np.inf)).min() < 0
    assert bezier_blocks(mesh, on_sphere, degree).held_back == {"count": 0, "max_mm": 0.0}


def test_corners_that_stay_keep_what_is_near_them() -> None:
    """A corner drawn out to 1.3 radii: edges to it stay about straight, all else is on the sphere."""
    mesh = bezier_blocks(ball(), on_sphere, 1).sample(4, exact=True)
    tip = int(np.argmax(mesh.points[:, 2]))
    mesh.points[tip] *= 1.3
    blocks = bezier_blocks(mesh, on_sphere, 2, stay=np.array([tip]))
    assert blocks.held_back == {"count": 0, "max_mm": 0.0}  # what stays on purpose is not
    fine = blocks.sample(3, exact=True)
    np.testing.assert_allclose(fine.points[tip], mesh.points[tip])
    radii = np.linalg.norm(fine.points[np.unique(fine.boundary())], axis=1)
    off = np.abs(radii - RADIUS) > 1e-6 * RADIUS
    assert 1 + 4 * 2 + 4 * 4 <= np.count_nonzero(off) <= 1 + 4 * 2 + 4 * 6  # of four faces, their far sides are on it
    assert np.sort(radii)[-5:].min() > 1.1 * RADIUS
    every = bezier_blocks(mesh, on_sphere, 2).sample(3, exact=True)
    assert np.ptp(np.linalg.norm(every.points[np.unique(every.boundary())], axis=1)) < 1e-6 * RADIUS


def test_sets_follow_the_blocks() -> None:
    fine = bezier_blocks(ball(), on_sphere, 2).sample(3)
    core = fine.points[fine.cells[fine.element_sets["core"]]]
    assert len(core) == 27 and np.abs(core).max() == pytest.approx(3.0)


def test_what_cannot_be_is_refused() -> None:
    with pytest.raises(InputError, match="degree of 1 to 3"):
        bezier_blocks(ball(), on_sphere, 4)
    with pytest.raises(InputError, match="density of 1 or more"):
        bezier_blocks(ball(), on_sphere).sample(0)
    with pytest.raises(InputError, match="expected hexes"):
        bezier_blocks(ball(), on_sphere).sample(2, "quad4")
