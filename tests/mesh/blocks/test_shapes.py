"""Blocks of shapes that nothing is tuned to: thin walls, rods, knots, branches, handles, sharp edges, a tip."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from gpubspline.ct.region import Region
from gpubspline.device import BACKENDS, Device
from gpubspline.mesh.blocks.chords import measure_chords
from gpubspline.mesh.blocks.level_set import SAMPLES, level_set
from gpubspline.mesh.blocks.mesher import blocks_mesh
from gpubspline.mesh.distance import surface_distance
from gpubspline.mesh.quality import assess

Floats = NDArray[np.float64]
Distance = Callable[[Floats], Floats]
TURN = Rotation.from_rotvec([0.2, 0.4, 0.6]).as_matrix()


def sampled(distance: Distance, reach: tuple[float, float, float], spacing: float = 0.5) -> Region:
    """Region of a body round the origin by its distance at points (..., 3)."""
    lines = [np.arange(-r, r + spacing / 2, spacing) for r in reach]
    points = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).transpose(2, 1, 0, 3)
    values = np.ascontiguousarray(distance(points), dtype=np.float32)
    affine = np.diag([spacing, spacing, spacing, 1.0])
    affine[:3, 3] = [line[0] for line in lines]
    return Region(values < 0, values, affine)


def box(points: Floats, half: tuple[float, float, float]) -> Floats:
    out = np.abs(points) - half
    return np.asarray(np.linalg.norm(np.maximum(out, 0), axis=-1) + np.minimum(out.max(axis=-1), 0))


def rod(points: Floats, line: Floats, radius: float) -> Floats:
    return np.asarray(KDTree(line).query(points)[0] - radius)


def tube(points: Floats) -> Floats:
    """Its wall is 2.5 mm thick."""
    x, y, z = np.moveaxis(points @ TURN, -1, 0)
    return np.asarray(np.maximum(np.abs(np.hypot(x, y) - 5) - 1.25, np.abs(z) - 5))


def cup(points: Floats) -> Floats:
    """Half a hollow ball."""
    return np.asarray(np.maximum(np.abs(np.linalg.norm(points, axis=-1) - 7) - 1.25, (points @ TURN)[..., 2]))


def plate(points: Floats) -> Floats:
    return box(points @ TURN, (10.0, 7.0, 1.25))


def knot(points: Floats) -> Floats:
    """A trefoil of rods 6 mm thick."""
    t = np.linspace(0, 2 * np.pi, 2000)
    away = 14 + 6 * np.cos(3 * t)
    return rod(points, np.stack([away * np.cos(2 * t), away * np.sin(2 * t), 6 * np.sin(3 * t)], axis=1), 3.0)


def star(points: Floats) -> Floats:
    """Five arms, two of them close."""
    ends = np.array([[1, 0, 0], [-0.5, 0.87, 0], [-0.5, -0.87, 0], [0, 0, 1], [0.6, 0.6, -0.6]])
    ends *= 14 / np.linalg.norm(ends, axis=1, keepdims=True)
    return rod(points, np.concatenate([np.linspace(0, end, 400) for end in ends]), 3.0)


def two_rings(points: Floats) -> Floats:
    x, y, z = np.moveaxis(points, -1, 0)
    rings = [np.hypot(np.hypot(x - side, y) - 8, z) - 3.2 for side in (-9, 9)]
    return np.asarray(np.minimum(*rings))


def cube(points: Floats) -> Floats:
    return box(points @ TURN, (5.5, 5.5, 5.5))


def twisted(points: Floats) -> Floats:
    """A square prism that turns by 90 degrees: its edges are sharp. Not a distance away from it, but near it."""
    x, y, z = np.moveaxis(points, -1, 0)
    angle = np.pi / 2 * z / 28
    turned = np.stack(
        [np.cos(angle) * x + np.sin(angle) * y, np.cos(angle) * y - np.sin(angle) * x, z],
        axis=-1,
    )
    return 0.9 * box(turned, (7.0, 7.0, 14.0))


def cone(points: Floats) -> Floats:
    """Its tip, of 53 degrees, and the edge of its base are as sharp as can be."""
    x, y, z = np.moveaxis(points, -1, 0)
    return np.asarray(np.maximum(((np.hypot(x, y) - 10) * 20 + (z + 10) * 10) / np.hypot(20, 10), -10 - z))


BODIES: dict[str, tuple[Distance, tuple[float, float, float], float, int, float]] = {
    "tube": (tube, (10, 10, 10), 1.0, 0, 0.05),
    "cup": (cup, (10, 10, 10), 1.0, 1, 0.05),
    "plate": (plate, (12, 12, 12), 1.0, 1, 0.06),
    "knot": (knot, (24, 24, 10), 2.4, 0, 0.06),
    "star": (star, (18, 18, 18), 2.2, 1, 0.06),
    "two rings": (two_rings, (22, 12, 5), 2.0, -1, 0.05),
    "cube": (cube, (11, 11, 11), 1.0, 1, 0.07),
    "twisted": (twisted, (11, 11, 18), 1.8, 1, 0.08),
    "cone": (cone, (12, 12, 12), 1.2, 1, 0.12),
}
"""Distance, extent in mm, element size, Euler characteristic, and mean distance of the surface, in elements.

Where edges are sharp, elements cannot follow: 0.6 of an element is rounded, and the more of a surface is edge, the
farther it is on average.
"""


# backends in turn: that they mesh alike is test_real's
@pytest.mark.parametrize(
    ("name", "device"), [(name, BACKENDS[n % 2]) for n, name in enumerate(BODIES)], indirect=["device"]
)
def test_shapes_that_nothing_is_tuned_to(name: str, device: Device) -> None:
    distance, reach, size, euler, mean = BODIES[name]
    region = sampled(distance, reach)
    made = blocks_mesh(region, size, device=device)
    mesh, quality = assess(made.mesh, device)
    assert quality.inverted == 0 and quality.min >= 0.60
    assert mesh.volume_mm3 == pytest.approx(region.volume_mm3, rel=0.01)
    assert surface_distance(mesh, region, device).mean <= mean * size
    assert made.report.euler == {"mesh": euler, "region": euler}
    assert not made.report.lost_features


def test_a_thin_plate_keeps_its_thickness(device: Device) -> None:
    """Smoothing alone draws its sides apart by 0.04 of an element each."""
    region = sampled(lambda points: box(points, (10.0, 10.0, 1.25)), (12, 12, 3), 0.25)
    level = level_set(region, 1.0, offset=(0.3, 0.3, 0.3), device=device)
    _, n_j, n_i = (n // 2 for n in level.phi.shape)
    column = level.phi[:, n_j, n_i].astype(float)
    crossings = np.flatnonzero((column[:-1] < 0) != (column[1:] < 0))
    low, high = (k + column[k] / (column[k] - column[k + 1]) for k in crossings)
    assert (high - low) / SAMPLES == pytest.approx(2.5, abs=0.02)


@pytest.mark.parametrize("device", ["opencl"], indirect=True)
def test_faces_of_a_rod_are_measured_while_they_cut_off_much(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two elements thick: what one round leaves another brings in. Its axis lies where rounding chooses no cell."""
    line = np.tile([1.1, 0.9, 0.1], (2401, 1))
    line[:, 2] += np.linspace(-12, 12, len(line))
    region = sampled(lambda points: rod(points, line, 3.0), (8, 8, 18), 1.0)

    def off() -> float:
        return abs(blocks_mesh(region, 3.0, attempts=1, device=device).mesh.volume_mm3 / region.volume_mm3 - 1)

    most = off()
    monkeypatch.setattr("gpubspline.mesh.blocks.place.ROUNDS", 1)
    assert most < 0.003 < off()


def test_chords_of_flat_faces_are_their_distance() -> None:
    """A unit cube within a plane level 0.1 farther out on one side: all that is missing lies there."""
    corners = np.array([[i, j, k] for k in (0, 1) for j in (0, 1) for i in (0, 1)], dtype=float) + 3
    quads = np.array(
        [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]], dtype=np.int32
    )
    k, j, i = np.indices((22, 22, 22)) / SAMPLES
    sides = np.stack([3 - i, i - 4.1, 3 - j, j - 4, 3 - k, k - 4])
    level = sides.max(axis=0).astype(np.float32)
    chords = measure_chords(corners, quads, level, 1.1)
    assert chords.areas == pytest.approx(np.ones(6))
    assert chords.volume == pytest.approx(-0.1)
    assert np.argmin(chords.off) == 5 and chords.off[5] < chords.off[:5].min() - 0.04
    assert 0.04 < np.abs(chords.added_to(level) - level).max() <= 0.25


def fin(points: Floats) -> Floats:
    """A cube with a sheet of 0.8 mm, askew: half an element thick."""
    turned = points @ TURN
    away = np.array([6.0, 0.0, 0.0])
    return np.asarray(np.minimum(box(turned + away, (4.0, 4.0, 4.0)), box(turned - away / 2, (7.0, 6.0, 0.4))))


@pytest.mark.parametrize("device", ["opencl"], indirect=True)
def test_a_sheet_of_half_an_element_is_not_swollen(device: Device) -> None:
    """Hexes asked to be as long as others pushed its sides out: 16 % of the whole volume."""
    region = sampled(fin, (13, 13, 13))
    made = blocks_mesh(region, 1.5, device=device)
    mesh, quality = assess(made.mesh, device)
    assert quality.inverted == 0 and quality.min >= 0.6
    assert mesh.volume_mm3 == pytest.approx(region.volume_mm3, rel=0.05)
    assert made.report.euler["mesh"] == made.report.euler["region"]
