"""Short edges that scaled Jacobians do not see are drawn out."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gpubspline.device import Device
from gpubspline.mesh import floors
from gpubspline.mesh.even import GIVEN, even_out
from gpubspline.mesh.floors import RINGS, Effort, climb, placed
from gpubspline.mesh.movable import FIXED, FREE, Movable, movable, put_level
from gpubspline.mesh.neighbourhood import (
    edge_lengths,
    hexes_round,
    least_determinant,
    neighbourhood,
    target_lengths,
)

CORNERS = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1))


def grid(n: int, device: Device) -> tuple[np.ndarray, np.ndarray, Movable]:
    """Points and slack of n x n x n nodes, a unit apart, those outside fixed, and their hexes."""
    number = np.arange(n**3).reshape(n, n, n)
    points = np.stack(np.meshgrid(*[np.arange(n)] * 3, indexing="ij"), axis=-1).reshape(-1, 3).astype(float)
    hexes = np.stack([number[a : a + n - 1, b : b + n - 1, c : c + n - 1].ravel() for a, b, c in CORNERS], axis=1)
    slack = np.where(np.any((points == 0) | (points == n - 1), axis=1), FIXED, FREE)
    level = put_level(np.ones((2, 2, 2)), np.eye(4)[:3], device)
    return points, slack, movable(hexes.astype(np.int32), len(points), slack, level, device)


def test_lengths_and_determinants(device: Device) -> None:
    points, _, hexes = grid(3, device)
    lengths = edge_lengths(points * (1.0, 2.0, 3.0), hexes.cells)
    assert np.array_equal(lengths, np.broadcast_to(np.array([1.0, 2.0, 3.0])[:, None, None], (3, 8, 4)))
    turned = Rotation.from_euler("xyz", [0.3, 0.5, -0.2]).apply(points)
    assert np.allclose(least_determinant(turned, hexes.cells), 1)
    points[13] += 0.2  # the one in the middle
    last = points[hexes.cells[-1]]
    edges = [
        [last[CORNERS.index(flipped(corner, axis))] - last[i] for axis in range(3)] for i, corner in enumerate(CORNERS)
    ]
    ours = np.abs(np.linalg.det(edges))
    assert least_determinant(points, hexes.cells)[-1] == pytest.approx(ours.min() / ours.mean())


def flipped(corner: tuple[int, int, int], axis: int) -> tuple[int, ...]:
    """The corner at the other end of the edge along an axis."""
    return tuple(1 - c if i == axis else c for i, c in enumerate(corner))


def test_a_neighbourhood_keeps_its_rim(device: Device) -> None:
    points, slack, hexes = grid(8, device)
    chosen = np.zeros(7**3, dtype=bool)
    chosen[7**3 // 2] = True
    near = neighbourhood(hexes, slack, hexes_round(hexes, chosen, 1))
    assert len(near.elements) == 27 and len(near.nodes) == 64
    assert np.array_equal(points[near.nodes][near.hexes.cells], points[hexes.cells[near.elements]])
    assert np.count_nonzero(near.slack == FREE) == 8 and np.count_nonzero(near.slack == FIXED) == 56
    assert np.allclose(target_lengths(near.hexes), 1)
    colours = near.colours[near.hexes.cells]
    assert all(len(set(row)) == 8 for row in colours.tolist())


def test_few_hexes_below_a_floor_are_raised_alone(monkeypatch, device: Device) -> None:
    """One node astray in a large grid: what is farther than the rings stays, to the last bit, and the floor is met."""
    monkeypatch.setattr(floors, "MANY", 9_000)
    points, slack, hexes = grid(22, device)
    middle = np.array([11, 11, 11])
    points[np.all(points == middle, axis=1)] += (0.7, 0.6, 0.5)
    colours = (points.astype(int) % 2) @ np.array([1, 2, 4])
    before = placed(hexes, device.put(points.T), slack)
    assert before.least < 0.2
    after = climb(hexes, colours, before, Effort())
    assert after.least >= 0.7
    moved = np.array(device.get(after.x)).reshape(3, -1).T
    far = np.abs(points - middle).max(axis=1) > RINGS + 2
    assert np.array_equal(moved[far], points[far].astype(np.float32)) and far.mean() > 0.75
    whole = climb(hexes, colours, placed(hexes, device.put(points.T), slack), Effort(few=0.0))
    assert whole.least >= 0.7 and np.any(np.array(device.get(whole.x)).reshape(3, -1).T[far] != moved[far])


def test_a_squeezed_edge_is_drawn_out(device: Device) -> None:
    """A node next to its neighbour leaves right angles right, and determinants there a twentieth."""
    points, slack, hexes = grid(7, device)
    lines = points[:, 0] == 3
    points[lines, 0] = 2.05
    inner = lines & (slack == FREE)
    squeezed = placed(hexes, device.put(points.T), slack)
    points[lines & ~inner, 0] = 3.0
    mended = even_out(hexes, placed(hexes, device.put(points.T), slack))
    before = least_determinant(points, hexes.cells).min()
    moved = np.array(device.get(mended.x)).reshape(3, -1).T
    assert squeezed.least > 0.99 and before < 0.1
    assert least_determinant(moved, hexes.cells).min() > 0.3
    assert mended.least >= placed(hexes, device.put(points.T), slack).least - GIVEN
    assert np.allclose(moved[slack == FIXED], points[slack == FIXED], atol=1e-6)
    again = even_out(hexes, mended)
    assert again is mended
