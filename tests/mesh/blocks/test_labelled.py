"""Several bodies that touch: conforming, each with its volume, interfaces where their boundary is."""

import numpy as np
import pytest

from gpubspline.ct.region import Region
from gpubspline.device import Device
from gpubspline.errors import InputError
from gpubspline.mesh.blocks.core import Cells
from gpubspline.mesh.blocks.mesher import Blocks, blocks_mesh
from gpubspline.mesh.blocks.pillow import pillow
from gpubspline.mesh.blocks.repair import SOUND, patterns, repair_owners
from gpubspline.mesh.quality import assess

RADIUS, SLOPE, HEIGHT, ACROSS, CORE = 15.0, 0.3, 2.2137, 1.337, 8.03

LINE = np.arange(-20.0, 21.0)
Z, Y, X = np.meshgrid(LINE, LINE, LINE, indexing="ij")
BALL = np.sqrt(X**2 + Y**2 + Z**2) - RADIUS
PLANE = (Z - SLOPE * X - HEIGHT) / np.hypot(1, SLOPE)
INNER = np.sqrt(X**2 + Y**2 + Z**2) - CORE

PARTS = {
    "halves": {"lower": PLANE, "upper": -PLANE},
    "shell": {"core": INNER, "shell": -INNER},
    "three": {"lower": PLANE, "left": np.maximum(-PLANE, X - ACROSS), "right": np.maximum(-PLANE, ACROSS - X)},
}


def region(distance: np.ndarray) -> Region:
    affine = np.eye(4)
    affine[:3, 3] = LINE[0]
    return Region(distance < 0, distance.astype(np.float32), affine)


def made(name: str, device: Device) -> Blocks:
    parts = {part: region(np.maximum(BALL, distance)) for part, distance in PARTS[name].items()}
    return blocks_mesh(region(BALL), 2.5, parts=parts, device=device)


@pytest.mark.parametrize(("name", "floor"), [("halves", 0.65), ("shell", 0.7), ("three", 0.5)])
def test_bodies_share_their_interface(name: str, floor: float, device: Device) -> None:
    mesh = made(name, device).mesh
    assert assess(mesh, device)[1].min > floor
    sets = [mesh.element_sets[part] for part in PARTS[name]]
    assert np.array_equal(np.sort(np.concatenate(sets)), np.arange(mesh.n_elements))
    ball = 4 / 3 * np.pi * RADIUS**3
    assert mesh.volume_mm3 == pytest.approx(ball, rel=0.03)
    one, other = list(PARTS[name])[:2]
    shared = np.intersect1d(*(mesh.cells[mesh.element_sets[part]] for part in (one, other)))
    assert np.array_equal(shared, mesh.node_sets[f"interface_{one}_{other}"])
    assert np.array_equal(np.unique(mesh.boundary()), mesh.node_sets["surface"])


def test_an_interface_lies_on_the_boundary_of_its_bodies(device: Device) -> None:
    halves = made("halves", device).mesh
    x, _, z = halves.points[halves.node_sets["interface_lower_upper"]].T
    assert np.abs((z - SLOPE * x - HEIGHT) / np.hypot(1, SLOPE)).max() < 0.05 * 2.5
    shell = made("shell", device).mesh
    at = np.linalg.norm(shell.points[shell.node_sets["interface_core_shell"]], axis=1)
    assert np.abs(at - CORE).max() < 0.1 * 2.5


def test_one_body_is_the_same_by_number_or_by_mask() -> None:
    cells = np.zeros((5, 6, 7), dtype=bool)
    cells[1:4, 1:5, 1:6] = True
    one, other = pillow(cells), pillow(cells.astype(np.int8))
    assert np.array_equal(one.cells, other.cells) and not len(one.interfaces)


def touching(seed: int) -> Cells:
    """Three bodies of noise in a block."""
    rng = np.random.default_rng(seed)
    owners = np.zeros((12, 12, 12), dtype=np.int8)
    coarse = rng.integers(1, 4, (4, 4, 4)).repeat(2, 0).repeat(2, 1).repeat(2, 2)
    owners[2:10, 2:10, 2:10] = coarse
    return owners


@pytest.mark.parametrize("seed", range(4))
def test_bodies_are_sound_each_and_together(seed: int) -> None:
    owners = touching(seed)
    costs = np.random.default_rng(seed).random((4, *owners.shape)).astype(np.float32)
    repaired, _, unsound = repair_owners(owners, costs)
    assert not len(unsound)
    for body in (repaired > 0, *(repaired == number for number in (1, 2, 3))):
        assert SOUND[patterns(body)].all()
    hexes = pillow(repaired)
    assert all(len(set(row)) == 8 for row in hexes.colours[hexes.cells])
    faces = np.sort(
        hexes.cells[:, [(0, 4, 7, 3), (1, 2, 6, 5), (0, 1, 5, 4), (3, 7, 6, 2), (0, 3, 2, 1), (4, 5, 6, 7)]]
    )
    _, count = np.unique(faces.reshape(-1, 4), axis=0, return_counts=True)
    assert count.max() == 2 and np.count_nonzero(count == 1) == len(hexes.quads)


def test_parts_must_fill_the_region(device: Device) -> None:
    with pytest.raises(InputError, match="fill the region without overlap"):
        blocks_mesh(region(BALL), 2.5, parts={"lower": region(np.maximum(BALL, PLANE))}, device=device)
