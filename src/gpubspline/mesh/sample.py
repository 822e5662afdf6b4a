"""From a hyperpatch to a mesh: nodes are the patch at evenly spaced parameters."""

import os
from dataclasses import replace
from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.device import Device, check_device, open_device
from gpubspline.errors import InputError, expect
from gpubspline.mesh import measure, structure
from gpubspline.mesh.elements import Element, find_element
from gpubspline.mesh.mesh import Mesh
from gpubspline.spline.hyperpatch import Hyperpatch

MOST_SAMPLES = 2**31 - 1
"""Nodes and elements have int32 numbers."""

SAMPLE_BYTES = 80
"""Memory that a mesh takes per sample, about, with its fields and elements and what passes by (measured)."""

BY_ORDER = {(2, 1): "quad4", (2, 2): "quad8", (3, 1): "hex8", (3, 2): "hex20"}


def sample(
    patch: Hyperpatch,
    nodes: tuple[int, ...],
    *,
    order: int = 1,
    element_type: str | None = None,
    device: Device | None = None,
) -> Mesh:
    """Sample a hyperpatch to a structured mesh; nodes midway along an edge lie on the patch, not on the chord.

    Arguments
    ---------
    patch: surface or solid; its channels become nodal fields.
    nodes: samples per parameter, which are the corner nodes: (140, 140) gives 139 x 139 elements.
    order: 1 for quad4 or hex8, 2 for quad8 or hex20.
    element_type: one of ``elements.MESHABLE`` instead, such as ``"quad9"`` or ``"hex27"``.
    device: where to evaluate; ``open_device()`` unless told.

    Returns
    -------
    Mesh with the precision of the device. A left-handed patch is mirrored here, once: the mesh's u then runs against
    the patch's, and its side u0 is the patch's u = 1. Hexes get a positive volume; a surface runs counter-clockwise
    seen from the positive end of the patient axis nearest to its normal.

    Raises
    ------
    InputError where the counts or the element type do not fit the patch, or the mesh does not fit the memory.
    """
    expect(patch, Hyperpatch, "the patch of what fit gives is one")
    check_device(device)
    element = _choose_element(patch, order, element_type)
    check_nodes(patch, nodes)
    counts = structure.lattice_counts(element, nodes)
    check_size(prod(counts))
    parameters = [np.linspace(0.0, 1.0, n) for n in counts]
    lattice = patch.evaluate_grid(parameters, device or open_device())
    if is_left_handed(lattice[np.ix_(*coarse(counts, patch.shape))]):
        lattice = lattice[::-1]
    mesh = from_lattice(lattice, patch.channels, element, nodes)
    return replace(mesh, node_sets=_node_sets(mesh), element_sets={"body": np.arange(mesh.n_elements, dtype=np.int32)})


def _choose_element(patch: Hyperpatch, order: int, element_type: str | None) -> Element:
    dimension = patch.parametric_dimension
    if element_type is None:
        if (dimension, order) not in BY_ORDER:
            raise InputError(f"expected elements of order 1 or 2, got {order}")
        return find_element(BY_ORDER[dimension, order])
    element = find_element(element_type)
    if element.dimension != dimension:
        kind = {2: "quads for a surface", 3: "hexes for a solid"}[dimension]
        raise InputError(f"expected {kind} patch, got {element_type}")
    if order not in (1, element.order):
        raise InputError(f"expected an element type of order {order}, got {element_type}")
    return element


def check_nodes(patch: Hyperpatch, nodes: tuple[int, ...]) -> None:
    """Raise InputError unless there are at least 2 nodes in each direction of the patch."""
    dimension = patch.parametric_dimension
    if len(nodes) != dimension:
        kind, wanted = {2: ("surface", "U,V"), 3: ("solid", "U,V,W")}[dimension]
        raise InputError(f"expected nodes {wanted} for a {kind} patch, got {len(nodes)} numbers: {nodes}")
    if min(nodes) < 2:
        raise InputError(f"expected at least 2 nodes in every direction, got {nodes}")


def check_size(samples: int) -> None:
    """Raise InputError where samples have no int32 numbers or do not fit the memory."""
    if samples > MOST_SAMPLES:
        raise InputError(f"expected at most {MOST_SAMPLES:,} samples, which have int32 numbers, got {samples:,}")
    memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") if hasattr(os, "sysconf") else None
    if memory is not None and samples * SAMPLE_BYTES > memory:
        raise InputError(
            f"expected a mesh that fits the memory of {memory / 1e9:.0f} GB, got {samples:,} samples, which take about "
            f"{samples * SAMPLE_BYTES / 1e9:.0f} GB: ask for fewer nodes, or for a .vts file, written in slabs"
        )


def from_lattice(lattice: NDArray[Any], channels: tuple[str, ...], element: Element, nodes: tuple[int, ...]) -> Mesh:
    """Give the mesh of a lattice (n_u, n_v[, n_w], 3 + C) of samples, without sets."""
    flat = np.reshape(lattice, (-1, lattice.shape[-1]), order="F")
    kept = structure.has_node(element, nodes)
    if kept is not None:
        flat = np.asfortranarray(flat[kept])
    fields = {name: np.ascontiguousarray(flat[:, 3 + c]) for c, name in enumerate(channels)}
    return Mesh(flat[:, :3], element.name, structure=tuple(nodes), fields=fields)


def coarse(counts: tuple[int, ...], control: tuple[int, ...]) -> list[NDArray[np.intp]]:
    """Which samples of each direction, with its ends, say what is left-handed: as many as there are control points."""
    few = [min(n, c) for n, c in zip(counts, control, strict=True)]
    return [np.linspace(0, n - 1, m).round().astype(np.intp) for n, m in zip(counts, few, strict=True)]


def is_left_handed(lattice: NDArray[Any]) -> bool:
    """Whether the hexes between samples (n_u, n_v, n_w, 3 + C) have a negative volume.

    Of a surface (n_u, n_v, 3 + C): whether its quads run clockwise seen from the patient axis nearest their normal.
    """
    nodes = lattice.shape[:-1]
    mesh = from_lattice(lattice[..., :3], (), find_element(BY_ORDER[len(nodes), 1]), nodes)
    if mesh.element.dimension == 3:
        return mesh.volume_mm3 < 0
    _, vector = measure.area_vector_mm2(mesh.planes, mesh.cells, mesh.element_type)
    return bool(vector[np.argmax(np.abs(vector))] < 0)


def _node_sets(mesh: Mesh) -> dict[str, NDArray[Any]]:
    return {**{side: mesh.boundary_nodes(side) for side in mesh.element.sides}, "surface": mesh.boundary_nodes()}
