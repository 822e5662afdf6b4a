"""Multigrid for hexes of any topology: aggregates of nodes that move as rigid bodies, smoothed.

The stiffness is assembled in float32, a 3 x 3 block for each pair of nodes of an element. Nodes gather in aggregates;
the six rigid motions of each, smoothed by a step of Jacobi's iteration, span the coarse space. PyAMG does this and
cycles on the host; it only steers the conjugate gradients, which work in float64 and see the elements as they are.
Incompatible modes and mean dilatation, which make an element softer, are left out.

Source: Vanek, Mandel and Brezina 1996, "Algebraic multigrid by smoothed aggregation".
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg import cho_factor, cho_solve

from gpubspline.analysis.moduli import lame_moduli
from gpubspline.mesh.mesh import Mesh

STRENGTH = 0.05
"""Neighbours that are coupled more weakly than this, against their own blocks, are not gathered."""
DIRECT = 300
"""Unknowns that are solved directly."""
LEAST = 1e-6
"""Stiffness that is added to theirs, of the greatest: what float32 holds of it."""
SMOOTHER = ("block_gauss_seidel", {"sweep": "symmetric"})
_CHUNK = 1 << 15
"""Elements assembled at a time, which bounds the memory."""

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Aggregation:
    """A hierarchy of PyAMG's.

    Attributes
    ----------
    hierarchy: ``pyamg.multilevel.MultilevelSolver``.
    free: (n, 3) which directions are.
    """

    hierarchy: Any
    free: Flags

    def cycle(self, r: NDArray[Any]) -> NDArray[Any]:
        """Apply one V-cycle to a residual (3, n); gives the correction (3, n)."""
        values = np.asarray(r).T * self.free
        size = float(np.linalg.norm(values)) or 1.0
        flat = np.ascontiguousarray(values / size, dtype=np.float32).ravel()
        found = np.asarray(self.hierarchy.aspreconditioner(cycle="V") @ flat, dtype=np.float64)
        return np.ascontiguousarray((size * found.reshape(-1, 3)).T)


class _Bottom:
    """Solves the coarsest equations by Cholesky's factors, made once.

    Aggregates of held nodes leave rows of zeros: a little stiffness makes the matrix definite, and these stay at rest.
    """

    def __call__(self, matrix: Any, b: NDArray[Any]) -> NDArray[Any]:
        if not hasattr(self, "factors"):
            whole = matrix.toarray().astype(np.float64)
            whole[np.diag_indices_from(whole)] += LEAST * whole.diagonal().max()
            self.factors = cho_factor(whole, lower=True)
        return np.asarray(cho_solve(self.factors, b.astype(np.float64)))


def aggregation(mesh: Mesh, held: Flags, modulus: str) -> Aggregation:
    """Make the hierarchy of a mesh of hexes.

    Arguments
    ---------
    held: (n, 3) which directions are; modulus: see ``stiffness``.
    """
    import pyamg

    matrix = assemble(mesh, held, modulus)
    hierarchy = pyamg.smoothed_aggregation_solver(
        matrix,
        B=_rigid_motions(mesh, held),
        strength=("symmetric", {"theta": STRENGTH}),
        smooth=("jacobi", {"omega": 4 / 3, "weighting": "local"}),  # the spectral radius would be of random numbers
        improve_candidates=None,
        presmoother=SMOOTHER,
        postsmoother=SMOOTHER,
        max_coarse=DIRECT,
        coarse_solver=_Bottom(),
    )
    return Aggregation(hierarchy, ~held)


def assemble(mesh: Mesh, held: Flags, modulus: str) -> sparse.bsr_array:
    """Stiffness (3 n, 3 n), float32, by nodes; 1 where a direction is held."""
    n, pattern = mesh.n_nodes, _pattern(mesh)
    data = np.zeros((pattern.nnz, 3, 3), dtype=np.float32)
    for elements, cells in _chunks(mesh):
        blocks = _element_blocks(mesh, elements, cells, modulus)
        for c in range(3):
            for d in range(3):
                part = _by_nodes(cells, blocks[..., c, d].ravel(), n)
                if c == d == 0:  # where the entries of the part lie, of which all components have the same
                    at = np.asarray(pattern[_rows(part), part.indices]).ravel()
                data[at, c, d] += part.data
    rows, free = _rows(pattern), ~held
    data *= free[rows][:, :, None] & free[pattern.indices][:, None, :]
    matrix = sparse.bsr_matrix((data, pattern.indices, pattern.indptr), shape=(3 * n, 3 * n))
    kept = sparse.bsr_matrix(sparse.diags(held.ravel().astype(np.float32)), blocksize=(3, 3))
    return sparse.bsr_matrix(matrix + kept)


def _chunks(mesh: Mesh) -> Iterator[tuple[NDArray[Any], NDArray[np.int32]]]:
    """Numbers of some elements, and their nodes (m, k)."""
    for first in range(0, mesh.n_elements, _CHUNK):
        elements = np.arange(first, min(first + _CHUNK, mesh.n_elements))
        yield elements, mesh.cells_of(elements)


def _pattern(mesh: Mesh) -> sparse.csr_matrix:
    """Table (n, n) of the pairs of nodes of one element, numbered from 0 row by row.

    It is known before any stiffness is added, since SciPy's sums leave out what cancels.
    """
    n = mesh.n_nodes
    count = sparse.csr_matrix((n, n), dtype=np.float32)
    for _, cells in _chunks(mesh):
        count = count + _by_nodes(cells, np.ones(cells.size * cells.shape[1], dtype=np.float32), n)
    return sparse.csr_matrix((np.arange(count.nnz), count.indices, count.indptr), shape=(n, n))


def _by_nodes(cells: NDArray[np.int32], values: NDArray[np.float32], n: int) -> sparse.csr_matrix:
    """Sums (n, n) of values (m k k) of pairs of the nodes of elements (m, k), zeros kept."""
    k = cells.shape[1]
    rows, columns = np.repeat(cells, k, axis=1).ravel(), np.tile(cells, k).ravel()
    return sparse.csr_matrix(sparse.coo_matrix((values, (rows, columns)), shape=(n, n)))


def _rows(table: sparse.csr_matrix) -> NDArray[np.intp]:
    """Row of each entry."""
    return np.repeat(np.arange(table.shape[0]), np.diff(table.indptr))


def _element_blocks(mesh: Mesh, elements: NDArray[Any], cells: NDArray[np.int32], modulus: str) -> NDArray[np.float32]:
    """Stiffness (m, k, k, 3, 3) of elements (m,) of nodes ``cells`` (m, k), vertex by vertex."""
    element = mesh.element
    at, weights = element.gauss()
    slopes = element.gradient(at)
    tangents = np.einsum("dga,mac->mgdc", slopes, mesh.points[cells].astype(np.float64), optimize=True)
    gradient = np.einsum("mgcd,dga->mgac", np.linalg.inv(tangents), slopes, optimize=True)
    volume = np.abs(np.linalg.det(tangents)) * weights
    m, k = cells.shape
    b = gradient.reshape(m, len(weights), 3 * k).astype(np.float32)
    lam, mu = (
        np.matmul(b.swapaxes(1, 2), b * (values.T * volume)[..., None].astype(np.float32)).reshape(m, k, 3, k, 3)
        for values in lame_moduli(mesh, cells, element.shape(at), modulus, elements)
    )  # sums over the points of a modulus times the gradients of two vertices, component by component
    out = lam.swapaxes(2, 3) + mu.transpose(0, 1, 3, 4, 2)
    shear = mu[:, :, 0, :, 0] + mu[:, :, 1, :, 1] + mu[:, :, 2, :, 2]
    for c in range(3):
        out[..., c, c] += shear
    return np.asarray(out)


def _rigid_motions(mesh: Mesh, held: Flags) -> NDArray[np.float32]:
    """Six motions (3 n, 6), 0 where a direction is held."""
    moved = rigid_motions(mesh, np.arange(mesh.n_nodes)) * ~held[..., None]
    return np.ascontiguousarray(moved.reshape(-1, 6), dtype=np.float32)


def rigid_motions(mesh: Mesh, nodes: NDArray[np.integer]) -> Floats:
    """Three shifts and three turns about their middle of nodes (k,), as displacements (k, 3, 6) of about 1."""
    at = mesh.points[nodes].astype(np.float64)
    x, y, z = ((at - at.mean(axis=0)) / max(float(np.ptp(mesh.points, axis=0).max()), 1e-300)).T
    none, one = np.zeros(len(x)), np.ones(len(x))
    motions = [[one, none, none, none, z, -y], [none, one, none, -z, none, x], [none, none, one, y, -x, none]]
    return np.asarray(np.array(motions).transpose(2, 0, 1))
