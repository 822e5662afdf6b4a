"""Element sets by labels: against a count of voxels in each element, and names."""

import numpy as np

from gpubspline.ct.labels import Labels, Segment
from gpubspline.ct.volume import Volume
from gpubspline.device import Device
from gpubspline.mesh.label_sets import with_label_sets
from gpubspline.mesh.mesh import Mesh


def grid(n: int, size_mm: float) -> Mesh:
    t = np.linspace(0, size_mm, n + 1)
    points = np.stack([a.ravel(order="F") for a in np.meshgrid(t, t, t, indexing="ij")], axis=1)
    return Mesh(points, "hex8", structure=(n + 1,) * 3, element_sets={"body": np.arange(n**3, dtype=np.int32)})


def labelled(values: np.ndarray, names: dict[int, str]) -> Labels:
    return Labels("made", names, lambda number: Segment(values == number))


def test_each_element_goes_to_the_label_of_most_of_its_voxels(device: Device) -> None:
    """Elements of 4 x 4 x 4 voxels, filled with labels at random: the count of voxels decides."""
    affine = np.eye(4)
    affine[:3, :3] *= 0.5
    affine[:3, 3] = 0.25
    rng = np.random.default_rng(3)
    coarse = rng.choice([0, 5, 7, 9], (5, 5, 5), p=[0.1, 0.3, 0.3, 0.3])
    values = np.where(rng.random((20, 20, 20)) < 0.7, coarse.repeat(4, 0).repeat(4, 1).repeat(4, 2), 7)
    values[:4, :4, :4] = 0
    volume = Volume(np.zeros(values.shape, np.int16), affine)
    mesh = with_label_sets(grid(5, 10.0), labelled(values, {5: "Cortex", 7: "", 9: "body"}), volume, device)
    counts = np.stack([(values == n).reshape(5, 4, 5, 4, 5, 4).sum(axis=(1, 3, 5)).ravel() for n in (5, 7, 9)], axis=1)
    expected = np.where(counts.max(axis=1) > 0, np.array([5, 7, 9])[counts.argmax(axis=1)], 0)
    np.testing.assert_array_equal(mesh.cell_fields["label"], expected)
    assert list(mesh.element_sets) == ["body", "Cortex", "label_7", "body_9", "unlabelled"]
    for name, number in (("Cortex", 5), ("label_7", 7), ("body_9", 9), ("unlabelled", 0)):
        np.testing.assert_array_equal(mesh.element_sets[name], np.flatnonzero(expected == number))
    assert len(mesh.element_sets["body"]) == 125 and mesh.element_sets["unlabelled"].tolist() == [0]


def test_the_part_outside_the_labels_does_not_count(device: Device) -> None:
    """A seventh of an element in one label, the rest in none: the label has it. Outside the scan there is none."""
    values = np.zeros((10, 10, 10), np.uint8)
    values[:, :, :2] = 3
    volume = Volume(np.zeros(values.shape, np.int16), np.eye(4))
    mesh = with_label_sets(grid(2, 20.0), labelled(values, {3: "edge"}), volume, device)
    assert mesh.element_sets["edge"].tolist() == [0]
    assert len(mesh.element_sets["unlabelled"]) == 7
