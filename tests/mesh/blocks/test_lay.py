"""Lattices are laid before hexes are made: which loses least is grown first, and why is told."""

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.ndimage import label

from gpubspline.bench.bench_blocks import thin_ablations, thin_features, three_arms
from gpubspline.ct.region import Region
from gpubspline.device import Device
from gpubspline.errors import MeshError
from gpubspline.mesh.blocks import merit
from gpubspline.mesh.blocks.core import cell_means
from gpubspline.mesh.blocks.grow import find_core
from gpubspline.mesh.blocks.lay import Laid, Prospect, in_turn, joined_by_faces, lay, mended, thickened
from gpubspline.mesh.blocks.level_set import level_set
from gpubspline.mesh.blocks.mesher import blocks_mesh, size_that_keeps_topology
from gpubspline.mesh.blocks.placement import placement
from gpubspline.mesh.blocks.repair import SOUND, patterns
from gpubspline.mesh.blocks.result import Attempt


@dataclass
class Told:
    number: int
    wrong: float

    @property
    def attempt(self) -> Attempt:
        return Attempt(placement(self.number), 8, None, 1)


@pytest.mark.parametrize(
    ("losses", "turns", "laid"),
    [
        ([0, 3, 2], [0, 1, 2], [0, 1, 2]),  # the first is right: the others as they come
        ([4, 3, 0, 1], [2, 3, 1, 0], [0, 1, 2, 3, 1, 0]),  # all until one is right, which is not laid again
        ([4, None, 2], [2, 0, None], [0, 1, 2, 0]),
        ([None], [None], [0]),
    ],
)
def test_places_come_by_what_they_lose(losses, turns, laid):
    asked = []

    def lay(number):
        asked.append(number)
        if losses[number] is None:
            raise MeshError("no core")
        return Told(number, losses[number])

    given = []
    for found in in_turn(lay, len(losses)):
        number = found.lay().number if isinstance(found, Prospect) else None
        given.append(number)
        assert number is None or (
            found.wrong == losses[number] and found.attempt.placement.offset == placement(number).offset
        )
    assert given == turns and asked == laid


def test_a_place_that_is_passed_over_is_not_laid_again():
    asked = []
    assert [found.wrong for found in in_turn(lambda n: asked.append(n) or Told(n, 3 - n), 3)] == [1, 2, 3]
    assert asked == [0, 1, 2]


def bored_plate(size: float, half: float) -> Region:
    """A plate so many elements thick to each side, with a hole of an element and a half."""
    k, j, i = np.indices((15, 41, 41)) * 0.5
    plate = np.maximum(np.abs(k - 3.5) - half * size, np.maximum(np.abs(j - 10), np.abs(i - 10)) - 8)
    distance = np.maximum(plate, 0.75 * size - np.hypot(i - 10, j - 10)).astype(np.float32)
    return Region(distance < 0, distance, np.diag([0.5, 0.5, 0.5, 1.0]))


def test_a_tunnel_stays_open_wherever_the_lattice_lies(device: Device) -> None:
    """Askew all cells across the hole of a plate have their middles inside."""
    size, place = 2.0, placement(1)
    region = bored_plate(size, 0.8)
    level = level_set(region, size, rotation=place.axes(None), device=device)
    laid = Laid(place, level, {}, find_core(level), cell_means(level.phi))
    (closed,) = laid.core.differences
    assert closed.what == "closes a tunnel" and laid.core.euler == {"mesh": 1, "region": 0}
    assert np.linalg.norm(level.in_mm(closed.at[None])[0] - (10, 10, 3.5)) < size
    whole = mended(laid)
    assert whole.core.differences == () and whole.core.euler == {"mesh": 0, "region": 0}
    assert SOUND[patterns(whole.core.cells)].all() and mended(whole) is whole
    made = blocks_mesh(region, size, rotation=place.axes(None), device=device)
    assert made.report.euler == {"mesh": 0, "region": 0} and made.report.is_whole
    assert made.report.min_scaled_jacobian > 0.6 and {attempt.euler for attempt in made.report.attempts} == {0}


@pytest.mark.parametrize("device", ["opencl"], indirect=True)
def test_what_no_place_of_the_lattice_keeps_is_listed_and_a_size_that_does_found(monkeypatch, device: Device) -> None:
    monkeypatch.setattr("gpubspline.mesh.blocks.lay.MENDINGS", 0)
    region, axes = bored_plate(2.0, 0.8), placement(1).axes(None)
    made = blocks_mesh(region, 2.0, rotation=axes, attempts=1, device=device)
    (place,) = made.report.to_dict()["topology"]
    assert not made.report.is_whole and place["what"] == "closes a tunnel"
    assert np.linalg.norm(np.subtract(place["place_mm"], (10, 10, 3.5))) < 2.0
    keeps = size_that_keeps_topology(region, 2.0, rotation=axes, device=device)
    assert keeps is not None and 0.5 * 2.0 <= keeps < 2.0


def test_a_hex_of_tiny_determinant_is_poor_whatever_its_angles(monkeypatch, device: Device) -> None:
    monkeypatch.setattr(merit, "TINY", 1.0)
    monkeypatch.setattr(merit, "GOOD", 0.0)
    made = blocks_mesh(three_arms(), 5.0, attempts=2, device=device)
    assert len(made.report.attempts) == 2
    monkeypatch.setattr(merit, "MOST_MENDED", 1)
    assert len(blocks_mesh(three_arms(), 5.0, attempts=2, device=device).report.attempts) == 1


@pytest.mark.parametrize("half", [0.8, 0.5])
def test_labels_keep_together_what_one_body_keeps(half: float, device: Device) -> None:
    """The bored plate in two halves: by the middles of their cells the hole is closed, or a half is lost."""
    region, i = bored_plate(2.0, half), np.indices((15, 41, 41))[2] * 0.5
    parts = {}
    for name, side in (("left", i - 10.2), ("right", 10.2 - i)):
        distance = np.maximum(region.distance_mm, side).astype(np.float32)
        parts[name] = Region(region.mask & (side < 0), distance, region.affine)
    laid = lay(region, 2.0, parts, None, device, 1)
    if half > 0.5:
        assert find_core(laid.level, laid.within).differences
    else:
        with pytest.raises(MeshError, match="no cell of 2 mm lies in right"):
            find_core(laid.level, laid.within)
    assert laid.wrong == 0 and laid.core.euler == {"mesh": 0, "region": 0}
    for cells in (laid.core.cells > 0, laid.core.cells == 1, laid.core.cells == 2):
        assert SOUND[patterns(cells)].all() and label(cells)[1] == 1


def test_walls_as_thin_as_an_element_are_kept(device: Device) -> None:
    """A plate of one element with a hole, askew: the middles of hardly any cell lie inside it."""
    size, place = 2.0, placement(1)
    region = bored_plate(size, 0.5)
    level = level_set(region, size, rotation=place.axes(None), device=device)
    laid = Laid(place, level, {}, find_core(level), cell_means(level.phi))
    assert laid.far > 3
    whole = thickened(laid)
    assert whole.far == 0 and whole.core.euler == {"mesh": 0, "region": 0}
    assert SOUND[patterns(whole.core.cells)].all() and whole.core.cells.sum() > 10 * laid.core.cells.sum()
    assert thickened(whole) is whole
    made = blocks_mesh(region, size, rotation=place.axes(None), attempts=1, device=device)
    assert made.report.min_scaled_jacobian > 0.6 and made.report.lost_features == ()
    assert made.mesh.volume_mm3 == pytest.approx(region.volume_mm3, rel=0.05)  # a sixth of the nodes leave its surface


@pytest.mark.parametrize(("away", "more"), [((0, 1, 1), 1), ((1, 1, 1), 2), ((2, 0, 0), 1), ((2, 2, 0), 0)])
def test_what_meets_the_core_at_an_edge_or_a_corner_is_joined(away: tuple[int, int, int], more: int) -> None:
    """By the cells that lie deepest; what is farther off stays apart."""
    cells, means = np.zeros((9, 9, 9), dtype=bool), -np.arange(729, dtype=np.float32).reshape(9, 9, 9)
    cells[1:5, 1:5, 1:5] = True
    at = tuple(4 + step for step in away)
    cells[at] = True
    joined = joined_by_faces(cells, means)
    assert np.count_nonzero(joined) == np.count_nonzero(cells) + more and not np.any(cells & ~joined)
    assert label(joined)[1] == (1 if more else 2)
    assert away != (0, 1, 1) or (joined[4, 5, 4] and not joined[4, 4, 5])


def test_each_step_that_keeps_thin_features_keeps_one(both_devices):
    """Plate, ring and spike: nothing is lost with all steps; without one a hole or a tip of it is."""
    lines = list(thin_ablations(thin_features(), 2.0, both_devices[1]))[2:]
    places, out = np.array([[float(cell) for cell in line.split("|")[5:7]] for line in lines]).T
    np.testing.assert_array_equal(places, [0, 1, 1, 0])
    assert out[0] == 0 and out[1] > 5 and out[2] == 0 and out[3] > 1.5
