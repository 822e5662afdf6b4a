"""Places of the lattice: as given first, then shifted and turned; which mesh is kept."""

import numpy as np
import pytest

from gpubspline.bench.bench_blocks import three_arms
from gpubspline.device import Device
from gpubspline.mesh.blocks import merit
from gpubspline.mesh.blocks.mesher import blocks_mesh
from gpubspline.mesh.blocks.placement import placement


def test_places_are_spread_and_the_same_each_time() -> None:
    places = [placement(number) for number in range(400)]
    assert places[0].offset == places[0].turn_degrees == (0.0, 0.0, 0.0)
    assert np.array_equal(places[0].axes(None), np.eye(3))
    for place in places:
        axes = place.axes(None)
        assert np.allclose(axes @ axes.T, np.eye(3), atol=1e-12) and np.linalg.det(axes) == pytest.approx(1)
    directions = np.array([place.axes(None)[:, 2] for place in places[1::2]])
    assert np.linalg.norm(directions.mean(axis=0)) < 0.15  # turned axes look everywhere
    offsets = np.array([place.offset for place in places[::2]])
    assert offsets.min() >= 0 and offsets.max() < 1 and np.abs(offsets.mean(axis=0) - 0.5).max() < 0.1
    given = placement(3).axes(None)
    assert np.allclose(placement(1).axes(given), placement(1).axes(None) @ given)


def test_the_best_place_is_kept(monkeypatch: pytest.MonkeyPatch, device: Device) -> None:
    """Where nothing is good enough all places are tried, and the mesh is that of the best."""
    monkeypatch.setattr(merit, "GOOD", 2.0)
    made = blocks_mesh(three_arms(), 5.0, attempts=3, device=device)
    tried = made.report.attempts
    assert len(tried) == 3 and [attempt.placement.turn_degrees == (0, 0, 0) for attempt in tried] == [True, False, True]
    reached = [attempt.min_scaled_jacobian or 0.0 for attempt in tried]
    assert made.report.min_scaled_jacobian == pytest.approx(max(reached), abs=0.01)
    assert made.mesh.n_elements == tried[int(np.argmax(reached))].elements
    axes = made.level.axes
    assert np.allclose(axes, placement(int(np.argmax(reached))).axes(None))


def test_a_place_that_keeps_the_volume_is_kept(monkeypatch: pytest.MonkeyPatch, device: Device) -> None:
    """Better hexes do not make up for volume: the first place has the best of three, and is 4 to 6 % off.

    As rounding has it, which moves a mesh so coarse: a GPU gives 4 %.
    """
    monkeypatch.setattr(merit, "GOOD", 2.0)
    region = three_arms()
    first, made = (blocks_mesh(region, 6.2, attempts=most, device=device) for most in (1, 3))
    assert made.report.min_scaled_jacobian < first.report.min_scaled_jacobian - 0.01
    off = [abs(one.mesh.volume_mm3 / region.volume_mm3 - 1) for one in (first, made)]
    assert off[0] > 0.03 > 0.02 > off[1]


def test_large_meshes_are_not_made_again(monkeypatch: pytest.MonkeyPatch, device: Device) -> None:
    monkeypatch.setattr(merit, "GOOD", 2.0)
    monkeypatch.setattr(merit, "MOST_TRIED", 100)
    assert len(blocks_mesh(three_arms(), 3.0, device=device).report.attempts) == 1
