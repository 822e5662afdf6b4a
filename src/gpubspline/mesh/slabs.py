"""A structured mesh a few layers at a time, for meshes that no memory should hold whole."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from gpubspline.device import Device
from gpubspline.errors import InputError
from gpubspline.mesh.elements import find_element
from gpubspline.mesh.mesh import Mesh
from gpubspline.mesh.sample import check_nodes, check_size, coarse, from_lattice, is_left_handed
from gpubspline.spline.hyperpatch import Hyperpatch

SLAB_NODES = 4_000_000
"""Nodes of a slab, about: some hundred megabytes with all fields."""


@dataclass(frozen=True, eq=False)
class Slab:
    """Layers of a structured hex8 mesh along w; neighbours share a layer.

    Attributes
    ----------
    mesh: the layers as a mesh of their own, without sets.
    first: number of its first layer in the whole.
    n_layers: layers of the whole.
    """

    mesh: Mesh
    first: int
    n_layers: int

    @property
    def last(self) -> int:
        """Number of its last layer in the whole."""
        assert self.mesh.structure is not None
        return self.first + self.mesh.structure[2] - 1

    @property
    def sides(self) -> list[str]:
        """Sides of the slab that are the surface of the whole."""
        ends = ["w0"] * (self.first == 0) + ["w1"] * (self.last == self.n_layers - 1)
        return ["u0", "u1", "v0", "v1", *ends]

    @property
    def own_nodes(self) -> slice:
        """Its nodes without those of the layer that the slab before it has."""
        assert self.mesh.structure is not None
        n_u, n_v, _ = self.mesh.structure
        return slice(0 if self.first == 0 else n_u * n_v, None)


def sample_slabs(
    patch: Hyperpatch, nodes: tuple[int, ...], *, device: Device, slab_nodes: int = SLAB_NODES
) -> Iterator[Slab]:
    """Sample a solid to hex8 slab by slab; the nodes are those that ``sample`` gives, mirrored alike.

    Raises InputError where the counts do not fit the patch or two layers the memory, or it is no solid.
    """
    if patch.parametric_dimension != 3:
        raise InputError("expected a solid patch to be sampled in slabs, got a surface")
    check_nodes(patch, nodes)
    check_size(2 * nodes[0] * nodes[1])  # the thinnest slab
    element = find_element("hex8")
    u, v, w = axes = [np.linspace(0.0, 1.0, n) for n in nodes]
    few = [axis[some] for axis, some in zip(axes, coarse(nodes, patch.shape), strict=True)]
    if is_left_handed(patch.evaluate_grid(few, device)):
        u = u[::-1]
    step = max(slab_nodes // (nodes[0] * nodes[1]), 1)
    for first in range(0, nodes[2] - 1, step):
        last = min(first + step, nodes[2] - 1)
        lattice = patch.evaluate_grid([u, v, w[first : last + 1]], device)
        counts = (nodes[0], nodes[1], last + 1 - first)
        yield Slab(from_lattice(lattice, patch.channels, element, counts), first, nodes[2])
