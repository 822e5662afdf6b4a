"""Clusters of a mesh's hex8: pieces of space that a CPU's caches hold, each with nodes of its own."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.device import Buffer, Device

SIZE = 1024
"""Elements of a cluster, a multiple of every vector's length: 9 numbers of each node are 100 kB in float64."""
LANES = 16
"""The longest vector's length, of which a table of elements is a multiple."""
_BITS = 10
_U_FASTEST = [0, 1, 3, 2, 4, 5, 7, 6]


@dataclass(frozen=True, eq=False)
class Clusters:
    """Elements of a mesh in clusters, on a device; see ``kernels/clusters.py``.

    Attributes
    ----------
    n_nodes, n_elements, n_copies, n_clusters: of the mesh, and of its nodes in the clusters.
    of: (copies,) the node that each copies; starts: (clusters + 1,) the first of each cluster.
    cells: (8, m) the copies at the vertices of each element, u fastest.
    places: (3, copies), mm.
    start, slots: (n + 1,) and (copies,) where the copies of each node are.
    moved, sums: (3, copies) what was last computed.
    """

    n_nodes: int
    n_elements: int
    n_copies: int
    n_clusters: int
    of: Buffer
    starts: Buffer
    cells: Buffer
    places: Buffer
    start: Buffer
    slots: Buffer
    moved: Buffer
    sums: Buffer

    def apply(
        self, device: Device, displacement: Buffer, lame: tuple[Buffer, Buffer], free: Buffer, out: Buffer
    ) -> None:
        """Write the nodal forces, N; see ``Stiffness.apply``."""
        where = (self.places, displacement, self.n_nodes, self.of, self.starts, self.n_copies, self.cells)
        how = (self.n_elements, *lame, SIZE, self.moved, self.sums)
        device.launch("clusters.cluster_forces", (self.n_clusters, SIZE), *where, *how)
        copies = (self.sums, self.n_copies, self.start, self.slots)
        device.launch("clusters.sum_copies", self.n_nodes, *copies, free, self.n_nodes, out)


def in_space(points: NDArray[Any], cells: NDArray[np.int32]) -> NDArray[np.intp]:
    """Numbers of elements along a curve that fills space, the last repeated up to a multiple of ``LANES``.

    Source: Morton 1966: the bits of the three coordinates in turn.
    """
    middle = points[cells].mean(axis=1, dtype=np.float64)
    steps = ((middle - middle.min(axis=0)) * ((2**_BITS - 1) / max(np.ptp(middle, axis=0).max(), 1e-30))).astype(int)
    key = np.zeros(len(cells), dtype=np.int64)
    for bit in range(_BITS):
        key |= (((steps >> bit) & 1) << (3 * bit + np.arange(3))).sum(axis=1)
    order = np.argsort(key, kind="stable")
    return np.pad(order, (0, -len(order) % LANES), mode="edge")


def clusters(points: NDArray[Any], cells: NDArray[np.int32], device: Device) -> Clusters:
    """Cut elements (m, 8) in the order of ``in_space`` into clusters; points are (3, n), mm."""
    n, cluster = points.shape[1], np.arange(len(cells), dtype=np.int64) // SIZE
    keys, table = np.unique(cluster[:, None] * n + cells[:, _U_FASTEST], return_inverse=True)
    starts, of = np.searchsorted(keys, np.arange(cluster[-1] + 2) * n), keys % n
    return Clusters(
        n_nodes=n,
        n_elements=len(cells),
        n_copies=len(of),
        n_clusters=len(starts) - 1,
        of=device.put(of.astype(np.int32)),
        starts=device.put(starts.astype(np.int32)),
        cells=device.put(np.ascontiguousarray(table.reshape(cells.shape).T, dtype=np.int32)),
        places=device.put(np.ascontiguousarray(points[:, of])),
        start=device.put(np.append(0, np.cumsum(np.bincount(of, minlength=n))).astype(np.int32)),
        slots=device.put(np.argsort(of, kind="stable").astype(np.int32)),
        moved=device.empty(3 * len(of)),
        sums=device.empty(3 * len(of)),
    )
