"""Scaled Jacobian: its mathematics, VTK's, and the summary's sums."""

from copy import copy

import numpy as np
import pytest

from gpubspline.errors import InputError
from gpubspline.mesh import structure
from gpubspline.mesh.elements import ELEMENTS
from gpubspline.mesh.mesh import Mesh
from gpubspline.mesh.optimize import optimize
from gpubspline.mesh.quality import (
    assess,
    corner_scaled_jacobian,
    launch_explicit,
    launch_structured,
    scaled_jacobian,
    summarise,
)
from gpubspline.mesh.validity import certify

HEX_NEIGHBOURS = [(1, 3, 4), (2, 0, 5), (3, 1, 6), (0, 2, 7), (7, 5, 0), (4, 6, 1), (5, 7, 2), (6, 4, 3)]


def distorted(element_type, n=3000, seed=0):
    """Separate elements of all shapes, many of them inverted, somewhere in a scanner."""
    rng = np.random.default_rng(seed)
    unit = np.zeros((ELEMENTS[element_type].n_nodes, 3))
    unit[:, : ELEMENTS[element_type].dimension] = np.array(ELEMENTS[element_type].vertices) / 2
    points = unit + rng.normal(size=(n, *unit.shape)) * rng.uniform(0, 0.6, (n, 1, 1))
    points = 3 * points.reshape(-1, 3) + np.array([-80.0, 120.0, 300.0])
    return Mesh(points, element_type, connectivity=np.arange(len(points)).reshape(n, -1))


def centre_of_hexes(mesh):
    """Determinant of the unit principal axes: VTK takes it into the minimum of a hex."""
    x = mesh.points[mesh.cells]
    pairs = [([1, 2, 5, 6], [0, 3, 4, 7]), ([2, 3, 6, 7], [0, 1, 4, 5]), ([4, 5, 6, 7], [0, 1, 2, 3])]
    axes = np.stack([x[:, high].sum(axis=1) - x[:, low].sum(axis=1) for high, low in pairs], axis=1)
    return np.linalg.det(axes / np.linalg.norm(axes, axis=2, keepdims=True))


def vtk_scaled_jacobian(mesh):
    pytest.importorskip("pyvista")
    return mesh.to_pyvista().cell_quality("scaled_jacobian").cell_data["scaled_jacobian"]


@pytest.mark.parametrize("element_type", ["quad4", "hex8"])
def test_agrees_with_vtk_on_distorted_and_inverted_elements(element_type, device, device64):
    """1e-5 in float32, 1e-12 in float64."""
    mesh = distorted(element_type)
    theirs = vtk_scaled_jacobian(mesh)
    assert 100 < (theirs < 0).sum() < 2900
    for computer, tolerance in ((device, 1e-5), (device64, 1e-12)):
        ours = scaled_jacobian(mesh, computer).astype(np.float64)
        if element_type == "hex8":
            centre = centre_of_hexes(mesh)
            assert (ours[centre < ours - tolerance] <= 0).all()  # where VTK's centre is worse, a corner is inverted
            ours = np.minimum(ours, centre)
        np.testing.assert_allclose(ours, theirs, atol=tolerance, rtol=0)


def smooth_mesh(element_type, counts=(19, 12, 7)):
    element = ELEMENTS[element_type]
    counts = counts[: element.dimension]
    axes = [np.linspace(0, 1, n) for n in counts]
    grid = np.meshgrid(*axes, indexing="ij")
    u, v = (g.ravel(order="F") for g in grid[:2])
    w = grid[2].ravel(order="F") if element.dimension == 3 else 0 * u
    points = np.stack([40 * u + 9 * np.sin(3 * v), 60 * v + 9 * np.cos(4 * u) * w, 30 * w + 8 * u * v], axis=1)
    return Mesh(points, element_type, structure=counts)


def distorted_grid(counts):
    """Nodes a millimetre apart, each moved by up to a fourth of that."""
    grid = np.stack(np.meshgrid(*map(np.arange, counts), indexing="ij"), axis=-1).reshape(-1, 3, order="F")
    return Mesh(grid + np.random.default_rng(4).uniform(-0.25, 0.25, grid.shape), "hex8", structure=counts)


@pytest.mark.parametrize("element_type", ["quad4", "hex8"])
def test_structured_and_explicit_kernels_agree(element_type, device64):
    mesh = smooth_mesh(element_type)
    explicit = Mesh(mesh.points, element_type, connectivity=mesh.cells)
    np.testing.assert_allclose(scaled_jacobian(mesh, device64), scaled_jacobian(explicit, device64), atol=1e-14)
    np.testing.assert_allclose(scaled_jacobian(mesh, device64), vtk_scaled_jacobian(mesh), atol=1e-12)


@pytest.mark.parametrize("n_u", [2, 3, 8, 9, 16, 17, 18, 33, 50])  # rows of less than a vector, a vector, and more
def test_rows_of_hexes_have_the_same_bits_on_both_backends(n_u, both_devices):
    if not all(device.cores for device in both_devices):
        pytest.skip("a GPU fuses products and sums")
    mesh = distorted_grid((n_u, 5, 4))
    explicit = Mesh(mesh.points, "hex8", connectivity=mesh.cells)
    found = [scaled_jacobian(one, device) for device in both_devices for one in (mesh, explicit)]
    assert found[0].min() < 0.6 < found[0].max()
    assert all(np.array_equal(values, found[0]) for values in found[1:])


@pytest.mark.parametrize("element_type", ["quad4", "hex8"])
def test_the_element_is_as_good_as_its_worst_corner(element_type, device64):
    mesh = distorted(element_type, 500)
    corners = corner_scaled_jacobian(mesh, device64)
    assert corners.shape == (500, mesh.element.n_corners)
    np.testing.assert_allclose(corners.min(axis=1), scaled_jacobian(mesh, device64), atol=1e-14)


def test_corners_of_a_hex_are_determinants_of_unit_edges(device64):
    mesh = distorted("hex8", 200)
    x = mesh.points[mesh.cells]
    for corner, neighbours in enumerate(HEX_NEIGHBOURS):
        edges = x[:, neighbours] - x[:, [corner]]
        expected = np.linalg.det(edges / np.linalg.norm(edges, axis=2, keepdims=True))
        np.testing.assert_allclose(corner_scaled_jacobian(mesh, device64)[:, corner], expected, atol=1e-12)


@pytest.mark.parametrize("element_type", ["quad4", "hex8"])
def test_an_element_is_judged_alike_however_many_there_are(element_type, any_device):
    """Less than a vector of lanes, whole vectors, and a rest."""
    mesh = distorted(element_type, 67)
    planes = [any_device.put(plane) for plane in mesh.planes]

    def judged(count):
        values = any_device.put(np.full(count + 3, -9.0))
        cells = any_device.put(mesh.cells[:count])
        args = (planes, mesh.n_nodes, cells, count, values, any_device)
        launch_explicit(f"{element_type[:-1]}_scaled_jacobian", *args)
        return any_device.get(values)

    whole = judged(67)
    assert len(np.unique(whole[:67])) == 67
    for count in (1, 7, 8, 9, 31, 32, 33, 66):
        np.testing.assert_array_equal(judged(count), [*whole[:count], -9, -9, -9])


@pytest.mark.parametrize("element_type", ["quad4", "hex8"])
def test_rotation_translation_and_scale_change_nothing(element_type, device64):
    mesh = distorted(element_type, 300)
    rotation, _ = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))
    rotation *= np.sign(np.linalg.det(rotation))
    moved = Mesh(mesh.points @ rotation * 0.037 + 500, element_type, connectivity=mesh.cells)
    np.testing.assert_allclose(scaled_jacobian(moved, device64), scaled_jacobian(mesh, device64), atol=1e-10)


def test_a_mirror_turns_the_sign_of_a_parallelepiped(device64):
    sheared = np.array([[1.0, 0, 0], [0.4, 1, 0], [0.2, -0.3, 2]])
    points = np.array(ELEMENTS["hex8"].vertices) / 2 @ sheared
    expected = np.prod(1 / np.linalg.norm(sheared, axis=1)) * 2
    for sign in (1, -1):
        mesh = Mesh(points * [sign, 1, 1], "hex8", connectivity=np.arange(8)[None])
        assert scaled_jacobian(mesh, device64)[0] == pytest.approx(sign * expected, abs=1e-14)


@pytest.mark.parametrize("element_type", ["quad8", "quad9", "hex20", "hex27"])
def test_order_two_counts_its_corners(element_type, device64):
    dimension = ELEMENTS[element_type].dimension
    straight = {2: "quad4", 3: "hex8"}[dimension]
    mesh = distorted(element_type, 100)
    corners = Mesh(mesh.points, straight, connectivity=mesh.cells[:, : 2**dimension])
    np.testing.assert_array_equal(scaled_jacobian(mesh, device64), scaled_jacobian(corners, device64))
    assert corner_scaled_jacobian(mesh, device64).shape == (100, 2**dimension)


@pytest.mark.parametrize("element_type", ["quad8", "quad9", "hex20", "hex27"])
def test_structured_order_two_picks_its_corner_lattice(element_type, device64):
    counts = (4, 3, 5)[: ELEMENTS[element_type].dimension]
    points = np.random.default_rng(3).random((structure.count_nodes(ELEMENTS[element_type], counts), 3))
    mesh = Mesh(points, element_type, structure=counts)
    explicit = Mesh(points, element_type, connectivity=mesh.cells)
    np.testing.assert_allclose(scaled_jacobian(mesh, device64), scaled_jacobian(explicit, device64), atol=1e-13)


@pytest.mark.parametrize("element_type", ["quad4", "hex8"])
@pytest.mark.parametrize("gone", [[0, 1], [0, 1, 2, 3]])
def test_collapsed_elements_count_zero_not_nan(element_type, gone, device):
    vertices = np.array(ELEMENTS[element_type].vertices, dtype=float)
    points = np.zeros((len(vertices), 3))
    points[:, : vertices.shape[1]] = vertices / 2
    points[gone] = points[gone[0]]
    mesh = Mesh(points, element_type, connectivity=np.arange(len(points))[None])
    assert scaled_jacobian(mesh, device).tolist() == [0.0]
    assert np.isfinite(corner_scaled_jacobian(mesh, device)).all()


def test_summary_counts_every_element_once(device):
    mesh = distorted("hex8", 2000)
    measured, quality = assess(mesh, device)
    values = measured.cell_fields["scaled_jacobian"].astype(float)
    summary = quality.to_dict()
    assert sum(summary["histogram"]["counts"]) + summary["inverted"] == 2000
    assert summary["histogram"]["edges"] == pytest.approx(np.linspace(0, 1, 11))
    theirs, _ = np.histogram(values[values > 0], bins=10, range=(0, 1))
    assert summary["histogram"]["counts"] == theirs.tolist()
    assert sum(summary["histogram"]["counts"][5:]) == pytest.approx(summary["fraction_above_0.5"] * 2000)
    assert summary["fraction_below_0.1"] == pytest.approx(np.mean(values < 0.1))
    assert summary["fraction_below_0.2"] == pytest.approx(np.mean(values < 0.2))
    assert summary["mean"] == pytest.approx(values.mean())
    assert summary["min"] == summary["worst"][0]["scaled_jacobian"] == values.min()


def test_the_worst_elements_are_found_where_they_are():
    mesh = smooth_mesh("hex8")
    values = np.ones(mesh.n_elements)
    values[[7, 100]] = -0.5, 0.2
    quality = summarise(mesh, values, worst=2)
    assert quality.worst.tolist() == [7, 100]
    centre = mesh.to_pyvista().cell_centers().points[[7, 100]]
    np.testing.assert_allclose(quality.worst_centroids_mm, centre, atol=1e-9)


def test_values_on_and_over_the_edges_are_kept():
    mesh = smooth_mesh("quad4", (2, 8))
    values = np.array([-1.0, 0.0, 1e-45, 0.1, 0.5, 1.0, 1.0000001])
    quality = summarise(mesh, values)
    assert quality.inverted == 2
    assert quality.counts.tolist() == [2, 0, 0, 0, 1, 0, 0, 0, 0, 2]


@pytest.mark.parametrize("real", [np.float32, np.float64])
def test_the_summary_is_what_sorting_gives(real):
    mesh = smooth_mesh("quad4", (102, 102))
    edges, rng = np.arange(11) / 10, np.random.default_rng(8)
    ties = np.concatenate([edges, np.nextafter(edges, -2), np.nextafter(edges, 2)])
    values = rng.permutation(np.resize(np.concatenate([rng.uniform(-1, 1, 9000), ties]), mesh.n_elements)).astype(real)
    quality, exact = summarise(mesh, values), values.astype(np.float64)
    assert quality.worst.tolist() == np.argsort(exact, kind="stable")[:10].tolist()
    found = quality.fraction_below_0_1, quality.fraction_below_0_2, quality.fraction_above_0_5, quality.mean
    expected = np.mean(exact < 0.1), np.mean(exact < 0.2), np.mean(exact > 0.5), exact.mean()
    assert found == pytest.approx(expected, rel=1e-12)
    bins = np.searchsorted(edges[1:-1], exact[exact > 0], side="left")
    assert quality.counts.tolist() == np.bincount(bins, minlength=10).tolist()


def test_summary_of_other_elements_is_refused():
    with pytest.raises(InputError, match="198 elements"):
        summarise(smooth_mesh("quad4"), np.zeros(5))


@pytest.mark.parametrize("element_type", ["quad4", "hex8"])
def test_an_element_with_a_node_that_is_nowhere_is_not_judged_by_the_others(element_type, any_device):
    """NaN and infinity, in each coordinate: the kernels give NaN, and a summary counts that as inverted."""
    mesh = smooth_mesh(element_type, (60, 7, 6))
    whole = scaled_jacobian(mesh, any_device)
    planes = mesh.planes.copy()
    wild = np.random.default_rng(5).choice(mesh.n_nodes, mesh.n_nodes // 20, replace=False)
    planes[np.arange(len(wild)) % 3, wild] = np.resize([np.nan, np.inf, np.nan, -np.inf], len(wild))
    bad = np.isin(mesh.cells, wild).any(axis=1)
    points, values = [any_device.put(plane) for plane in planes], any_device.empty(mesh.n_elements)
    kind, judged = element_type[:-1], []
    gpu = copy(any_device)
    gpu.cores = 0
    for device in (any_device, gpu):
        launch_structured(kind, points, mesh.structure, values, device)
        judged.append(np.array(device.get(values)))
    cells = any_device.put(mesh.cells)
    launch_explicit(f"{kind}_scaled_jacobian", points, mesh.n_nodes, cells, mesh.n_elements, values, any_device)
    for found in (*judged, np.array(any_device.get(values))):
        np.testing.assert_array_equal(np.isnan(found), bad)
        np.testing.assert_allclose(found[~bad], whole[~bad], atol=1e-5)
        summary = summarise(mesh, found)
        assert summary.inverted == bad.sum() > 10 and summary.min == -1 and np.isfinite(summary.mean)


@pytest.mark.parametrize("judge", [assess, corner_scaled_jacobian, certify, optimize])
def test_a_mesh_with_a_node_that_is_nowhere_is_refused(judge, device):
    mesh = smooth_mesh("hex8")
    points = mesh.points.copy()
    points[5, 1], points[7, 2], points[9, 2] = np.nan, np.inf, -np.inf
    with pytest.raises(InputError, match=f"finite coordinates, got NaN or infinity at 3 of {mesh.n_nodes} nodes"):
        judge(Mesh(points, "hex8", structure=mesh.structure), device)


@pytest.mark.parametrize("nodes", [(2, 2, 2), (33, 3, 2), (40, 6, 71), (34, 9, 130)])  # one cell, odd and even pairs
def test_columns_of_a_gpu_are_what_rows_of_a_cpu_are(nodes, any_device):
    """And an edge of no length counts 0 or less."""
    rng = np.random.default_rng(3)
    k, j, i = np.indices(nodes[::-1]).reshape(3, -1)
    points = np.stack([i, j, k], axis=-1) + rng.uniform(-0.4, 0.4, (len(i), 3))
    points[1] = points[0]
    mesh = Mesh(points.astype(any_device.real), "hex8", structure=nodes)
    gpu, cpu = copy(any_device), copy(any_device)
    gpu.cores, cpu.cores = 0, 1
    columns, rows = scaled_jacobian(mesh, gpu), scaled_jacobian(mesh, cpu)
    assert np.abs(columns - rows).max() < 5 * np.finfo(any_device.real).eps
    assert columns[0] <= 0 and (rows > 0.1).any() | (rows.size == 1)
