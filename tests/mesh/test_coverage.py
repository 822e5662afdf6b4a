"""What of a region a mesh covers: distances the other way, parts left out, topology."""

import numpy as np
import pytest

from gpubspline.ct.region import Region
from gpubspline.errors import InputError
from gpubspline.mesh.coverage import cover, euler_of_mesh, euler_of_voxels, mesh_surface, surface_places
from gpubspline.mesh.elements import ELEMENTS
from gpubspline.mesh.mesh import Mesh


def region_of(level, shape=(30, 32, 34), spacing=1.0, shear=0.0):
    affine = np.diag([spacing, spacing, 1.2 * spacing, 1.0])
    affine[1, 2] = shear
    affine[:3, 3] = -affine[:3, :3] @ ((np.array(shape[::-1]) - 1) / 2)
    k, j, i = np.indices(shape)
    points = np.stack([i, j, k], axis=-1) @ affine[:3, :3].T + affine[:3, 3]
    values = level(*np.moveaxis(points, -1, 0)).astype(np.float32)
    return Region(values < 0, values, affine)


def brick(low, high, counts=(5, 4, 6), element_type="hex8"):
    element = ELEMENTS[element_type]
    axes = [np.linspace(a, b, element.order * (n - 1) + 1) for a, b, n in zip(low, high, counts, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3, order="F")
    return Mesh(points, element_type, structure=counts)


def box_level(half):
    def level(x, y, z):
        off = np.abs(np.stack([x, y, z], axis=-1)) - half
        return np.linalg.norm(np.maximum(off, 0), axis=-1) + np.minimum(off.max(axis=-1), 0)

    return level


@pytest.mark.parametrize("shear", [0.0, -0.3])
def test_places_lie_on_the_surface_and_weigh_its_area(shear):
    region = region_of(lambda x, y, z: np.sqrt(x**2 + y**2 + z**2) - 9.3, shear=shear)
    places, weights = surface_places(region)
    np.testing.assert_allclose(np.linalg.norm(places, axis=1), 9.3, atol=0.03)
    assert weights.sum() == pytest.approx(4 * np.pi * 9.3**2, rel=0.02)


@pytest.mark.parametrize("element_type", ["hex8", "hex27"])
def test_the_surface_of_a_mesh_is_closed_and_outward(element_type):
    mesh = brick((0, 0, 0), (4, 3, 2), element_type=element_type)
    surface = mesh_surface(mesh)
    assert surface.volume_mm3 == pytest.approx(24) and surface.area_mm2 == pytest.approx(52)
    assert len(surface.triangles) == (4 if element_type == "hex8" else 16) * len(mesh.boundary())


def test_curved_faces_are_followed(device):
    """A hex27 bent on to a cylinder: its triangles enclose what the curved hexes do, to their chords."""
    mesh = brick((0, 0, 0), (1, 1, 1), (2, 2, 3), "hex27")
    x, y, z = mesh.points.T
    bent = np.stack([(2 + x) * np.cos(y), (2 + x) * np.sin(y), z], axis=1)
    curved = Mesh(bent, "hex27", structure=(2, 2, 3))
    assert mesh_surface(curved).volume_mm3 == pytest.approx(curved.volume_mm3, rel=0.02)


def test_a_mesh_that_fills_its_region_is_near_it_both_ways(device):
    half = np.array([8.4, 7.3, 9.1])
    covered = cover(brick(-half, half), region_of(box_level(half)), device)
    assert covered.distance.max < 0.35 and covered.distance.mean < 0.05  # corners are round between voxels
    assert covered.lost == () and covered.off_surface[0] == 0
    assert covered.euler == (1, 1)


def test_what_is_left_out_is_found_where_it_is(device):
    """Two horns on a box that the mesh does not know; seen from the mesh there is nothing to see."""
    half = np.array([8.4, 7.3, 6.1])

    def horned(x, y, z):
        horns = [np.maximum(np.hypot(x - at, y) - 2, np.abs(z) - top) for at, top in ((4, 13.0), (-4, 10.0))]
        return np.minimum(box_level(half)(x, y, z), np.minimum(*horns))

    covered = cover(brick(-half, half), region_of(horned), device)
    assert len(covered.lost) == 4 and covered.distance.max == pytest.approx(13 - 6.1, abs=0.5)
    (place, out), *_ = covered.lost
    assert np.hypot(place[0] - 4, place[1]) < 2.8 and abs(abs(place[2]) - 13) < 0.8
    assert out == pytest.approx(covered.distance.max)
    figures = covered.to_dict()
    assert figures["lost_features"][0]["out_mm"] == out and figures["euler"] == {"mesh": 1, "region": 1}


def test_what_the_mesh_bridges_is_no_lost_feature(device):
    """A region with a dent, a mesh without: the dent's floor is far from the mesh's surface, but inside."""
    half = np.array([8.4, 7.3, 9.1])
    dented = region_of(lambda x, y, z: np.maximum(box_level(half)(x, y, z), 3.0 - np.hypot(x, y - 5)))
    covered = cover(brick(-half, half, (5, 8, 6)), dented, device)
    assert covered.lost == () and covered.distance.max > 2
    assert covered.off_surface[0] >= 2 and covered.off_surface[1] > 2


def test_euler_characteristics():
    """A ball has 1, a ring 0, a hollow ball 2, two bodies 2."""
    solid = np.zeros((9, 9, 9), dtype=bool)
    solid[2:7, 2:7, 2:7] = True
    ring, hollow, two = solid.copy(), solid.copy(), solid.copy()
    ring[:, 4, 4] = False
    hollow[4, 4, 4] = False
    two[4] = False
    for mask, expected in ((solid, 1), (ring, 0), (hollow, 2), (two, 2)):
        assert euler_of_voxels(mask) == expected
        assert euler_of_mesh(hexes_of(mask)) == expected


def hexes_of(mask):
    at = np.stack(np.nonzero(mask), axis=1)[:, ::-1]
    corners = at[:, None] + np.array(ELEMENTS["hex8"].vertices) // 2
    points, numbers = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    return Mesh(points.astype(float), "hex8", connectivity=numbers.reshape(-1, 8))


def test_quads_have_no_inside(device):
    quad = Mesh(np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]), "quad4", connectivity=np.arange(4)[None])
    with pytest.raises(InputError, match="expected hexes"):
        mesh_surface(quad)
