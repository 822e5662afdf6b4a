"""Projection onto nodes: integrals kept, bounds kept, against sums over a quadrature of NumPy's own."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import ndimage

from gpubspline.ct.volume import Volume
from gpubspline.device import Device
from gpubspline.errors import InputError
from gpubspline.material.assign import Mapping, assign
from gpubspline.material.laws import DensityRelation, Law, Piece
from gpubspline.material.registry import law
from gpubspline.mesh import structure
from gpubspline.mesh.elements import ELEMENTS
from gpubspline.mesh.mesh import Mesh
from gpubspline.mesh.quadrature import integral, rule

SMOOTH = Law("smooth", "rho^2", DensityRelation("apparent", 0.001), (Piece(50.0, 3000.0, 5000.0, 2.0),))


def phantom() -> Volume:
    """A peak of 1,500 HU over 800, 6 mm wide, in voxels of 0.5 mm, 20 mm wide."""
    affine = np.diag([0.5, 0.5, 0.5, 1.0])
    affine[:3, 3] = -10
    z, y, x = np.indices((41, 41, 41)) * 0.5 - 10
    hu = 800 + 700 * np.exp(-((x - 1) ** 2 + (y - 0.5) ** 2 + z**2) / 9)
    return Volume(hu.astype(np.float32), affine)


def crooked_block(element_type: str, counts: tuple[int, int, int]) -> Mesh:
    """Distorted hexes within 8 mm of the middle."""
    order = ELEMENTS[element_type].order
    lattice = [np.linspace(-1, 1, order * (n - 1) + 1) for n in counts]
    u, v, w = (a.ravel(order="F") for a in np.meshgrid(*lattice, indexing="ij"))
    kept = structure.has_node(ELEMENTS[element_type], counts)
    x = 6 * np.stack([u + 0.1 * np.sin(2 * v), v + 0.12 * w * u, w + 0.1 * np.cos(2 * u)], axis=1)
    points = x if kept is None else x[kept]
    return Mesh(points, element_type, structure=counts, fields={"HU": read(phantom(), points)})


def read(volume: Volume, places: NDArray[np.float64]) -> NDArray[np.float64]:
    """HU at places, trilinear, by SciPy."""
    index = volume.to_indices(places.reshape(-1, 3))[:, ::-1].T
    found = ndimage.map_coordinates(volume.hu.astype(np.float64), index, order=1, mode="nearest")
    return np.asarray(found.reshape(places.shape[:-1]))


def block(counts: tuple[int, int, int] = (5, 4, 6)) -> Mesh:
    """An even box of hexes with HU = 600 + 20 x - 10 y z."""
    lattice = [np.linspace(-5, 5, n) for n in counts]
    x, y, z = (a.ravel(order="F") for a in np.meshgrid(*lattice, indexing="ij"))
    return Mesh(np.stack([x, y, z], axis=1), "hex8", structure=counts, fields={"HU": 600 + 20 * x - 10 * y * z})


@pytest.mark.parametrize("element_type", ["hex8", "hex20", "hex27"])
def test_mass_is_that_of_the_ct_whatever_the_size(element_type: str, device: Device) -> None:
    """Of few distorted elements: as element-e has it to rounding; by the law of the mean too, density being a line."""
    mesh, volume = crooked_block(element_type, (4, 3, 4)), phantom()
    masses = {}
    for how in ("nodal", "nodal-hu", "nodal-e", "element-e"):
        points = None if how == "nodal" else 6
        mapped, alarms = assign(mesh, SMOOTH, Mapping(how, points=points), volume=volume, device=device)
        assert alarms.mapping == how and alarms.of == ("elements" if how == "element-e" else "nodes")
        masses[how] = alarms.mass_mesh_g
        if how.startswith("nodal-"):
            assert volume.hu.min() <= mapped.fields["HU"].min() and mapped.fields["HU"].max() <= volume.hu.max()
    assert masses["nodal-e"] == pytest.approx(masses["element-e"], rel=2e-6)
    assert masses["nodal-hu"] == pytest.approx(masses["element-e"], rel=2e-6)
    assert abs(masses["nodal"] / masses["element-e"] - 1) > 1e-3


@pytest.mark.parametrize("element_type", ["hex8", "hex20"])
def test_nodes_against_sums_over_a_quadrature(element_type: str, device64: Device) -> None:
    """Corner i has the integral of N_i f over that of N_i; a node midway along an edge the mean of its ends."""
    mesh, volume, n = crooked_block(element_type, (3, 4, 3)), phantom(), 4
    mapped, _ = assign(mesh, SMOOTH, Mapping("nodal-e", points=n), volume=volume, device=device64)
    at, weights = rule(mesh.element, n)
    nodes = mesh.points[mesh.cells].astype(np.float64)
    tangents = np.einsum("dgk,mkc->mgdc", mesh.element.gradient(at), nodes)
    volumes = np.linalg.det(tangents) * weights
    hu = read(volume, np.einsum("gk,mkc->mgc", mesh.element.shape(at), nodes))
    corners, shape = mesh.cells[:, :8], ELEMENTS["hex8"].shape(at)
    sums = np.zeros((3, mesh.n_nodes))
    for total, values in zip(sums, (np.ones_like(hu), hu, 5000 * (0.001 * hu) ** 2), strict=True):
        np.add.at(total, corners, np.einsum("mg,ga->ma", volumes * values, shape))
    met = np.unique(corners)
    for name, row in (("HU", 1), ("E_MPa", 2)):
        np.testing.assert_allclose(mapped.fields[name][met], sums[row, met] / sums[0, met], rtol=1e-6)
    np.testing.assert_allclose(mapped.fields["nu"], SMOOTH.pieces[0].poisson)
    if element_type == "hex20":
        ends = mapped.fields["E_MPa"][mesh.cells[:, [0, 1]]].mean(axis=1)
        np.testing.assert_allclose(mapped.fields["E_MPa"][mesh.cells[:, 8]], ends, rtol=1e-12)


def test_a_linear_field_stays_inside_and_its_integral_everywhere(device64: Device) -> None:
    """Means round inner nodes of even boxes are the field's own; without a CT the nodes' HU are what is projected."""
    mesh = block()
    mapped, _ = assign(mesh, SMOOTH, Mapping("nodal-hu"), device=device64)
    inner = np.all(np.abs(mesh.points) < 4.9, axis=1)
    x, y, z = mesh.points[inner].T
    np.testing.assert_allclose(mapped.fields["HU"][inner], 600 + 20 * x - 10 * y * z, rtol=1e-12)
    assert integral(mapped, "HU", device64) == pytest.approx(600e3, rel=1e-12)


def test_elements_a_few_at_a_time_are_all_of_them(device64: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    mesh, wide = block(), law()
    sharp = mesh.with_fields({"HU": np.linspace(100, 3000, mesh.n_nodes)})
    whole = assign(sharp, wide, Mapping("nodal-e", points=2), device=device64)
    monkeypatch.setattr("gpubspline.mesh.quadrature.CHUNK", 64)  # 8 of 60 elements
    parts = assign(sharp, wide, Mapping("nodal-e", points=2), device=device64)
    for name, values in whole[0].fields.items():
        np.testing.assert_allclose(parts[0].fields[name], values, rtol=1e-13)
    assert 0 < whole[1].outside == parts[1].outside
    with pytest.raises(InputError, match="got others in 153 of 480 quadrature points"):
        assign(sharp, wide, Mapping("nodal-e", points=2, policy={"policy": "error"}), device=device64)


def test_a_mean_between_two_ranges_is_no_place_outside(device: Device) -> None:
    """Points at 1,000 and 1,100 HU are covered, the mean round the nodes between them is not: nodal-e minds not."""
    gap = Law(
        "gap", "", DensityRelation("apparent", 0.001), (Piece(1.0, 1040.0, 9.0, 1.0), Piece(1060.0, 3e3, 9.0, 1.0))
    )
    mesh, strict = block((3, 2, 2)), {"points": 1, "policy": {"policy": "error"}}
    mesh = mesh.with_fields({"HU": 1050 + 20 * mesh.points[:, 0]})
    mapped, _ = assign(mesh, gap, Mapping("nodal-e", **strict), device=device)
    np.testing.assert_allclose(np.unique(mapped.fields["E_MPa"]), [9.0, 9.45, 9.9], rtol=1e-6)
    with pytest.raises(InputError, match="at 4 of 12 nodes"):
        assign(mesh, gap, Mapping("nodal-hu", **strict), device=device)


def test_policies(device: Device) -> None:
    """HU are refused at the points for the mean of the law, as the mean round nodes for the law of the mean."""
    mesh = block()
    outer = mesh.points[:, 0] > 4.9
    sharp, hardly = (mesh.with_fields({"HU": np.where(outer, high, 1990.0)}) for high in (2048.0, 2004.0))
    with pytest.raises(InputError, match=r"quadrature points"):
        assign(hardly, law(), Mapping("nodal-e", policy={"policy": "error"}), device=device)
    assign(hardly, law(), Mapping("nodal-hu", policy={"policy": "error"}), device=device)
    with pytest.raises(InputError, match=r"nodes: choose the policy"):
        assign(sharp, law(), Mapping("nodal-hu", policy={"policy": "error"}), device=device)
    mapped, alarms = assign(sharp, law(), Mapping("nodal-e", policy={"policy": "floor"}), device=device)
    assert alarms.outside == 24 and mapped.fields["E_MPa"].min() < 12000 < mapped.fields["E_MPa"].max()
