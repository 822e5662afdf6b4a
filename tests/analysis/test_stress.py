"""Stress of known displacements: linear fields, bending, energy against scikit-fem, and what the figures count."""

import numpy as np
import pytest

from gpubspline.analysis.gauss import gauss_stress, principal, von_mises
from gpubspline.analysis.stiffness import FORMULATIONS
from gpubspline.analysis.stress import PERCENTILE, _Seen, extrapolate, recover
from gpubspline.errors import InputError
from gpubspline.mesh import structure
from gpubspline.mesh.elements import ELEMENTS
from gpubspline.mesh.mesh import Mesh

HEXES = ("hex8", "hex20", "hex27")
SLOPE = np.array([[0.3, -0.2, 0.5], [0.1, 0.4, 0.25], [-0.6, 0.05, -0.1]]) * 1e-3
PLACES = [(0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2)]


def box(element_type="hex8", counts=(4, 3, 5), place=lambda p: p, modulus=lambda p: 1000 + 0 * p[:, 0], nu=0.3):
    """A structured mesh of the unit box with its material, its points moved by ``place``."""
    element = ELEMENTS[element_type]
    axes = [np.linspace(0, 1, n) for n in structure.lattice_counts(element, counts)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3, order="F")
    kept = structure.has_node(element, counts)
    points = place(grid if kept is None else grid[kept])
    material = {"E_MPa": modulus(points), "nu": np.full(len(points), nu)}
    return Mesh(points, element_type, structure=counts, fields=material)


def stirred(p):
    """Straight box, its inner points moved; midway points of curved elements, too."""
    inner = np.prod(p * (1 - p), axis=1)[:, None]
    return p + inner * np.sin(9 * p[:, [1, 2, 0]] + 1)


def hooke(strain, modulus, nu):
    """Stress (6, ...) of a strain (3, 3) where the modulus is (...)."""
    stiff = modulus / (1 + nu) * (strain + nu / (1 - 2 * nu) * np.trace(strain) * np.eye(3))[..., None, None]
    return np.stack([stiff[i, j] for i, j in PLACES])


def gauss_points(mesh):
    return np.einsum("gk,mkc->cgm", mesh.element.shape(mesh.element.gauss()[0]), mesh.points[mesh.cells])


@pytest.mark.parametrize(
    ("element_type", "formulation"), [(name, "full") for name in HEXES] + [("hex8", f) for f in FORMULATIONS[1:]]
)
def test_stress_of_a_linear_displacement_is_exact(element_type, formulation):
    """Distorted elements, the modulus linear in space: every Gauss point has its own; no formulation disturbs it."""
    mesh = box(element_type, place=stirred, modulus=lambda p: 1000 + 500 * p[:, 0] + 200 * p[:, 2])
    if formulation == "incompatible":  # its modes answer a stress that varies: an even one is the patch test
        mesh = box(element_type, place=stirred)
    found = gauss_stress(mesh, mesh.points @ SLOPE.T, formulation=formulation)
    strain = (SLOPE + SLOPE.T) / 2
    at = gauss_points(mesh)
    modulus = np.full(at.shape[1:], 1000.0) if formulation == "incompatible" else 1000 + 500 * at[0] + 200 * at[2]
    expected = hooke(strain, modulus, 0.3)
    np.testing.assert_allclose(found.strain, np.array([strain[p] for p in PLACES])[:, None, None] + 0 * found.strain)
    np.testing.assert_allclose(found.stress, expected, rtol=1e-11, atol=1e-13)
    twice = np.array([1, 1, 1, 2, 2, 2])
    energy = np.einsum("c,cgm,cgm->gm", twice, found.strain, expected) / 2
    np.testing.assert_allclose(found.energy, energy, rtol=1e-11)
    assert found.volume.sum() == pytest.approx(1, rel=1e-12)


@pytest.mark.parametrize("element_type", HEXES)
def test_a_rigid_motion_has_no_stress(element_type):
    mesh = box(element_type, place=stirred)
    spin = np.array([[0, -3, 2], [3, 0, -1], [-2, 1, 0]]) * 1e-3
    recovered = recover(mesh, mesh.points @ spin.T + [1, 2, 3])
    assert recovered.figures.max_von_mises_mpa < 1e-11
    assert recovered.figures.strain_energy_nmm < 1e-24


def test_an_element_modulus_is_the_mean_of_its_nodes():
    mesh = box("hex8", modulus=lambda p: 1000 + 300 * p[:, 2])
    found = gauss_stress(mesh, mesh.points @ SLOPE.T, modulus="element")
    mean = 1000 + 300 * mesh.points[mesh.cells][..., 2].mean(axis=1)
    expected = hooke((SLOPE + SLOPE.T) / 2, np.broadcast_to(mean, found.energy.shape), 0.3)
    np.testing.assert_allclose(found.stress, expected, rtol=1e-11, atol=1e-13)


@pytest.mark.parametrize("element_type", HEXES)
def test_no_point_is_stiffer_or_softer_than_the_nodes_around_it(element_type):
    """Quadratic shape functions alone would give a modulus below 0 between a stiff and a soft node."""
    mesh = box(element_type, modulus=lambda p: np.where(np.sin(37 * p.sum(axis=1)) > 0.4, 9000.0, 50.0), nu=0.0)
    found = gauss_stress(mesh, mesh.points * [1e-3, 0, 0])
    nodal = mesh.fields["E_MPa"][mesh.cells] * 1e-3
    low, high = nodal.min(axis=1) * (1 - 1e-9), nodal.max(axis=1) * (1 + 1e-9)
    assert (low <= found.stress[0]).all() and (found.stress[0] <= high).all() and (low < high).any()


def test_chosen_elements_are_those_of_the_whole():
    mesh, some = box("hex20", place=stirred), np.array([7, 2, 11])
    displacement = np.sin(mesh.points * 3) * 1e-3
    whole, part = gauss_stress(mesh, displacement), gauss_stress(mesh, displacement, some)
    np.testing.assert_allclose(part.stress, whole.stress[..., some], rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.49])
def test_incompatible_modes_bend_as_a_beam_does(nu):
    """Pure bending: sigma_xx = E kappa z and nothing else, from one layer of brick elements; plain ones are too stiff.

    Source: Timoshenko and Goodier, Theory of Elasticity, pure bending of prismatical bars.
    """
    modulus, kappa = 1000.0, 1e-3
    mesh = box("hex8", (4, 2, 2), lambda p: (p - [0, 0.5, 0.5]) * [12, 2, 3], nu=nu)
    x, y, z = mesh.points.T
    along = -(x**2 + nu * (z**2 - y**2)) / 2
    displacement = kappa * np.stack([x * z, -nu * y * z, along], axis=1)
    found = gauss_stress(mesh, displacement, formulation="incompatible")
    expected = np.zeros_like(found.stress)
    expected[0] = modulus * kappa * gauss_points(mesh)[2]
    np.testing.assert_allclose(found.stress, expected, atol=1e-12)
    plain = gauss_stress(mesh, displacement)
    assert np.abs(plain.stress - expected).max() > 0.3


def test_mean_dilatation_leaves_the_deviator_alone():
    mesh = box("hex8", place=stirred, nu=0.499)
    displacement = np.sin(mesh.points[:, [2, 0, 1]] * 2) * 1e-3
    full, mean = (gauss_stress(mesh, displacement, formulation=name) for name in ("full", "bbar"))
    dilatation = mean.strain[:3].sum(axis=0)
    np.testing.assert_allclose(dilatation, dilatation[:1] + 0 * dilatation, rtol=1e-12)
    grown = (full.strain[:3].sum(axis=0) * full.volume).sum(axis=0)
    np.testing.assert_allclose((dilatation * mean.volume).sum(axis=0), grown, rtol=1e-11, atol=1e-18)
    np.testing.assert_allclose(mean.stress[3:], full.stress[3:], rtol=1e-12)
    np.testing.assert_allclose(von_mises(mean.stress), von_mises(full.stress), rtol=1e-9)


def test_strain_energy_is_half_the_work_of_scikit_fems_stiffness():
    skfem = pytest.importorskip("skfem")
    from skfem.io import from_meshio
    from skfem.models.elasticity import lame_parameters, linear_elasticity

    mesh = box("hex8", place=stirred)
    displacement = np.sin(mesh.points * 2 + mesh.points[:, [1, 2, 0]]) * 1e-3
    given = mesh.to_meshio()
    given.point_sets, given.cell_sets = {}, {}
    basis = skfem.Basis(from_meshio(given), skfem.ElementVector(skfem.ElementHex1()), intorder=3)  # 2 Gauss points
    stiffness = linear_elasticity(*lame_parameters(1000.0, 0.3)).assemble(basis)
    u = np.zeros(basis.N)
    u[basis.nodal_dofs] = displacement.T
    assert recover(mesh, displacement).figures.strain_energy_nmm == pytest.approx(u @ stiffness @ u / 2, rel=1e-11)


def test_von_mises_and_principal_values_of_known_stresses():
    """Pull s, shear t, pressure p: s, sqrt(3) t, 0. A turned tensor has the principal values it was made of."""
    simple = np.array([[5.0, 0, 0, 0, 0, 0], [0, 0, 0, 0, 2.0, 0], [-3.0, -3, -3, 0, 0, 0]]).T
    np.testing.assert_allclose(von_mises(simple), [5, 2 * np.sqrt(3), 0], atol=1e-14)
    np.testing.assert_allclose(principal(simple), [[5, 2, -3], [0, 0, -3], [0, -2, -3]], atol=1e-14)
    rng = np.random.default_rng(4)
    values = np.sort(rng.normal(size=(50, 3)), axis=1)[:, ::-1] * 10
    turns = np.linalg.qr(rng.normal(size=(50, 3, 3)))[0]
    tensors = np.einsum("nij,nj,nkj->nik", turns, values, turns)
    stress = np.array([tensors[:, i, j] for i, j in PLACES])
    np.testing.assert_allclose(principal(stress), values.T, rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(principal(stress).T, np.linalg.eigvalsh(tensors)[:, ::-1], rtol=1e-12, atol=1e-13)
    differences = values - np.roll(values, 1, axis=1)
    np.testing.assert_allclose(von_mises(stress), np.sqrt((differences**2).sum(axis=1) / 2), rtol=1e-12)


@pytest.mark.parametrize("element_type", HEXES)
def test_extrapolation_gives_trilinear_functions_back(element_type):
    element = ELEMENTS[element_type]
    place = np.array(element.vertices) / 2

    def trilinear(t):
        u, v, w = t.T
        return 3 + u - 2 * v + 4 * w + u * v - v * w + 5 * u * v * w

    np.testing.assert_allclose(extrapolate(element) @ trilinear(element.gauss()[0]), trilinear(place), rtol=1e-12)


def test_nodes_get_a_linear_stress_back():
    """hex8: an even strain in a modulus that is linear in space. hex20: a quadratic displacement of a brick."""
    mesh = box("hex8", place=stirred, modulus=lambda p: 1000 + 500 * p[:, 0] - 300 * p[:, 1])
    strain = (SLOPE + SLOPE.T) / 2
    expected = hooke(strain, mesh.fields["E_MPa"][None], 0.3)[:, 0]
    found = recover(mesh, mesh.points @ SLOPE.T)
    np.testing.assert_allclose(found.stress_mpa, expected, rtol=1e-10, atol=1e-12)
    even = np.repeat(strain[[0, 1, 2, 0, 1, 0], [0, 1, 2, 1, 2, 2]][:, None], mesh.n_nodes, axis=1)
    np.testing.assert_allclose(found.strain, even, atol=1e-14)
    turned = np.stack([found.fields()[f"principal_strain_{n}"] for n in (3, 2, 1)], axis=1)
    np.testing.assert_allclose(turned, np.tile(np.linalg.eigvalsh(strain), (mesh.n_nodes, 1)), atol=1e-14)
    mesh = box("hex20", place=lambda p: p * [3, 2, 1], nu=0.0)
    x, _, z = mesh.points.T
    bent = recover(mesh, 1e-3 * np.stack([x * z, 0 * x, -(x**2) / 2], axis=1))
    np.testing.assert_allclose(bent.stress_mpa[0], z, atol=1e-12)
    np.testing.assert_allclose(bent.stress_mpa[1:], 0, atol=1e-12)
    fields = bent.fields()
    assert all(values.shape == (mesh.n_nodes,) for values in fields.values())
    np.testing.assert_allclose(fields["von_mises_mpa"], np.abs(z), atol=1e-11)
    np.testing.assert_allclose(fields["principal_1_mpa"], np.maximum(z, 0), atol=1e-11)
    np.testing.assert_allclose(fields["principal_3_mpa"], np.minimum(z, 0), atol=1e-11)
    np.testing.assert_array_equal(fields["stress_xx_mpa"], bent.stress_mpa[0])
    assert fields["strain_energy_density"].min() >= 0


def pulled(counts=(3, 3, 41), spacing=1.0):
    """A box pulled along z to an even strain of 1e-3, its modulus 1000 (1 + z): stress 1 + z."""
    mesh = box("hex8", counts, lambda p: p ** [1, 1, spacing], lambda p: 1000 * (1 + p[:, 2]), nu=0.0)
    return mesh, mesh.points * [0, 0, 1e-3]


@pytest.mark.parametrize("spacing", [1.0, 3.0])
def test_the_percentile_is_of_volume_however_the_elements_are_spaced(spacing):
    mesh, displacement = pulled(spacing=spacing)
    figures = recover(mesh, displacement).figures
    assert "99 % of the volume" in PERCENTILE
    assert figures.p99_von_mises_mpa == pytest.approx(1.99, abs=0.02)
    assert figures.strain_energy_nmm == pytest.approx(0.5e-3 * 1.5, rel=1e-12)


def test_the_greatest_mean_is_that_of_a_ball_away_from_supports_and_forces():
    """Stress grows linearly along the bar, 1 + z: a whole ball's mean is the stress of its middle."""
    mesh, displacement = pulled()
    gripped = mesh.points[:, 2] == 1
    centres = np.array([[0.5, 0.5, 0.3], [0.5, 0.5, 0.6], [0.5, 0.5, 0.95], [9, 9, 9]])
    how = {"averaged_mm": 0.2, "gripped": gripped, "away_mm": 0.31}
    found = recover(mesh, displacement, **how, centres_mm=centres).figures
    assert found.max_von_mises_mpa == pytest.approx(1.6, abs=0.01) and tuple(found.max_at_mm) == tuple(centres[1])
    for words in ("mean of the von Mises stress, by volume, over balls of 0.2 mm", "0.31 mm", "less than 25 %"):
        assert words in found.definition
    point = recover(mesh, displacement, gripped=gripped, away_mm=0.31).figures
    assert found.max_at_point_mpa == point.max_at_point_mpa == point.max_von_mises_mpa
    at_nodes = recover(mesh, displacement, **how).figures
    assert at_nodes.max_von_mises_mpa == pytest.approx(1.675, abs=0.01)  # the outermost nodes that count
    with pytest.raises(InputError, match=r"balls of 0\.2 mm with 25 % in the body, got none"):
        recover(mesh, displacement, **how, centres_mm=centres[3:])


def test_the_maximum_is_looked_for_away_from_supports_and_forces():
    """The greatest stress of the bar is at its end z = 1, and of what lies more than 0.31 from it at z = 0.675."""
    mesh, displacement = pulled()
    gripped = mesh.points[:, 2] == 1
    everywhere = recover(mesh, displacement).figures
    away = recover(mesh, displacement, gripped=gripped, away_mm=0.31).figures
    last = (1 - 1 / np.sqrt(3)) / 2 / 40  # from the end of the outermost element to its Gauss point
    assert everywhere.max_von_mises_mpa == everywhere.max_anywhere_mpa == pytest.approx(2 - last, rel=1e-12)
    assert away.max_von_mises_mpa == pytest.approx(1.675 - last, rel=1e-12)
    assert away.max_at_mm[2] == pytest.approx(0.675 - last, rel=1e-12)
    assert away.max_anywhere_mpa == everywhere.max_von_mises_mpa
    assert "no node within 0.31 mm" in away.definition and "all elements" in everywhere.definition
    assert away.p99_von_mises_mpa == everywhere.p99_von_mises_mpa
    with pytest.raises(InputError, match="elements further than 2 mm from supports and forces, got none"):
        recover(mesh, displacement, gripped=gripped, away_mm=2.0)


def test_what_has_no_stress_is_refused():
    mesh, _ = pulled()
    bare = Mesh(mesh.points, "hex8", structure=mesh.structure)
    quad = Mesh(np.eye(4, 3), "quad4", structure=(2, 2))
    inverted = Mesh(mesh.points * [1, 1, -1], "hex8", structure=mesh.structure, fields=mesh.fields)
    curved = box("hex20")
    refused = [
        (bare, {}, "E_MPa and nu, got a mesh without E_MPa"),
        (quad, {}, "hexes to have stress, got quad4"),
        (inverted, {}, "160 that are inverted"),
        (mesh, {"modulus": "mean"}, "graded or element, got 'mean'"),
        (mesh, {"formulation": "reduced"}, "full, incompatible, bbar, got 'reduced'"),
        (curved, {"formulation": "bbar"}, "hex8 for the formulation 'bbar', got hex20"),
    ]
    for given, options, message in refused:
        with pytest.raises(InputError, match=message):
            recover(given, np.zeros((given.n_nodes, 3)), **options)


def test_the_percentile_is_of_the_volume_not_of_the_points():
    seen = _Seen(0)
    seen.values.append(np.array([3.0, 1.0, 2.0], np.float32))
    seen.shares.append(np.array([1.0, 97.0, 2.0], np.float32))
    assert [seen.percentile(share) for share in (0.1, 0.969, 0.98, 0.995)] == [1, 1, 2, 3]
