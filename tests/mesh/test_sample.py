"""Sampling a hyperpatch: nodes on it, counts of the paper, sets on their sides, no mesh born inverted."""

import os

import numpy as np
import pytest

from gpubspline.errors import InputError
from gpubspline.mesh.elements import ELEMENTS, MESHABLE
from gpubspline.mesh.quality import scaled_jacobian
from gpubspline.mesh.sample import sample
from gpubspline.spline.hyperpatch import bezier, hyperpatch

PAPER = [
    ((140, 140), 19_321),
    ((40, 70), 2_691),
    ((11, 18, 34), 5_610),
    ((14, 24, 46), 13_455),
    ((20, 80, 28), 40_527),
    ((10, 10, 30), 2_349),
    ((14, 26, 46), 14_625),
    ((20, 20, 50), 17_689),
]


def box_patch(dimension=3, mirrored=False, bend=0.0):
    """A box of 20 x 30 x 40 mm with HU = 100 + x, bent along v by its control points."""
    counts = (4, 5, 3)[:dimension]
    grid = np.stack(np.meshgrid(*[np.linspace(0, 1, n) for n in counts], indexing="ij"), axis=-1)
    control = np.zeros((*counts, 4))
    control[..., :dimension] = grid * np.array([20.0, 30, 40])[:dimension]
    if mirrored:
        control = control[::-1]
    control[..., 0] += bend * (control[..., 1] / 30) ** 2
    control[..., 3] = 100 + control[..., 0]
    return bezier(control)


@pytest.mark.parametrize(("nodes", "elements"), PAPER)
def test_the_papers_counts(nodes, elements, device):
    mesh = sample(box_patch(len(nodes)), nodes, device=device)
    assert mesh.n_elements == elements
    assert mesh.n_nodes == np.prod(nodes)
    assert mesh.points.dtype == device.real


@pytest.mark.parametrize("turn", [1, -1])
def test_a_ring_of_few_control_points_is_mirrored_by_its_volume(turn, device):
    """Both ends of it are one section, and a few samples say which side is out."""
    angle, radius, height = np.meshgrid(turn * 2 * np.pi * np.arange(5) / 4, [10, 20], [0, 5], indexing="ij")
    control = np.stack([radius * np.cos(angle), radius * np.sin(angle), height, 0 * angle], axis=-1)
    mesh = sample(hyperpatch(control, (4, 1, 1)), (40, 3, 3), device=device)
    assert mesh.volume_mm3 > 0


@pytest.mark.parametrize(
    ("nodes", "order", "message"),
    [
        ((1300, 1300, 1300), 1, "int32 numbers, got 2,197,000,000"),
        ((1000, 1000, 1000), 2, "int32 numbers, got 7,988,005,999"),
        ((10**7, 10**7, 10**7), 1, "int32 numbers"),
        ((40, 50, 60), 1, "memory of 0 GB, got 120,000 samples"),
    ],
)
def test_a_mesh_too_large_is_refused_before_any_work(nodes, order, message, device, monkeypatch):
    monkeypatch.setattr(os, "sysconf", lambda name: 2**10)  # a machine of one megabyte
    with pytest.raises(InputError, match=message):
        sample(box_patch(), nodes, order=order, device=device)


@pytest.mark.parametrize("element_type", MESHABLE)
def test_every_node_lies_on_the_patch_at_its_parameters(element_type, device64):
    element = ELEMENTS[element_type]
    patch = box_patch(element.dimension, bend=7.0)
    nodes = (4, 3, 5)[: element.dimension]
    mesh = sample(patch, nodes, element_type=element_type, device=device64)
    elements = np.arange(mesh.n_elements)
    first = np.stack(np.unravel_index(elements, [n - 1 for n in nodes], order="F"), axis=1)
    parameters = (first[:, None, :] + np.array(element.vertices) / 2) / (np.array(nodes) - 1)
    expected = patch.evaluate_points(parameters.reshape(-1, element.dimension), device64)
    np.testing.assert_allclose(mesh.points[mesh.cells].reshape(-1, 3), expected[:, :3], atol=1e-11)
    np.testing.assert_allclose(mesh.fields["HU"][mesh.cells].ravel(), expected[:, 3], atol=1e-11)


def test_midway_nodes_are_on_the_curve_not_on_the_chord(device64):
    mesh = sample(box_patch(bend=10.0), (3, 3, 3), order=2, device=device64)
    assert mesh.element_type == "hex20"
    ends, middles = mesh.points[mesh.cells[:, [0, 3]]], mesh.points[mesh.cells[:, 11]]
    assert np.abs(middles - ends.mean(axis=1)).max() > 0.3
    on_curve = middles[:, 0] - 10 * ((middles[:, 1] / 30) ** 2 * 0.75 + middles[:, 1] / 30 * 0.25)
    np.testing.assert_allclose(on_curve % 10, 0, atol=1e-9)  # Bernstein of degree 4 of control values (i/4)^2


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("order", [1, 2])
def test_left_handed_patches_are_mirrored_once(dimension, order, device64):
    nodes = (4, 3, 5)[:dimension]
    right = sample(box_patch(dimension, bend=3), nodes, order=order, device=device64)
    left = sample(box_patch(dimension, mirrored=True, bend=3), nodes, order=order, device=device64)
    np.testing.assert_allclose(left.points, right.points, atol=1e-12)
    np.testing.assert_allclose(left.fields["HU"], right.fields["HU"], atol=1e-11)
    assert scaled_jacobian(left, device64).min() > 0.5
    if dimension == 3:
        assert left.volume_mm3 == pytest.approx(20 * 30 * 40, rel=1e-3)


def test_a_surface_runs_counter_clockwise_seen_from_the_positive_end(device64):
    for turn in ([0, 1, 2], [1, 2, 0], [2, 0, 1], [1, 0, 2], [0, 2, 1], [2, 1, 0]):
        patch = box_patch(2)
        control = patch.control[..., [*turn, 3]]
        mesh = sample(bezier(control), (3, 3), device=device64)
        a, b, c, d = np.moveaxis(mesh.points[mesh.cells], 1, 0)
        normal = np.cross(c - a, d - b).sum(axis=0)
        assert normal[np.argmax(np.abs(normal))] > 0


@pytest.mark.parametrize("element_type", MESHABLE)
def test_sets_are_the_sides_and_the_body(element_type, device64):
    dimension = ELEMENTS[element_type].dimension
    size = np.array([20.0, 30, 40])
    mesh = sample(box_patch(dimension), (4, 3, 5)[:dimension], element_type=element_type, device=device64)
    on_any = np.zeros(mesh.n_nodes, dtype=bool)
    assert set(mesh.node_sets) == {f"{axis}{end}" for axis in "uvw"[:dimension] for end in "01"} | {"surface"}
    for axis in range(dimension):
        for end in (0, 1):
            on_side = np.abs(mesh.points[:, axis] - end * size[axis]) < 1e-9
            np.testing.assert_array_equal(mesh.node_sets[f"{'uvw'[axis]}{end}"], np.flatnonzero(on_side))
            on_any |= on_side
    np.testing.assert_array_equal(mesh.node_sets["surface"], np.flatnonzero(on_any))
    np.testing.assert_array_equal(mesh.element_sets["body"], np.arange(mesh.n_elements))


def test_several_channels_become_fields(device64):
    control = np.random.default_rng(0).random((4, 4, 4, 5))
    patch = hyperpatch(control, (3, 3, 3), channels=("HU", "fabric"))
    mesh = sample(patch, (3, 4, 5), element_type="hex27", device=device64)
    assert list(mesh.fields) == ["HU", "fabric"]
    assert all(values.flags.c_contiguous and values.shape == (mesh.n_nodes,) for values in mesh.fields.values())
    assert mesh.planes.flags.c_contiguous


def test_what_does_not_fit_the_patch_is_refused(device64):
    solid, surface = box_patch(3), box_patch(2)
    for patch, nodes, options, message in [
        (surface, (3, 3, 3), {}, r"U,V for a surface patch, got 3 numbers"),
        (solid, (3, 3), {}, r"U,V,W for a solid patch, got 2 numbers"),
        (solid, (3, 1, 3), {}, "at least 2 nodes"),
        (solid, (3, 3, 3), {"order": 3}, "order 1 or 2, got 3"),
        (solid, (3, 3, 3), {"element_type": "quad4"}, "hexes for a solid patch, got quad4"),
        (surface, (3, 3), {"element_type": "hex8"}, "quads for a surface patch, got hex8"),
        (solid, (3, 3, 3), {"element_type": "tet4"}, "expected an element type"),
        (solid, (3, 3, 3), {"element_type": "hex8", "order": 2}, "of order 2, got hex8"),
    ]:
        with pytest.raises(InputError, match=message):
            sample(patch, nodes, device=device64, **options)
