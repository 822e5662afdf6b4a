"""Element sets by the labels of a segmentation: each element goes to the label that holds most of its volume."""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from gpubspline.ct.labels import Labels
from gpubspline.ct.volume import Volume
from gpubspline.device import Device
from gpubspline.mesh.mesh import Mesh
from gpubspline.mesh.quadrature import nodes_of, quadrature

POINTS = 4
"""Per direction, at which an element's volume is divided among labels."""

UNLABELLED = "unlabelled"
"""Set of the elements that no label touches."""


def with_label_sets(mesh: Mesh, labels: Labels, volume: Volume, device: Device) -> Mesh:
    """Give a mesh an element set for each label, by the label's name or, where it has none, ``label_`` and its number.

    A voxel of several labels counts for the first of them. Elements are not cut: where labels meet inside one, it goes
    to the greater part.

    Arguments
    ---------
    labels: on the grid of ``volume``.
    device: where the places of the quadrature points are found.

    Returns
    -------
    The mesh with the sets, ``"unlabelled"`` among them where elements are touched by no label, and the element field
    ``label``, (m,) int32: the label's number, 0 for none.
    """
    numbers = list(labels.names)
    winner = _winners(mesh, label_map(labels, numbers, volume), len(numbers), volume, device)
    sets = dict(mesh.element_sets)
    for index, number in enumerate(numbers, start=1):
        sets[set_name(labels, number, sets)] = np.flatnonzero(winner == index).astype(np.int32)
    if np.any(winner == 0):
        sets[UNLABELLED] = np.flatnonzero(winner == 0).astype(np.int32)
    values = np.array([0, *numbers], dtype=np.int32)[winner]
    return replace(mesh, element_sets=sets).with_cell_fields({"label": values})


def set_name(labels: Labels, number: int, taken: dict[str, Any]) -> str:
    """Name of the set of a label that none of ``taken`` has."""
    name = labels.names[number] or f"label_{number}"
    return name if name not in taken else f"{name}_{number}"


def set_of_label(mesh: Mesh, number: int) -> str:
    """Name of the element set of the elements that have a label, which some must."""
    members = np.flatnonzero(mesh.cell_fields["label"] == number)
    return next(name for name, own in mesh.element_sets.items() if np.array_equal(np.sort(own), members))


def label_map(labels: Labels, numbers: list[int], volume: Volume) -> NDArray[np.int16]:
    """Position (n_k, n_j, n_i) of each voxel's label in ``numbers``, from 1; 0 for none."""
    found = np.zeros(volume.hu.shape, dtype=np.int16)
    for index, number in enumerate(numbers, start=1):
        found[labels.read(number).inside & (found == 0)] = index
    return found


def labels_in(volume: Volume, labels: Labels, whole: Volume) -> NDArray[np.int16]:
    """Position (n_k, n_j, n_i) of each voxel's label in ``list(labels.names)``, from 1, in a window of the whole scan.

    ``volume``: the window; ``labels`` are on the grid of ``whole``.
    """
    first = np.rint(whole.to_indices(volume.affine[:3, 3][None])[0]).astype(int)
    window = tuple(slice(a, a + n) for a, n in zip(first[::-1], volume.hu.shape, strict=True))
    return label_map(labels, list(labels.names), whole)[window]


def labels_round(inside: NDArray[np.bool_], volume: Volume, labels: Labels, whole: Volume) -> NDArray[np.int32]:
    """Number (n_k, n_j, n_i) of each voxel's label, 0 for none; outside a body, where it has none, the nearest inside.

    ``inside``: the body's voxels; ``volume`` and the others as of ``labels_in``.
    """
    found = np.array([0, *labels.names], dtype=np.int32)[labels_in(volume, labels, whole)]
    nearest = distance_transform_edt(~inside, return_distances=False, return_indices=True)
    return np.asarray(np.where(inside | (found != 0), found, found[tuple(nearest)]))


def _winners(
    mesh: Mesh, labelled: NDArray[np.int16], n_labels: int, volume: Volume, device: Device
) -> NDArray[np.int64]:
    """Label (m,) of each element, from 1; 0 where none touches it."""
    rule = quadrature(mesh.element, POINTS, device)
    middle = mesh.planes.mean(axis=1, dtype=np.float64)
    points = device.put((mesh.planes - middle[:, None]).astype(device.real))
    size = next(rule.chunks(mesh.n_elements)).stop * rule.n_points
    x, y, z, part = (device.empty(size) for _ in range(4))
    winner = np.zeros(mesh.n_elements, dtype=np.int64)
    for elements in rule.chunks(mesh.n_elements):
        m = elements.stop - elements.start
        rule.places(points, mesh.n_nodes, nodes_of(mesh, elements, device), m, [x, y, z], part)
        count = m * rule.n_points
        places = np.stack([device.get(plane)[:count] for plane in (x, y, z)], axis=1) + middle
        at = np.rint(volume.to_indices(places)).astype(np.int64)
        held = np.all((at >= 0) & (at < np.array(volume.shape)), axis=1)
        label = np.where(held, labelled[tuple(np.where(held[:, None], at, 0).T[::-1])], 0)
        element = np.tile(np.arange(m), rule.n_points)
        weights = np.abs(device.get(part)[:count])
        shares = np.bincount(element * (n_labels + 1) + label, weights, m * (n_labels + 1)).reshape(m, -1)[:, 1:]
        winner[elements] = np.where(shares.max(axis=1) > 0, shares.argmax(axis=1) + 1, 0)
    return winner
