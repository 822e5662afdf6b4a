"""Certificates of the Jacobian determinant: known elements, dense samples, scikit-fem, and counter-examples."""

import numpy as np
import pytest

from gpubspline.errors import InputError
from gpubspline.mesh.bernstein import bernstein, from_samples, halves, lobatto
from gpubspline.mesh.elements import ELEMENTS
from gpubspline.mesh.mesh import Mesh
from gpubspline.mesh.quality import scaled_jacobian
from gpubspline.mesh.validity import certify

HEXES = ("hex8", "hex20", "hex27")


def elements_of(element_type, points):
    points = np.asarray(points, dtype=float)
    return Mesh(
        points.reshape(-1, 3), element_type, connectivity=np.arange(points[..., 0].size).reshape(len(points), -1)
    )


def unit(element_type):
    return np.array(ELEMENTS[element_type].vertices) / 2


def distorted(element_type, n=400, seed=0, most=0.45):
    rng = np.random.default_rng(seed)
    shape = unit(element_type)
    noise = rng.normal(size=(n, *shape.shape)) * rng.uniform(0, most / ELEMENTS[element_type].order, (n, 1, 1))
    return elements_of(element_type, 2 * (shape + noise) + np.array([-80.0, 120.0, 300.0]))


def sampled_ratio(mesh, per_edge=13):
    """Least determinant over the mean one of each element, by the gradients at a grid of places."""
    line = np.linspace(0, 1, per_edge)
    at = np.stack(np.meshgrid(line, line, line), axis=-1).reshape(-1, 3)
    nodes = mesh.points[mesh.cells].astype(float)
    points, weights = mesh.element.gauss()

    def determinants(places):
        return np.linalg.det(np.einsum("dgk,mkc->mgdc", mesh.element.gradient(places), nodes))

    mean = determinants(points) @ weights
    return determinants(at).min(axis=1), mean


@pytest.mark.parametrize("degree", [2, 5])
def test_bernstein_matrices_reproduce_polynomials(degree):
    coefficients = np.random.default_rng(degree).normal(size=degree + 1)
    values = bernstein(degree, lobatto(degree)) @ coefficients
    np.testing.assert_allclose(from_samples(degree) @ values, coefficients, atol=1e-12)
    low, high = np.split(halves(degree) @ coefficients, 2)
    at = np.linspace(0, 1, 17)
    np.testing.assert_allclose(bernstein(degree, at) @ low, bernstein(degree, at / 2) @ coefficients, atol=1e-13)
    np.testing.assert_allclose(bernstein(degree, at) @ high, bernstein(degree, 0.5 + at / 2) @ coefficients, atol=1e-13)


@pytest.mark.parametrize("element_type", HEXES)
def test_parallelepipeds_have_the_ratio_one(element_type, device):
    sheared = np.array([[1.0, 0.2, 0], [0.4, 1, 0], [0.2, -0.3, 2]])
    found = certify(elements_of(element_type, [unit(element_type) @ sheared + 30]), device)
    assert found.certificate.valid and found.certificate.to_dict()["certified"] == 1
    assert found.lower[0] == pytest.approx(1, abs=1e-9) and found.upper[0] == pytest.approx(1, abs=1e-9)


@pytest.mark.parametrize("element_type", HEXES)
def test_bounds_hold_against_dense_samples(element_type, device):
    """No sample lies below the lower bound; what is called negative has a place that is; what is certified has none."""
    mesh = distorted(element_type)
    found = certify(mesh, device)
    least, mean = sampled_ratio(mesh)
    positive = mean > 1e-9
    slack = 1e-9
    assert (least[positive] / mean[positive] >= found.lower[positive] - slack).all()
    certified = (found.lower > 0) & positive
    assert (least[certified] > 0).all()
    assert found.certificate.certified == np.count_nonzero(certified)
    assert found.certificate.undecided == 0 and 50 < found.certificate.negative < 350
    assert (found.upper[~certified] <= slack).all()


def test_bounds_hold_against_the_determinants_of_scikit_fem(device):
    """By its own mapping of trilinear hexes, at a grid of places and, for the mean, at Gauss points."""
    skfem = pytest.importorskip("skfem")
    mesh = distorted("hex8", 40, most=0.1)
    mapping = skfem.MeshHex(mesh.points.T.copy(), mesh.cells[:, [0, 1, 3, 4, 2, 5, 7, 6]].T.copy()).mapping()
    line = np.linspace(0, 1, 21)
    at = np.stack(np.meshgrid(line, line, line), axis=-1).reshape(-1, 3).T
    points, weights = mesh.element.gauss()
    ratio = np.abs(mapping.detDF(at)).min(axis=1) / (np.abs(mapping.detDF(points.T)) @ weights)
    found = certify(mesh, device)
    assert found.certificate.valid
    assert (ratio >= found.lower - 1e-9).all() and (ratio <= found.upper + 1e-9).all()
    assert (found.upper - found.lower).max() < 0.2


def test_positive_corners_do_not_make_a_hex_valid(device):
    """All eight corners of this hex are positive, and so are its edges' ends; inside the determinant is not.

    Found by search among hexes with a twisted top; the sample at the named place is the proof.
    """
    mesh, place = twisted()
    assert scaled_jacobian(mesh, device)[0] > 0
    gradient = mesh.element.gradient([place])[:, 0]
    assert np.linalg.det(gradient @ mesh.points[mesh.cells[0]]) < 0
    found = certify(mesh, device)
    assert found.verdict.tolist() == [-1]


def twisted():
    """The worst of many hexes whose corners are all positive, and where it is worst."""
    rng = np.random.default_rng(11)
    shape = unit("hex8")
    points = shape + rng.uniform(-0.75, 0.75, (20000, 8, 3))
    line = np.linspace(0, 1, 7)
    at = np.stack(np.meshgrid(line, line, line), axis=-1).reshape(-1, 3)
    element = ELEMENTS["hex8"]

    def determinants(places, chosen):
        return np.linalg.det(np.einsum("dgk,mkc->mgdc", element.gradient(places), chosen))

    good = points[(determinants(shape, points) > 0.02).all(axis=1)]
    inside = determinants(at, good)
    worst = int(np.argmin(inside.min(axis=1)))
    assert inside[worst].min() < -0.01
    return elements_of("hex8", [good[worst]]), at[int(np.argmin(inside[worst]))]


def test_a_midside_node_beyond_the_quarter_point_inverts_a_corner(device):
    """An edge's middle node inside its first quarter turns the tangent at the corner round (Barsoum 1976)."""
    for share, valid in ((0.26, True), (0.24, False)):
        points = unit("hex20")
        points[8, 0] = share
        found = certify(elements_of("hex20", [points]), device)
        assert found.certificate.valid is valid, share
        assert scaled_jacobian(elements_of("hex20", [points]), device)[0] == pytest.approx(1)


def test_a_quadratic_hex_with_straight_edges_is_the_trilinear_one(device):
    mesh = distorted("hex8", 200)
    at = unit("hex27")
    fine = elements_of("hex27", np.einsum("gk,mkc->mgc", mesh.element.shape(at), mesh.points[mesh.cells]))
    straight, curved = certify(mesh, device), certify(fine, device)
    np.testing.assert_array_equal(straight.verdict, curved.verdict)


@pytest.mark.parametrize("element_type", HEXES)
def test_inverted_collapsed_and_flat_elements_are_not_certified(element_type, device):
    shape = unit(element_type)
    collapsed, flat = shape.copy(), shape * [1, 1, 0]
    collapsed[:, 0] *= shape[:, 2]  # to an edge at the bottom
    mesh = elements_of(element_type, [shape * [-1, 1, 1], collapsed, flat, 0 * shape, shape])
    found = certify(mesh, device)
    assert found.verdict.tolist() == [-1, -1, -1, -1, 1] and found.lower[4] == pytest.approx(1)
    assert np.isfinite(found.lower).all() and np.isfinite(found.upper).all()
    np.testing.assert_array_equal([found.lower[[0, 2, 3]], found.upper[[0, 2, 3]]], [[-1, 0, 0]] * 2)  # no mean


def test_what_is_not_cut_far_enough_stays_open(device, monkeypatch):
    """Fewer cuts give wider bounds; what they do not decide is not certified."""
    mesh = distorted("hex27", 100)
    whole = certify(mesh, device)
    monkeypatch.setattr("gpubspline.mesh.validity.DEPTH", 0)
    found = certify(mesh, device)
    assert np.all(found.lower <= whole.lower + 1e-12) and np.all(found.upper >= whole.upper - 1e-12)
    assert np.all((found.verdict == whole.verdict) | (found.verdict == 0)) and (found.verdict == 0).sum() > 10


@pytest.mark.parametrize(("far_mm", "thickness", "dtype"), [(1e6, 1e-4, np.float64), (0.5, 1e-9, np.float32)])
def test_rounding_certifies_nothing(far_mm, thickness, dtype, device, monkeypatch):
    """Sheared hexes inverted by so little that in float32 some come out upright: by their places, or by the sums."""
    monkeypatch.setattr("gpubspline.mesh.validity._in_float64", lambda device: device)
    rng, n, shape = np.random.default_rng(0), 4000, unit("hex8")
    size = np.ones((n, 1, 3))
    size[:, 0, 2] = -thickness * 10 ** rng.uniform(-1, 1, n)
    turn = np.linalg.qr(rng.normal(size=(n, 3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))[:, None, None]
    points = (shape * size + shape[:, 2:] * [0.7, 0.4, 0]) @ turn + far_mm * rng.uniform(-1, 1, (n, 1, 3))
    mesh = Mesh(points.reshape(-1, 3).astype(dtype), "hex8", connectivity=np.arange(8 * n).reshape(n, 8))
    assert not (certify(mesh, device).verdict == 1).any()
    monkeypatch.setattr("gpubspline.mesh.validity._margin", lambda mesh, *others: np.zeros(mesh.n_elements))
    assert (certify(mesh, device).verdict == 1).any()


def test_structured_and_explicit_meshes_agree(device):
    counts = (5, 4, 6)
    grid = np.stack(np.meshgrid(*[np.arange(n) for n in counts], indexing="ij"), axis=-1).reshape(-1, 3, order="F")
    points = grid + np.random.default_rng(4).uniform(-0.25, 0.25, grid.shape)
    mesh = Mesh(points.astype(np.float32), "hex8", structure=counts)
    one, other = certify(mesh, device), certify(Mesh(mesh.points, "hex8", connectivity=mesh.cells), device)
    np.testing.assert_array_equal(one.lower, other.lower)


def test_both_backends_agree(both_devices):
    one, other = (certify(distorted("hex27", 200), device) for device in both_devices)
    np.testing.assert_allclose(one.lower, other.lower, rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(one.verdict, other.verdict)


def test_quads_are_refused(device):
    quad = Mesh(np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]), "quad4", connectivity=np.arange(4)[None])
    with pytest.raises(InputError, match="expected hexes"):
        certify(quad, device)
