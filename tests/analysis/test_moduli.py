"""Material of elements and of Gauss points in the analysis: against nodal fields, against scikit-fem, and refused."""

import numpy as np
import pytest

from gpubspline.analysis.elasticity import solve
from gpubspline.analysis.gauss import gauss_stress
from gpubspline.analysis.load_case import LoadCase, Support
from gpubspline.analysis.loads import assemble
from gpubspline.analysis.moduli import check_material, values_at
from gpubspline.analysis.regions import HalfSpace, Region
from gpubspline.ct.volume import Volume
from gpubspline.device import Device
from gpubspline.errors import InputError
from gpubspline.material.assign import Mapping, assign
from gpubspline.material.laws import DensityRelation, Law, Piece
from gpubspline.mesh.mesh import Mesh

LINEAR = Law("linear", "E = 1000 rho", DensityRelation("apparent", 0.001), (Piece(1.0, 9000.0, 1000.0, 1.0, 0.0, 0.3),))


def block(element_type: str = "hex8", counts: tuple[int, ...] = (3, 4, 6)) -> Mesh:
    """A box of 6 x 8 x 20 mm, HU linear along its length."""
    order = 2 if element_type != "hex8" else 1
    axes = [np.linspace(0, s, order * (n - 1) + 1) for s, n in zip((6.0, 8.0, 20.0), counts, strict=True)]
    x, y, z = (a.ravel(order="F") for a in np.meshgrid(*axes, indexing="ij"))
    if element_type == "hex20":
        odd = sum(np.meshgrid(*[np.arange(len(a)) % 2 for a in axes], indexing="ij")).ravel(order="F")
        x, y, z = x[odd < 2], y[odd < 2], z[odd < 2]
    return Mesh(np.stack([x, y, z], axis=1), element_type, structure=counts, fields={"HU": 1000 + 100 * z})


def pulled(mesh: Mesh, device: Device, **options: str) -> np.ndarray:
    z = mesh.points[:, 2]
    held = np.zeros((mesh.n_nodes, 3), dtype=bool)
    held[z == 0] = True
    forces = np.zeros((mesh.n_nodes, 3))
    forces[z == z.max(), 2] = 100.0 / np.count_nonzero(z == z.max())
    return solve(mesh, held, forces, device=device, tolerance=1e-11, **options).displacement_mm


@pytest.mark.parametrize("element_type", ["hex8", "hex20", "hex27"])
def test_gauss_points_of_a_linear_field_are_the_graded_modulus(element_type: str, device64: Device) -> None:
    """A law linear in HU, HU linear in space: the modulus at Gauss points is the nodes', interpolated."""
    mesh = block(element_type)
    nodal, _ = assign(mesh, LINEAR, device=device64)
    gauss, _ = assign(mesh, LINEAR, Mapping("gauss"), device=device64)
    assert "E_MPa" not in gauss.fields
    one, other = pulled(nodal, device64), pulled(gauss, device64)
    np.testing.assert_allclose(other, one, atol=1e-9 * np.abs(one).max())
    stress, same = (gauss_stress(m, one, np.arange(3, 9)).stress for m in (nodal, gauss))
    np.testing.assert_allclose(same, stress, atol=1e-9 * np.abs(stress).max())


@pytest.mark.parametrize("element_type", ["hex8", "hex20"])
def test_element_fields_are_the_modulus_of_elements(element_type: str, device64: Device) -> None:
    """One modulus an element, its nodes' mean: as ``modulus="element"`` of the nodal fields."""
    mesh = block(element_type)
    nodal, _ = assign(mesh, LINEAR, device=device64)
    mapped, _ = assign(mesh, LINEAR, Mapping("element-e"), device=device64)
    means = nodal.fields["E_MPa"][mesh.cells].mean(axis=1)
    np.testing.assert_allclose(mapped.cell_fields["E_MPa"], means, rtol=1e-12)
    one, other = pulled(nodal, device64, modulus="element"), pulled(mapped, device64)
    np.testing.assert_allclose(other, one, atol=1e-9 * np.abs(one).max())


def test_a_steep_law_at_gauss_points_is_no_nodal_one(device64: Device) -> None:
    """The law of interpolated HU and the interpolated law differ; both lie between the element's extremes."""
    steep = Law("steep", "rho^3", DensityRelation("apparent", 0.001), (Piece(1.0, 9000.0, 1000.0, 3.0),))
    mesh = block()
    volume = Volume(np.repeat(1000 + 100 * np.arange(22.0), 144).reshape(22, 12, 12).astype(np.float32), np.eye(4))
    nodal, _ = assign(mesh, steep, device=device64)
    gauss, _ = assign(mesh, steep, Mapping("gauss"), volume=volume, device=device64)
    at, _ = mesh.element.gauss()
    shape, cells = mesh.element.shape(at), mesh.cells
    z = np.einsum("gk,mk->gm", shape, mesh.points[cells][..., 2])
    np.testing.assert_allclose(values_at(gauss, "E_MPa", cells, shape), 1000 * (1 + 0.1 * z) ** 3, rtol=1e-6)
    assert np.all(values_at(nodal, "E_MPa", cells, shape) > values_at(gauss, "E_MPa", cells, shape))
    assert np.abs(pulled(gauss, device64)).max() > np.abs(pulled(nodal, device64)).max()


def test_gravity_takes_the_elements_density() -> None:
    """960 mm3 of 1.5 g/cm3, the upper elements of 3."""
    mesh = block()
    upper = mesh.points[mesh.cells][..., 2].mean(axis=1) > 10
    mesh = mesh.with_cell_fields({"density_g_cm3": np.where(upper, 3.0, 1.5)})
    held = Support(Region("top", (HalfSpace((0, 0, 20), (0, 0, 1)),)))
    made = assemble(LoadCase("hang", (held,), gravity_mm_s2=(0, 0, -9810)), mesh)
    expected = -9810 * 960e-9 * (1.5 + 1.5 * upper.mean())
    np.testing.assert_allclose(made.applied_n, [0, 0, expected], rtol=1e-12, atol=1e-15)


def test_what_has_no_material() -> None:
    bare = block()
    with pytest.raises(InputError, match="fields E_MPa and nu, got a mesh without E_MPa"):
        check_material(bare)
    soft = bare.with_cell_fields({"E_MPa": np.zeros(bare.n_elements), "nu": np.full(bare.n_elements, 0.3)})
    with pytest.raises(InputError, match="positive moduli, got a least of 0 MPa"):
        check_material(soft)
    cells = {"E_MPa": np.ones(bare.n_elements), "nu": np.full(bare.n_elements, 0.3)}
    gauss = bare.with_cell_fields({**cells, "E_MPa_1": np.full(bare.n_elements, -1.0)})
    with pytest.raises(InputError, match="got a least of -1 MPa"):
        check_material(gauss)
