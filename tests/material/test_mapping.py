"""Mapping a law onto nodes: against the formulas in NumPy, at the edges of ranges, and under every policy."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from gpubspline.device import Device
from gpubspline.errors import InputError
from gpubspline.material.assign import Mapping, assign
from gpubspline.material.laws import DensityRelation, Law, Piece
from gpubspline.material.mapping import Material, apply_material, map_material
from gpubspline.material.registry import law, laws
from gpubspline.mesh.mesh import Mesh

PAPER = law()
GAPPED = Law(
    "gapped",
    "two ranges with a gap, linear",
    DensityRelation("QCT", 0.001, -0.1),
    (Piece(200.0, 400.0, 1000.0, 1.0, 10.0, 0.2), Piece(500.0, 1000.0, 2000.0, 1.0, -20.0, 0.4)),
)


def paper_by_numpy(hu: Any) -> tuple[Any, Any, Any]:
    """Eqs 3.6 and 3.7 as they are printed, for HU inside the ranges."""
    rho = 1.9 * hu / 1630
    cancellous = hu < 350
    return rho, np.where(cancellous, 1904 * rho**1.64, 2065 * rho**3.09), np.where(cancellous, 0.3, 0.36)


def check_against_formulas(device: Device, rtol: float) -> None:
    hu = np.random.default_rng(7).uniform(100, 2000, 10_001)
    hu = hu.astype(device.real)
    material = map_material(hu, PAPER, device=device)
    rho, modulus, poisson = paper_by_numpy(hu.astype(float))
    np.testing.assert_allclose(material.density_g_cm3, rho, rtol=rtol)
    np.testing.assert_allclose(material.modulus_mpa, modulus, rtol=rtol)
    np.testing.assert_allclose(material.poisson, poisson, rtol=rtol)
    assert np.array_equal(material.piece, (hu >= 350).astype(int))
    assert material.out_of_range == 0
    assert material.modulus_mpa.dtype == device.real


def test_eqs_3_6_and_3_7_float32(device: Device) -> None:
    check_against_formulas(device, 3e-6)


def test_eqs_3_6_and_3_7_float64(device64: Device) -> None:
    check_against_formulas(device64, 1e-13)


def test_backends_give_the_same_bits(both_devices: tuple[Device, ...]) -> None:
    hu = np.random.default_rng(8).uniform(-1200, 3200, 100_003)
    for given, policy in ((PAPER, "clamp"), (GAPPED, "clamp"), (GAPPED, "floor")):
        one, other = (map_material(hu, given, policy=policy, device=device) for device in both_devices)
        for name in ("density_g_cm3", "modulus_mpa", "poisson", "piece"):
            assert np.array_equal(getattr(one, name), getattr(other, name)), name


@pytest.mark.parametrize("exponent", [0.01, 0.5, 1.0, 1.64, 3.09, 10.0])
def test_powers_of_density(exponent: float, device: Device) -> None:
    """Densities of 1e-5 to 1,000 g/cm3, far beyond any tissue."""
    direct = Law("power", "E = rho^e", DensityRelation("ash", 1.0), (Piece(1e-5, 1000.0, 1.0, exponent),))
    rho = np.concatenate([np.geomspace(1e-5, 1000, 1001), 1 + np.linspace(-1e-3, 1e-3, 101)]).astype(np.float32)
    rho = rho.clip(np.float32(1e-5), 1000)
    expected = rho.astype(float) ** exponent
    found = map_material(rho, direct, device=device).modulus_mpa
    kept = expected > 1e-37
    np.testing.assert_allclose(found[kept], expected[kept], rtol=1.5e-6 * max(exponent, 1))
    assert np.all(found[~kept] < 1e-37)


def test_no_density_has_no_modulus(device: Device) -> None:
    law = Law("offset", "E = rho^2 + 5", DensityRelation("ash", 1.0, 0.5), (Piece(-1.0, 1.0, 1.0, 2.0, 5.0),))
    material = map_material(np.array([-1.0, -0.5, 0.5]), law, device=device)
    np.testing.assert_allclose(material.modulus_mpa, [5.0, 5.0, 6.0], rtol=1e-6)


@pytest.mark.parametrize("kind", [np.int16, np.int64, np.uint8, np.float64, list])
def test_whole_numbers_are_hu_too(kind: Any, device: Device) -> None:
    """As a CT has them: a kernel took their bits for floats."""
    hu = np.array([0, 100, 200, 255])
    given = hu.tolist() if kind is list else hu.astype(kind)
    expected = map_material(hu.astype(device.real), PAPER, device=device)
    np.testing.assert_array_equal(map_material(given, PAPER, device=device).modulus_mpa, expected.modulus_mpa)


def test_hu_that_is_no_number_is_out_of_range(device: Device) -> None:
    for policy in ("clamp", "floor"):
        material = map_material(np.array([np.nan, -np.inf, np.inf, 300.0]), GAPPED, policy=policy, device=device)
        assert material.out_of_range == 3 and np.isfinite(material.modulus_mpa).all()


def test_edges_of_ranges(device64: Device) -> None:
    below = np.nextafter(350.0, 0.0)
    hu = np.array([100.0, 349.0, 349.5, below, 350.0, 2000.0])
    material = map_material(hu, PAPER, policy="error", device=device64)
    assert material.piece.tolist() == [0, 0, 0, 0, 1, 1]
    expected = [1904 * (1.9 * value / 1630) ** 1.64 for value in (100.0, 349.0, 349.5, below)]
    expected += [2065 * (1.9 * value / 1630) ** 3.09 for value in (350.0, 2000.0)]
    np.testing.assert_allclose(material.modulus_mpa, expected, rtol=1e-13)
    assert material.modulus_mpa[1] == pytest.approx(435.58, abs=0.01)  # the paper's jump: 436 at 349 HU ...
    assert material.modulus_mpa[4] == pytest.approx(129.35, abs=0.01)  # ... to 129 at 350 HU


def test_clamp_takes_the_nearest_end(device: Device) -> None:
    material = map_material(np.array([-1000.0, 199.0, 200.0, 440.0, 470.0, 1000.0, 3000.0]), GAPPED, device=device)
    # rho = HU / 1000 - 0.1 at the HU moved to 200, 200, 200, 400, 500, 1000, 1000
    np.testing.assert_allclose(material.density_g_cm3, [0.1, 0.1, 0.1, 0.3, 0.4, 0.9, 0.9], rtol=1e-5)
    np.testing.assert_allclose(material.modulus_mpa, [110, 110, 110, 310, 780, 1780, 1780], rtol=1e-5)
    np.testing.assert_allclose(material.poisson, [0.2, 0.2, 0.2, 0.2, 0.4, 0.4, 0.4], rtol=1e-6)
    assert material.piece.tolist() == [-1, -1, 0, -1, -2, 1, -2]
    assert material.out_of_range == 5


def test_floor_keeps_the_density(device: Device) -> None:
    hu = np.array([-1000.0, 50.0, 300.0, 450.0, 3000.0])
    material = map_material(hu, GAPPED, policy="floor", floor_modulus_mpa=2.5, floor_poisson=0.45, device=device)
    np.testing.assert_allclose(material.density_g_cm3, [0.0, 0.0, 0.2, 0.35, 2.9], rtol=1e-5)
    np.testing.assert_allclose(material.modulus_mpa, [2.5, 2.5, 210.0, 2.5, 2.5], rtol=1e-5)
    np.testing.assert_allclose(material.poisson, [0.45, 0.45, 0.2, 0.45, 0.45], rtol=1e-6)
    assert material.out_of_range == 4


def test_error_says_what_came(device: Device) -> None:
    with pytest.raises(InputError) as error:
        map_material(np.array([-20.0, 300.0, 450.0, 900.0]), GAPPED, policy="error", device=device)
    assert "expected HU of 200 to 400, 500 to 1000" in str(error.value)
    assert "got -20 to 450 HU at 2 of 4 nodes" in str(error.value)


def test_density_by_a_table(device: Device) -> None:
    """HU 0, 100, 500 are 0, 0.2, 0.4 g/cm3, the outer lines going on: by ``np.interp``."""
    relation = DensityRelation.from_points("ash", ((0.0, 0.0), (500.0, 0.4), (100.0, 0.2)), "table")
    linear = Law("table", "E = 1000 rho", relation, (Piece(10.0, 900.0, 1000.0, 1.0),))
    hu = np.array([-50.0, 10.0, 50.0, 99.0, 100.0, 300.0, 500.0, 700.0])
    expected = np.interp(hu, [-100, 0, 100, 500, 900], [0, 0, 0.2, 0.4, 0.6])
    material = map_material(hu, linear, policy="floor", device=device)
    np.testing.assert_allclose(material.density_g_cm3, expected, atol=1e-6)
    np.testing.assert_allclose(material.modulus_mpa[1:], 1000 * expected[1:], rtol=1e-5)
    assert [relation.density_g_cm3(value) for value in hu] == pytest.approx(expected.tolist())
    assert [relation.hu(value) for value in expected[1:]] == pytest.approx(hu[1:].tolist())


def test_bad_policy_and_floor(device: Device) -> None:
    with pytest.raises(InputError, match="policy of clamp, floor, error for HU outside the law, got 'ignore'"):
        map_material(np.zeros(3), PAPER, policy="ignore", device=device)
    for floor in ({"floor_modulus_mpa": 0.0}, {"floor_modulus_mpa": math.nan}, {"floor_poisson": 0.5}):
        with pytest.raises(InputError, match="positive floor modulus"):
            map_material(np.zeros(3), PAPER, policy="floor", device=device, **floor)


@pytest.mark.parametrize("name", sorted(laws()))
def test_modulus_rises_with_hu_but_for_the_stated_jumps(name: str, device64: Device) -> None:
    found = laws()[name]
    hu = np.linspace(*found.range_hu, 5_000)
    material = map_material(hu, found, policy="error", device=device64)
    assert np.all(material.modulus_mpa > 0)
    jumps = np.searchsorted(hu, [at for at, below, above in found.jumps() if above < below]) - 1
    falls = np.flatnonzero(np.diff(material.modulus_mpa) <= 0)
    assert falls.tolist() == jumps.tolist()


QUADS = Mesh(
    points=np.random.default_rng(3).uniform(size=(9, 3)),
    element_type="quad4",
    connectivity=np.array([[0, 1, 2, 3], [2, 3, 4, 5], [4, 5, 6, 7], [0, 1, 2, 8]], dtype=np.int32),
    fields={"HU": np.array([210.0, 220, 390, 400, 550, 560, 600, 610, -3000])},
)


def test_mesh_gets_fields(device: Device) -> None:
    mesh, material = apply_material(QUADS, GAPPED, device=device)
    assert isinstance(material, Material) and material.out_of_range == 2  # 400 HU, the open end of a range, and -3000
    nodal = map_material(QUADS.fields["HU"], GAPPED, device=device)
    assert list(mesh.fields) == ["HU", "density_g_cm3", "E_MPa", "nu"]
    assert np.array_equal(mesh.fields["E_MPa"], nodal.modulus_mpa)
    # means 305, 475 (in the gap, nearer to 500), 580 and -545 HU
    assert mesh.cell_fields["material"].tolist() == [1, 2, 2, 1]
    floored, _ = apply_material(QUADS, GAPPED, policy="floor", device=device)
    assert floored.cell_fields["material"].tolist() == [1, 0, 2, 0]
    assert mesh.cell_fields["material"].dtype == np.int32


def test_default_is_the_papers_law(device: Device) -> None:
    mesh, material = apply_material(QUADS, device=device)
    assert material.law == PAPER and material.policy == "clamp"
    assert mesh.fields["nu"].tolist() == pytest.approx([0.3, 0.3, 0.36, 0.36, 0.36, 0.36, 0.36, 0.36, 0.3], rel=1e-6)


@pytest.mark.parametrize(
    ("element_type", "counts", "n_nodes"),
    [("quad4", (5, 4), 20), ("quad8", (5, 4), 51), ("hex8", (3, 4, 2), 24), ("hex27", (3, 4, 2), 5 * 7 * 3)],
)
def test_element_material_of_a_structured_mesh(
    element_type: str, counts: tuple[int, ...], n_nodes: int, device: Device
) -> None:
    random = np.random.default_rng(5)
    fields = {"HU": random.uniform(0, 700, n_nodes)}
    mesh = Mesh(random.uniform(size=(n_nodes, 3)), element_type, structure=counts, fields=fields)
    explicit = Mesh(mesh.points, element_type, connectivity=mesh.cells, fields=fields)
    mean = fields["HU"][mesh.cells[:, : mesh.element.n_corners]].mean(axis=1)
    expected = np.where(mean < 350, 1, 2)
    assert 0 < np.count_nonzero(expected == 1) < len(expected)
    for each in (mesh, explicit):
        assert np.array_equal(apply_material(each, device=device)[0].cell_fields["material"], expected)


def test_mesh_without_hu(device: Device) -> None:
    with pytest.raises(InputError, match="nodal field HU, got the fields none"):
        apply_material(replace(QUADS, fields={}), device=device)


@pytest.mark.parametrize("wild", [np.nan, np.inf, -np.inf])
def test_a_mesh_with_hu_that_are_no_numbers_is_refused(wild: float, device: Device) -> None:
    """Its nodes were bone of the law's lowest modulus, or of infinite density where the policy was floor."""
    points = np.array([(0.0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)])
    mesh = Mesh(points, "quad4", structure=(2, 2), fields={"HU": np.array([500.0, wild, 700.0, wild])})
    for how in ("nodal", "element-e", "nodal-hu"):
        with pytest.raises(InputError, match="expected finite HU, got NaN or infinity at 2 of 4 nodes"):
            assign(mesh, PAPER, Mapping(how), device=device)
