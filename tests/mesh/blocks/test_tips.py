"""Spikes thinner than an element, which smoothing takes away: a node is drawn out to each."""

from dataclasses import replace

import numpy as np
import pytest

from gpubspline.ct.region import Region
from gpubspline.device import Device
from gpubspline.mesh.blocks import tips
from gpubspline.mesh.blocks.curved import curve
from gpubspline.mesh.blocks.level_set import LevelSet
from gpubspline.mesh.blocks.mesher import blocks_mesh
from gpubspline.mesh.blocks.refine import refine
from gpubspline.mesh.blocks.result import Blocks
from gpubspline.mesh.blocks.tips import OUT, draw_out, stand_out
from gpubspline.mesh.coverage import cover
from gpubspline.mesh.floors import Placed
from gpubspline.mesh.movable import Movable
from gpubspline.mesh.quality import assess
from gpubspline.mesh.validity import certify

SIZE = 2.0


def spiky(length_mm: float) -> Region:
    """A ball of 14 mm with a spike 1 mm thick, half an element, so long, and one twice as thick askew."""
    lines = [np.arange(-14.0, 14.1, 0.5)] * 3
    z, y, x = np.meshgrid(*lines, indexing="ij")
    top = 7.0 + length_mm
    spike = np.maximum(np.hypot(x, y) - 0.5, np.maximum(z - top, -z))
    along = (x + y - z) / np.sqrt(3)
    thick = np.maximum(np.sqrt(np.maximum(x**2 + y**2 + z**2 - along**2, 0)) - 1.0, np.maximum(along - top, -along))
    distance = np.minimum(np.sqrt(x**2 + y**2 + z**2) - 7.0, np.minimum(spike, thick)).astype(np.float32)
    affine = np.diag([0.5, 0.5, 0.5, 1.0])
    affine[:3, 3] = -14.0
    return Region(distance < 0, distance, affine)


def left_out(made: Blocks, region: Region, device: Device) -> float:
    """By how many elements the region stands out of the mesh, by the way that the summary measures it."""
    return max((out for _, out in cover(made.mesh, region, device, OUT * SIZE).lost), default=0.0) / SIZE


@pytest.mark.parametrize("device", ["opencl"], indirect=True)
def test_a_node_is_drawn_out_to_each_spike_and_stays(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    region = spiky(3.6)
    made = blocks_mesh(region, SIZE, device=device)
    assert left_out(made, region, device) == 0
    mesh, quality = assess(made.mesh, device)
    assert quality.min >= 0.60 and made.report.euler == {"mesh": 1, "region": 1}
    assert mesh.volume_mm3 == pytest.approx(region.volume_mm3, rel=0.02)
    assert np.array_equal(blocks_mesh(region, SIZE, device=device).mesh.points, made.mesh.points)
    fine = refine(made, 2, device=device)
    assert fine.report.min_scaled_jacobian >= 0.60 and certify(fine.mesh, device).certificate.valid
    np.testing.assert_allclose(fine.mesh.points[made.tips], made.mesh.points[made.tips], atol=1e-4)
    for mesh in (fine.mesh, curve(made, device=device).sample(1, "hex27")):
        assert left_out(replace(made, mesh=mesh), region, device) == 0
    monkeypatch.setattr("gpubspline.mesh.blocks.grow.draw_out", lambda hexes, best, level: best)
    assert left_out(blocks_mesh(region, SIZE, attempts=1, device=device), region, device) > 1.3


@pytest.mark.parametrize("device", ["opencl"], indirect=True)
def test_what_is_too_long_for_a_node_is_listed(device: Device) -> None:
    region = spiky(6.5)
    made = blocks_mesh(region, SIZE, attempts=1, device=device)
    assert assess(made.mesh, device)[1].min >= 0.60
    assert left_out(made, region, device) > 1.2


@pytest.mark.parametrize("device", ["opencl"], indirect=True)
def test_a_tip_is_followed_as_cheaply_as_it_can_be_and_only_where_it_must(
    device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of all ways the one that leaves the best hexes; where the tip may stand out, none that leaves them worse."""
    seen = []

    def drawn(hexes: Movable, best: Placed, level: LevelSet) -> Placed:
        made = draw_out(hexes, best, level)
        seen.append((best.least, made.least))
        return made

    monkeypatch.setattr("gpubspline.mesh.blocks.grow.draw_out", drawn)
    region, out = spiky(4.0), []
    for name, value in (("WAYS", tips.WAYS[:1]), ("CHEAP", 1.0), ("MOST_LOST", 9.0)):
        with monkeypatch.context() as patched:
            patched.setattr(tips, name, value)
            patched.setattr(tips, "WANTED", 0.66 if name != "MOST_LOST" else 1.0)
            out.append(left_out(blocks_mesh(region, SIZE, attempts=1, device=device), region, device))
    (before, one), (_, all_ways), (_, refused) = seen
    assert 0.6 <= one < all_ways - 0.02 < before and refused >= before
    assert max(out[:2]) <= tips.MOST_LOST and out[2] > 1.3


def test_places_that_stand_out_by_hand(device: Device) -> None:
    """Of a cube of one element: below, above, within, and beside an edge."""
    points = np.array([[x, y, z] for z in (0, 1) for y, x in ((0, 0), (0, 1), (1, 1), (1, 0))], dtype=np.float64)
    cells = np.arange(8, dtype=np.int32)[None]
    places = np.array([[0.5, 0.5, 2.3], [0.5, 0.5, 1.9], [0.5, 0.5, 0.5], [2.0, 2.0, 0.5]])
    at, out = stand_out(points, cells, places, device)
    np.testing.assert_allclose(at, places[[0, 3]])
    np.testing.assert_allclose(out, [1.3, np.sqrt(2)], rtol=1e-5)


def test_points_are_brought_to_the_region() -> None:
    region = spiky(3.0)
    level = LevelSet(np.zeros((4, 4, 4), np.float32), SIZE, np.diag([SIZE, SIZE, SIZE, 1.0]), region)
    near, far = np.array([0.0, 0.0, -3.3]), np.array([0.0, 0.0, -1.0])
    assert abs(level.region_distance(level.on_region(near)[None])[0]) < 0.01
    assert np.array_equal(level.on_region(far), far)
    assert np.isinf(LevelSet(level.phi, SIZE, level.to_mm).region_distance(near[None])).all()
    assert len(level.places) > 100 and np.abs(level.region_distance(level.places)).max() < 0.05
