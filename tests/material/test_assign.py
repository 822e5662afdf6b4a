"""Mapping onto elements and Gauss points: against a fine quadrature of its own, on a phantom whose field is known."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import ndimage

from gpubspline.ct.enclosed import cell_shares
from gpubspline.ct.region import Region, region_from_mask, region_from_threshold
from gpubspline.ct.volume import Volume
from gpubspline.device import Device
from gpubspline.errors import InputError
from gpubspline.material.assign import Mapping, assign
from gpubspline.material.laws import DensityRelation, Law, Piece
from gpubspline.material.mapping import law_on_device
from gpubspline.material.registry import law
from gpubspline.material.voxel_mass import voxel_mass_g
from gpubspline.mesh.mesh import Mesh
from gpubspline.spline.lattice import surface_hu

Floats = NDArray[np.float64]

SMOOTH = Law("smooth", "rho^2", DensityRelation("apparent", 0.001), (Piece(50.0, 3000.0, 5000.0, 2.0),))
STEPS = np.array([[0.0, -1.0, 0.0], [0.96, 0.0, 0.28], [-0.28, 0.0, 0.96]])  # a rotation


def known_hu(points: Floats) -> Floats:
    """HU of the phantom anywhere, LPS mm: smooth, within 300 and 1700."""
    x, y, z = np.moveaxis(points, -1, 0)
    return np.asarray(1000 + 400 * np.sin(x / 9) * np.cos(y / 11) + 300 * np.sin((z + 0.3 * x) / 13))


def phantom(spacing_mm: float = 0.4, n: int = 56) -> Volume:
    """The field at the voxel centres of an oblique grid about the origin."""
    affine = np.eye(4)
    affine[:3, :3] = STEPS * spacing_mm
    affine[:3, 3] = -affine[:3, :3] @ np.full(3, (n - 1) / 2)
    k, j, i = np.indices((n, n, n))
    points = np.stack([i, j, k], axis=-1) @ affine[:3, :3].T + affine[:3, 3]
    return Volume(known_hu(points).astype(np.float32), affine)


def crooked_block(element_type: str, counts: tuple[int, ...] = (6, 7, 5), half_mm: float = 6.0) -> Mesh:
    """A block of distorted hexes inside the phantom."""
    order = 2 if element_type in ("hex20", "hex27") else 1
    lattice = [np.linspace(-1, 1, order * (n - 1) + 1) for n in counts]
    u, v, w = (a.ravel(order="F") for a in np.meshgrid(*lattice, indexing="ij"))
    if element_type == "hex20":
        odd = sum(np.meshgrid(*[np.arange(len(a)) % 2 for a in lattice], indexing="ij")).ravel(order="F")
        u, v, w = u[odd < 2], v[odd < 2], w[odd < 2]
    x = np.stack([u + 0.1 * np.sin(2 * v), v + 0.12 * w * u, w + 0.1 * np.cos(2 * u)], axis=1) * half_mm
    return Mesh(x, element_type, structure=counts, fields={"HU": known_hu(x)})


def fine_quadrature(mesh: Mesh, function: Any, n: int = 16) -> Floats:
    """Mean (values, m) of functions of places over each element, by midpoints of ``n`` parts per direction.

    Shape functions and Jacobians by the element's own formulas of the node coordinates in float64, all points at once.
    """
    at = (np.indices((n, n, n)).reshape(3, -1).T + 0.5) / n
    nodes = mesh.points[mesh.cells].astype(np.float64)
    places = np.einsum("gk,mkc->mgc", mesh.element.shape(at), nodes)
    tangents = np.einsum("dgk,mkc->mgdc", mesh.element.gradient(at), nodes)
    weight = np.linalg.det(tangents)
    return np.array([(values * weight).sum(axis=1) / weight.sum(axis=1) for values in function(places)])


def by_scipy(volume: Volume) -> Any:
    """HU of the CT at places, trilinear, by ``scipy.ndimage``."""

    def read(places: Floats) -> Floats:
        index = volume.to_indices(places.reshape(-1, 3))[:, ::-1].T
        found = ndimage.map_coordinates(volume.hu.astype(np.float64), index, order=1, mode="nearest")
        return found.reshape(places.shape[:-1])

    return read


@pytest.mark.parametrize("element_type", ["hex8", "hex20", "hex27"])
def test_elements_against_fine_quadrature(element_type: str, device: Device) -> None:
    """HU and modulus integrated over distorted elements of several voxels, within 1e-4."""
    mesh, volume = crooked_block(element_type), phantom()
    read = by_scipy(volume)

    def functions(places: Floats) -> list[Floats]:
        hu = read(places)
        return [hu, 5000 * (0.001 * hu) ** 2]

    mean_hu, mean_modulus = fine_quadrature(mesh, functions)
    hu_first, alarms = assign(mesh, SMOOTH, Mapping("element-hu", points=8), volume=volume, device=device)
    e_first, _ = assign(mesh, SMOOTH, Mapping("element-e", points=8), volume=volume, device=device)
    np.testing.assert_allclose(hu_first.cell_fields["HU"], mean_hu, rtol=1e-4)
    np.testing.assert_allclose(hu_first.cell_fields["E_MPa"], 5000 * (0.001 * mean_hu) ** 2, rtol=1e-4)
    np.testing.assert_allclose(e_first.cell_fields["E_MPa"], mean_modulus, rtol=1e-4)
    # of a convex law the mean is the greater; both orders are told apart in the alarms
    assert np.all(e_first.cell_fields["E_MPa"] > hu_first.cell_fields["E_MPa"])
    relative = 1 - 5000 * (0.001 * mean_hu) ** 2 / mean_modulus
    assert alarms.order_difference is not None
    assert alarms.order_difference[1] == pytest.approx(relative.max(), rel=0.02)


def test_elements_against_the_known_field(device: Device) -> None:
    """The field itself, not its samples: what is left is the voxels', 0.4 mm of lengths of 9 mm and more."""
    mesh = crooked_block("hex8")
    mean_hu, mean_modulus = fine_quadrature(mesh, lambda at: [known_hu(at), 5000 * (0.001 * known_hu(at)) ** 2])
    mapped, _ = assign(mesh, SMOOTH, Mapping("element-e", points=8), volume=phantom(), device=device)
    np.testing.assert_allclose(mapped.cell_fields["HU"], mean_hu, rtol=4e-4)
    np.testing.assert_allclose(mapped.cell_fields["E_MPa"], mean_modulus, rtol=8e-4)


def test_the_default_number_of_points_is_enough(device: Device) -> None:
    """Chosen by the size of elements and voxels: within 1e-3 of eight points a direction."""
    mesh, volume = crooked_block("hex8", (9, 10, 8)), phantom()
    fine, _ = assign(mesh, SMOOTH, Mapping("element-e", points=8), volume=volume, device=device)
    chosen, _ = assign(mesh, SMOOTH, Mapping("element-e"), volume=volume, device=device)
    np.testing.assert_allclose(chosen.cell_fields["E_MPa"], fine.cell_fields["E_MPa"], rtol=1e-3)


def test_without_the_ct_the_nodes_tell(device64: Device) -> None:
    """A trilinear field of straight elements is integrated exactly from its nodes: HU = 600 + 20 x - 10 y z."""
    lattice = [np.linspace(-5, 5, n) for n in (3, 4, 3)]
    x, y, z = (a.ravel(order="F") for a in np.meshgrid(*lattice, indexing="ij"))
    mesh = Mesh(np.stack([x, y, z], axis=1), "hex8", structure=(3, 4, 3), fields={"HU": 600 + 20 * x - 10 * y * z})
    centres = mesh.points[mesh.cells].mean(axis=1)
    mapped, alarms = assign(mesh, SMOOTH, Mapping("element-hu"), device=device64)
    expected = 600 + 20 * centres[:, 0] - 10 * centres[:, 1] * centres[:, 2]
    np.testing.assert_allclose(mapped.cell_fields["HU"], expected, rtol=1e-12)
    assert alarms.mass_mesh_g == pytest.approx(0.6, rel=1e-12)  # 1 cm3 of 600 HU on average, 0.001 g/cm3 each
    assert alarms.mass_voxels_g is None and alarms.mass_difference is None


@pytest.mark.parametrize(("element_type", "n_points"), [("hex8", 8), ("hex20", 27)])
def test_gauss_points(element_type: str, n_points: int, device: Device) -> None:
    """The law at each Gauss point of the solver's rule, in its order."""
    mesh, volume = crooked_block(element_type), phantom()
    mapped, _ = assign(mesh, SMOOTH, Mapping("gauss"), volume=volume, device=device)
    at, _ = mesh.element.gauss()
    places = np.einsum("gk,mkc->gmc", mesh.element.shape(at), mesh.points[mesh.cells])
    modulus = 5000 * (0.001 * by_scipy(volume)(places)) ** 2
    assert {f"nu_{g}" for g in range(1, n_points + 1)} < mapped.cell_fields.keys()
    for g in range(n_points):
        np.testing.assert_allclose(mapped.cell_fields[f"E_MPa_{g + 1}"], modulus[g], rtol=1e-4)
    means = np.array([mapped.cell_fields[f"E_MPa_{g + 1}"] for g in range(n_points)])
    assert np.all((means.min(axis=0) < mapped.cell_fields["E_MPa"]) & (mapped.cell_fields["E_MPa"] < means.max(axis=0)))


def test_quads_of_a_slice(device: Device) -> None:
    """Means over the area; a volume of one slice."""
    u, v = (a.ravel(order="F") for a in np.meshgrid(np.linspace(1, 9, 4), np.linspace(2, 8, 5), indexing="ij"))
    mesh = Mesh(np.stack([u, v, np.zeros_like(u)], axis=1), "quad4", structure=(4, 5))
    i = np.arange(12)
    volume = Volume((300 + 50 * i[None, None, :] + 20 * i[None, :, None]).astype(np.float32), np.eye(4))
    mapped, alarms = assign(mesh, law(), Mapping("element-hu"), volume=volume, device=device)
    centre = mesh.points[mesh.cells].mean(axis=1)
    np.testing.assert_allclose(mapped.cell_fields["HU"], 300 + 50 * centre[:, 0] + 20 * centre[:, 1], rtol=1e-5)
    assert alarms.mass_mesh_g is None


def ball(spacing: tuple[float, float, float] = (0.8, 0.8, 1.2), radius_mm: float = 15.0) -> tuple[Volume, Region]:
    """A ball of bone, 800 HU and denser to the middle, in air, each voxel the mean of 5 x 5 x 5 points within it."""
    shape = [int(2 * (radius_mm + 3) / step) for step in spacing]
    affine = np.diag([*spacing, 1.0])
    affine[:3, 3] = -(np.array(shape) - 1) / 2 * spacing
    axes = [(np.arange(5 * n) + 0.5) / 5 * step - n * step / 2 for n, step in zip(shape, spacing, strict=True)]
    squared = axes[2][:, None, None] ** 2 + axes[1][None, :, None] ** 2 + axes[0][None, None, :] ** 2
    fine = np.where(squared < radius_mm**2, 1000 - 200 * squared / radius_mm**2, -1000.0)
    n_i, n_j, n_k = shape
    hu = fine.reshape(n_k, 5, n_j, 5, n_i, 5).mean(axis=(1, 3, 5))
    volume = Volume(hu.astype(np.float32), affine)
    return volume, region_from_threshold(volume, -100.0)


def ball_mesh(radius_mm: float = 15.0, n: int = 15) -> Mesh:
    """The ball as one structured block: a cube bulged to the sphere."""
    t = np.tan(np.linspace(-np.pi / 4, np.pi / 4, n))
    u, v, w = (a.ravel(order="F") for a in np.meshgrid(t, t, t, indexing="ij"))
    cube = np.stack([u, v, w], axis=1)
    largest, length = np.abs(cube).max(axis=1, keepdims=True), np.linalg.norm(cube, axis=1, keepdims=True)
    x = radius_mm * cube * np.where(length > 0, largest / np.maximum(length, 1e-12), 0)
    squared = (x**2).sum(axis=1)
    return Mesh(x, "hex8", structure=(n, n, n), fields={"HU": 1000 - 200 * squared / radius_mm**2})


CONTINUED = Law("linear", "rho", DensityRelation("apparent", 0.001), (Piece(1.0, 3000.0, 1000.0, 1.0),))


def test_mass_of_mesh_and_voxels(device: Device) -> None:
    """Both within 1 % of the ball's own, 4 pi r^3 (1000/3 - 200/5) / 1e6 g; the surface read from inside."""
    volume, region = ball()
    exact = 4 * np.pi * 15**3 * (1000 / 3 - 200 / 5) / 1e6
    mesh = ball_mesh()
    there = law_on_device(CONTINUED, device)
    assert voxel_mass_g(volume, region, there, device, 1.2) == pytest.approx(exact, rel=0.01)
    assert voxel_mass_g(volume, region, there, device) < 0.97 * exact  # voxels that are half air
    for how in ("element-hu", "element-e", "gauss"):
        _, alarms = assign(
            mesh, CONTINUED, Mapping(how, surface_depth_mm=1.2), volume=volume, region=region, device=device
        )
        assert alarms.mass_mesh_g == pytest.approx(exact, rel=0.01), how
        assert alarms.mass_difference is not None and abs(alarms.mass_difference) < 0.01, how
    nodal = Mapping(surface_depth_mm=1.2)
    _, alarms = assign(mesh, CONTINUED, nodal, volume=volume, region=region, device=device)
    assert alarms.mass_difference is not None and abs(alarms.mass_difference) < 0.01


@pytest.mark.parametrize("axes", [2, 3])
def test_voxels_of_thin_bodies_weigh_their_volume(axes: int, device: Device) -> None:
    """A turned rod of three voxels, a ball of six, of one HU: by the middles of voxels they weighed 15 % too much."""
    turned = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    index = np.stack(np.meshgrid(*[np.arange(24.0)] * 3, indexing="ij"), axis=-1)[..., ::-1]
    radius = np.linalg.norm(((index - 11.7) @ turned)[..., :axes], axis=-1)
    region = region_from_mask(np.eye(4), radius < (1.5 if axes == 2 else 3.0))
    volume = Volume(np.full(radius.shape, 1000.0, dtype=np.float32), np.eye(4))
    mass = voxel_mass_g(volume, region, law_on_device(CONTINUED, device), device)
    assert mass == pytest.approx(float(cell_shares(region.distance_mm).sum()) / 1000, rel=0.015)


def test_mass_is_right_where_what_the_scan_spread_outside_is_folded_in(device: Device) -> None:
    """By nodes and by elements within 1 % of the ball's own, by default; as HU lie all of them lose 4 % and more."""
    volume, region = ball()
    exact = 4 * np.pi * 15**3 * (1000 / 3 - 200 / 5) / 1e6
    there = law_on_device(CONTINUED, device)
    assert voxel_mass_g(volume, region, there, device, partial_volume="fold") == pytest.approx(exact, rel=0.01)
    for treatment, within in (("fold", (0.99, 1.01)), ("none", (0.8, 0.96))):
        read = ball_mesh(n=21)
        points = read.points.astype(float)
        read = read.with_fields({"HU": surface_hu(volume, region, points, partial_volume=treatment, device=device)})
        for how in ("nodal", "element-hu", "element-e", "gauss"):
            mapping = Mapping(how, partial_volume=treatment)
            _, alarms = assign(read, CONTINUED, mapping, volume=volume, region=region, device=device)
            assert alarms.partial_volume == treatment and alarms.mass_mesh_g is not None
            assert within[0] < alarms.mass_mesh_g / exact < within[1], (how, treatment)
            if treatment == "fold":
                assert alarms.mass_difference is not None and abs(alarms.mass_difference) < 0.01, how


def test_the_mass_of_a_body_on_another_grid_is_not_compared(device: Device) -> None:
    """A surface in a CT: the region has a grid of its own, on which HU near it are folded all the same."""
    volume, region = ball()
    finer = replace(region, affine=region.affine.copy())
    finer.affine[:3, 3] += 1e-3
    mesh = ball_mesh()
    for mapping in (Mapping("element-e"), Mapping("nodal", surface_depth_mm=1.2)):
        _, alarms = assign(mesh, CONTINUED, mapping, volume=volume, region=finer, device=device)
        _, same = assign(mesh, CONTINUED, mapping, volume=volume, region=region, device=device)
        assert alarms.mass_voxels_g is None and same.mass_voxels_g is not None
        assert alarms.mass_mesh_g == pytest.approx(same.mass_mesh_g, rel=1e-3)


def test_no_surface_node_is_half_air(device: Device) -> None:
    """At the surface voxels are half air, near -100 HU; read 1.2 mm inside they are bone of 1000 - 200 (13.8/15)^2."""
    volume, region = ball()
    mesh = ball_mesh()
    surface = np.unique(mesh.boundary())
    index = volume.to_indices(mesh.points)[:, ::-1].T
    half_air = ndimage.map_coordinates(volume.hu, index, order=1)
    mesh = mesh.with_fields({"HU": half_air})
    assert half_air[surface].max() < 250
    mapped, alarms = assign(mesh, CONTINUED, Mapping(surface_depth_mm=1.2), volume=volume, region=region, device=device)
    expected = 1000 - 200 * (13.8 / 15) ** 2
    assert np.median(mapped.fields["HU"][surface]) == pytest.approx(expected, abs=15)
    assert mapped.fields["HU"][surface].min() > 300
    middle = np.linalg.norm(mesh.points, axis=1) < 12
    assert np.array_equal(mapped.fields["HU"][middle], half_air[middle])
    assert alarms.surface_depth_mm == 1.2 and alarms.outside == 0


def test_a_thin_plate_is_read_in_its_middle(device: Device) -> None:
    """A plate of 2 mm: a depth of 3 mm does not lead out on the other side."""
    z = np.abs(np.arange(40) * 0.25 - 4.875)
    hu = np.where(z < 1, 900.0, -1000.0)[:, None, None] * np.ones((1, 12, 12))
    volume = Volume(hu.astype(np.float32), np.diag([1.0, 1.0, 0.25, 1.0]))
    region = region_from_threshold(volume, 0.0)
    lattice = np.meshgrid(np.linspace(2, 9, 3), np.linspace(2, 9, 3), [3.9, 5.85], indexing="ij")
    points = np.stack([a.ravel(order="F") for a in lattice], axis=1)
    mesh = Mesh(points, "hex8", structure=(3, 3, 2), fields={"HU": np.full(18, -50.0)})
    mapped, _ = assign(mesh, CONTINUED, Mapping(surface_depth_mm=3.0), volume=volume, region=region, device=device)
    np.testing.assert_allclose(mapped.fields["HU"], 900, atol=1)


def test_what_lies_far_outside_stays(device: Device) -> None:
    """Nodes of a mesh that bridges a gap are not on the surface: they keep the HU that they have."""
    volume, region = ball()
    mesh = ball_mesh(radius_mm=17.5, n=19)
    surface = np.unique(mesh.boundary())
    given = mesh.with_fields({"HU": np.full(mesh.n_nodes, -900.0)})
    mapped, _ = assign(given, CONTINUED, Mapping(surface_depth_mm=1.2), volume=volume, region=region, device=device)
    assert np.all(mapped.fields["HU"][surface] == -900)  # 2.5 mm outside
    near = np.abs(np.linalg.norm(mesh.points, axis=1) - 15) < 0.9
    assert near.any() and mapped.fields["HU"][near].min() > 600


def test_alarms_count(device: Device) -> None:
    """Of four nodes' HU one lies below the law, one below 10 MPa, two beyond the specimens."""
    found = Law(
        "counted",
        "1000 rho",
        DensityRelation("ash", 0.001),
        (Piece(5.0, 900.0, 1000.0, 1.0),),
        specimens_g_cm3=(0.1, 0.5),
    )
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=float)
    mesh = Mesh(points, "quad4", structure=(2, 2), fields={"HU": np.array([-100.0, 200.0, 300.0, 700.0])})
    _, alarms = assign(mesh, found, device=device)
    assert (alarms.of, alarms.count, alarms.outside, alarms.near_zero) == ("nodes", 4, 1, 1)
    assert alarms.beyond_specimens == 2
    figures = alarms.to_dict()
    assert figures["outside_law"] == figures["near_zero_modulus"] == 0.25 and figures["beyond_specimens"] == 0.5


@pytest.mark.parametrize(
    ("mapping", "message"),
    [
        ({"how": "bonemat"}, "mapping of nodal, nodal-hu, nodal-e, gauss, element-hu, element-e, got 'bonemat'"),
        ({"surface_depth_mm": 0.0}, "positive depth below the surface in mm, got 0"),
        ({"points": 3}, "for a mapping with -hu or -e alone, got nodal"),
        ({"how": "element-e", "points": 0}, "1 to 64 quadrature points"),
    ],
)
def test_bad_mappings(mapping: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Mapping(**mapping)


def test_what_cannot_be_mapped(device: Device) -> None:
    mesh = ball_mesh(n=3)
    with pytest.raises(InputError, match="the CT to read the surface's HU at a depth from"):
        assign(mesh, CONTINUED, Mapping(surface_depth_mm=1.0), device=device)
    bare = Mesh(mesh.points, "hex8", structure=mesh.structure)
    with pytest.raises(InputError, match="nodal field HU, got the fields none"):
        assign(bare, CONTINUED, Mapping("element-e"), device=device)
    short = Law("short", "rho", DensityRelation("ash", 0.001), (Piece(900.0, 950.0, 1000.0, 1.0),))
    for how, what in (("element-hu", "8 of 8 elements' means"), ("element-e", "of 64 quadrature points")):
        with pytest.raises(InputError, match=f"HU of 900 to 950, which the law 'short' covers, got .*{what}"):
            assign(mesh, short, Mapping(how, policy={"policy": "error"}), device=device)
