"""The table of sound vertices, the repair, and the topology of cores."""

import numpy as np
import pytest
from scipy import ndimage

from gpubspline.mesh.blocks.core import core_cells, euler_characteristic
from gpubspline.mesh.blocks.pillow import count_hexes, pillow
from gpubspline.mesh.blocks.repair import SOUND, patterns, repair


def test_sound_patterns_by_labelling():
    """By scipy's labels of the eight cells, and normals summed face by face."""
    for pattern in range(256):
        cells = np.array([pattern >> bit & 1 for bit in range(8)], dtype=bool).reshape(2, 2, 2)
        whole = ndimage.label(cells)[1] <= 1 and ndimage.label(~cells)[1] <= 1
        faces = [np.diff(cells.astype(int), axis=axis) for axis in range(3)]
        opposed = any((face > 0).any() and (face < 0).any() for face in faces)
        assert SOUND[pattern] == (whole and not opposed)
    assert SOUND.sum() == 104


def test_sound_patterns_know_no_direction():
    """A quarter turn of the eight cells about any axis, a reflection, or inside for outside change nothing."""
    cube = np.arange(256)[:, None] >> np.arange(8) & 1
    for turned in [np.rot90(cube.reshape(-1, 2, 2, 2), axes=axes) for axes in ((1, 2), (1, 3), (2, 3))]:
        assert np.array_equal(SOUND[turned.reshape(256, 8) @ (1 << np.arange(8))], SOUND)
    assert np.array_equal(SOUND[::-1], SOUND)


@pytest.mark.parametrize("seed", range(4))
def test_repair_of_noise_leaves_a_manifold(seed):
    """Every edge of the boundary belongs to two faces, and each vertex has one fan of them."""
    rng = np.random.default_rng(seed)
    means = ndimage.gaussian_filter(rng.normal(size=(20, 18, 22)), 1.0).astype(np.float32)
    means[[0, 1, -2, -1]] = means[:, [0, 1, -2, -1]] = means[:, :, [0, 1, -2, -1]] = 1.0
    cells, flips, left = repair(core_cells(means), means)
    assert not len(left) and flips > 0 and SOUND[patterns(cells)].all()
    hexes = pillow(cells)
    assert len(hexes.cells) == count_hexes(cells)
    quads = hexes.quads
    edges = np.sort(np.stack([quads, np.roll(quads, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    _, times = np.unique(edges, axis=0, return_counts=True)
    assert np.all(times == 2)
    surface = len(np.unique(quads)) - len(times) + len(quads)
    assert surface == 2 * euler_characteristic(cells)  # a closed surface has twice the solid's


@pytest.mark.parametrize(("holes", "expected"), [(0, 1), (1, 0), (2, -1)])
def test_euler_characteristic_counts_tunnels(holes, expected):
    cells = np.zeros((5, 9, 15), dtype=bool)
    cells[1:4, 1:8, 1:14] = True
    for hole in range(holes):
        cells[:, 3:5, 3 + 5 * hole : 5 + 5 * hole] = False
    assert euler_characteristic(cells) == expected
    cells[:, :, 0] = cells[:, :, -1] = False
    hollow = np.ones((5, 5, 5), dtype=bool)
    hollow[2, 2, 2] = False
    assert euler_characteristic(hollow) == 2


def test_colours_never_meet_in_a_hex():
    cells = np.zeros((6, 6, 7), dtype=bool)
    cells[1:4, 1:5, 1:5] = cells[3:5, 1:3, 2:6] = True
    hexes = pillow(cells)
    assert all(len(set(row)) == 8 for row in hexes.colours[hexes.cells])
    corners = hexes.points[hexes.cells[: cells.sum()]]
    edges = corners[:, [1, 3, 4]] - corners[:, [0]]
    assert np.allclose(np.linalg.det(edges), 1)
