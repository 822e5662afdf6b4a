"""The preconditioner of hex20 and hex27: smoothing, and the multigrid of the hex8 mesh of their corners.

A displacement of the corners goes on linearly along edges, faces and insides, which hex20 and hex27 can follow.
"""

from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from gpubspline.analysis.grid import MARGIN, POWERS
from gpubspline.analysis.krylov import Vectors
from gpubspline.analysis.multilevel import Multilevel, multilevel
from gpubspline.analysis.stiffness import Stiffness
from gpubspline.device import Buffer, Device
from gpubspline.mesh import structure
from gpubspline.mesh.elements import ELEMENTS
from gpubspline.mesh.mesh import Mesh

SMOOTHINGS = 4
"""Steps of Chebyshev's iteration before and after the corners' solution."""
DAMPED = 30.0
"""The ratio of eigenvalues over which they damp."""


@dataclass(frozen=True, eq=False)
class Corners:
    """A preconditioner: Chebyshev's iteration over the nodes' own blocks, around the multigrid of the corners.

    Attributes
    ----------
    k, free, blocks: the stiffness, its free directions (3, n) and the inverse (6, n) of the nodes' own blocks.
    grids: of the hex8 mesh of the corners.
    linear: (n, corners) from corners to all nodes.
    free_nodes: (3, n), 0 where a direction is held.
    largest: eigenvalue of the blocks' inverse times the stiffness, or a little more.
    """

    k: Stiffness
    free: Buffer
    blocks: Buffer
    grids: Multilevel
    linear: sparse.csr_array
    free_nodes: NDArray[np.float64]
    largest: float = 1.0

    @property
    def vectors(self) -> Vectors:
        """Arithmetic of displacements."""
        return Vectors(self.k.device, 3 * self.k.n_nodes)

    def apply(self, b: Buffer, x: Buffer) -> None:
        """Write the correction x of a residual b."""
        work = [self.vectors.zeros() for _ in range(3)]
        self.vectors.combine(b, 0.0, 0.0, x)
        self._smooth(b, x, work, still=True)
        self._defect(b, x, work[0])
        r = np.reshape(self.k.device.get(work[0]), (3, -1))
        z = self.grids.cycle((self.linear.T @ (self.free_nodes * r).T).T).astype(np.float64)
        correction = np.ascontiguousarray((self.linear @ z.T).T * self.free_nodes)
        self.vectors.combine(self.k.device.put(correction), 1.0, 1.0, x)
        self._smooth(b, x, work)

    def _defect(self, b: Buffer, x: Buffer, r: Buffer) -> None:
        self.k.apply(x, self.free, r)
        self.vectors.combine(b, 1.0, -1.0, r)

    def _smooth(self, b: Buffer, x: Buffer, work: list[Buffer], still: bool = False) -> None:
        """Chebyshev's iteration on x, which is 0 where it is ``still``."""
        r, z, d = work
        middle, reach = self.largest * (1 + 1 / DAMPED) / 2, self.largest * (1 - 1 / DAMPED) / 2
        keep, step, rho = 0.0, 1 / middle, reach / middle
        for number in range(SMOOTHINGS):
            if still and number == 0:
                self.multiply_blocks(b, z)
            else:
                self._defect(b, x, r)
                self.multiply_blocks(r, z)
            self.vectors.combine(z, step, keep, d)
            self.vectors.combine(d, 1.0, 1.0, x)
            after = 1 / (2 * middle / reach - rho)
            keep, step, rho = after * rho, 2 * after / reach, after

    def multiply_blocks(self, r: Buffer, out: Buffer) -> None:
        """Write the product with the inverse of the nodes' own blocks."""
        self.k.device.launch("vectors.blocks_times", self.k.n_nodes, self.blocks, r, self.k.n_nodes, out)


def corners(mesh: Mesh, k: Stiffness, held: NDArray[np.bool_], free: Buffer, device: Device) -> Corners:
    """Make the preconditioner of a mesh of order 2; the multigrid of a structured one works on ``device``."""
    at, coarse = _corner_mesh(mesh)
    grids = multilevel(coarse, held[at], device, k.modulus)
    linear = _linear_table(mesh, at, coarse) if mesh.structure is None else _linear(mesh)
    made = Corners(k, free, k.inverse_blocks(free), grids, linear, (~held.T).astype(np.float64))
    return Corners(k, free, made.blocks, grids, made.linear, made.free_nodes, _largest(made))


def _corner_mesh(mesh: Mesh) -> tuple[NDArray[Any], Mesh]:
    """Numbers of the nodes at corners, and the hex8 mesh of them."""
    if mesh.structure is None:
        at, numbers = np.unique(mesh.cells[:, :8], return_inverse=True)
        shape: dict[str, Any] = {"connectivity": numbers.reshape(-1, 8)}
    else:
        at = np.asarray(structure.corner_nodes(mesh.element, mesh.structure))
        shape = {"structure": mesh.structure}
    names = ("E_MPa", "nu")
    fields = {name: mesh.fields[name][at] for name in names if name in mesh.fields}
    own = {name: mesh.cell_fields[name] for name in names if name in mesh.cell_fields}
    return at, Mesh(mesh.points[at], "hex8", fields=fields, cell_fields=own, **shape)


def _linear_table(mesh: Mesh, at: NDArray[Any], coarse: Mesh) -> sparse.csr_array:
    """Each node's shares of the corners of the first element that has it."""
    nodes, where = np.unique(mesh.cells, return_index=True)
    elements, vertices = np.divmod(where, mesh.element.n_nodes)
    shares = ELEMENTS["hex8"].shape(np.array(mesh.element.vertices) / 2)[vertices]
    rows = np.repeat(nodes, 8)
    table = (shares.ravel(), (rows, coarse.cells[elements].ravel()))
    return sparse.csr_array(table, shape=(mesh.n_nodes, len(at)))


def _linear(mesh: Mesh) -> sparse.csr_array:
    """Each node's shares of the corners before and after it along each direction."""
    assert mesh.structure is not None
    lattice = np.indices(structure.lattice_counts(mesh.element, mesh.structure)[::-1]).reshape(3, -1)[::-1]
    kept = structure.has_node(mesh.element, mesh.structure)
    lattice = lattice if kept is None else lattice[:, kept]
    n, n_corners = lattice.shape[1], int(np.prod(mesh.structure))
    total = sparse.csr_array((n, n_corners))
    for step in product((0, 1), repeat=3):
        u, v, w = (lattice + np.array(step)[:, None]) // 2
        place = u + mesh.structure[0] * (v + mesh.structure[1] * w)
        total = total + sparse.csr_array((np.full(n, 0.125), (np.arange(n), place)), shape=(n, n_corners))
    return total


def _largest(made: Corners) -> float:
    """The largest eigenvalue of the blocks' inverse times K, by powers."""
    device, size = made.k.device, 1.0
    values = np.random.default_rng(0).standard_normal((3, made.k.n_nodes)) * made.free_nodes
    product_, scaled = made.vectors.zeros(), made.vectors.zeros()
    for _ in range(POWERS):
        made.k.apply(device.put(values / np.linalg.norm(values)), made.free, product_)
        made.multiply_blocks(product_, scaled)
        values = np.array(device.get(scaled)).reshape(3, -1)
        size = float(np.linalg.norm(values))
    return MARGIN * size
