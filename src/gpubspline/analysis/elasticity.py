"""Displacement of a hex mesh under loads: linear elasticity, solved by conjugate gradients.

The conjugate gradients and their operator work in float64, whatever the precision of the device that is given: in
float32 the displacement of a million slender elements would keep two or three digits. The multigrid that preconditions
them works in the device's own precision, which is where the time goes.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse

from gpubspline.analysis.aggregation import rigid_motions
from gpubspline.analysis.corners import corners
from gpubspline.analysis.krylov import Operator, Progress, Vectors, conjugate_gradients
from gpubspline.analysis.multilevel import multilevel
from gpubspline.analysis.stiffness import Stiffness, stiffness
from gpubspline.device import Buffer, Device, open_device
from gpubspline.errors import InputError
from gpubspline.material.orthotropy import without_orthotropy
from gpubspline.mesh.mesh import Mesh
from gpubspline.shown import brief

LIMIT = 20_000
"""Iterations after which a solve has failed."""
SMALL = 500
"""Nodes that their own blocks precondition well enough."""

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Solution:
    """What the loads do to a mesh.

    Attributes
    ----------
    displacement_mm: (n, 3) float64, mm.
    reactions_n: (n, 3) float64, N, what the supports give to the nodes; 0 where a direction is free.
    iterations: of the conjugate gradients.
    residual: size of the forces out of balance against that of the loads, before the displacement's last digit is
        rounded.
    strain_energy_nmm: N mm.
    """

    displacement_mm: Floats
    reactions_n: Floats
    iterations: int
    residual: float
    strain_energy_nmm: float

    __repr__ = brief


def solve(
    mesh: Mesh,
    fixed: ArrayLike,
    forces_n: ArrayLike,
    *,
    prescribed_mm: ArrayLike | None = None,
    modulus: str = "graded",
    formulation: str = "full",
    tolerance: float = 1e-8,
    device: Device,
    progress: Progress | None = None,
) -> Solution:
    """Solve for the displacement of a mesh of hexes with the nodal fields ``E_MPa`` and ``nu``.

    Arguments
    ---------
    fixed: (n, 3) bool, which directions of which nodes are held.
    forces_n: (n, 3), N, on the nodes.
    prescribed_mm: (n, 3), mm, where the held directions are moved to; 0 unless given.
    modulus, formulation: see ``stiffness``.
    tolerance: of the residual.
    device: where to compute; its precision is that of the preconditioner alone.
    progress: called with the number of each iteration and its residual.

    Raises
    ------
    InputError where the inputs do not fit the mesh or each other, or the supports leave it free to move.
    SolveError where the residual does not reach the tolerance.
    """
    held, loads, moved = _inputs(mesh, fixed, forces_n, prescribed_mm)
    if not 0 < tolerance < 1:
        raise InputError(f"expected a positive tolerance below 1, got {tolerance:g}")
    precise = open_device(device.name, "float64")
    k = stiffness(mesh, precise, modulus, formulation)
    held = _hold(mesh, held, loads)
    free, all_free = _put(precise, ~held), _put(precise, np.ones_like(held))
    given = _multiply(k, np.where(held, moved, 0.0), all_free)
    b = _put(precise, np.where(held, 0.0, loads - given))

    def apply(x: Buffer, out: Buffer) -> None:
        k.apply(x, free, out)

    found, iterations, residual = conjugate_gradients(
        apply,
        _preconditioner(mesh, k, held, free, device),
        b,
        Vectors(precise, 3 * k.n_nodes),
        tolerance=tolerance,
        limit=LIMIT,
        progress=progress,
    )
    displacement = np.where(held, moved, _get(precise, found))
    internal = _multiply(k, displacement, all_free)
    return Solution(
        displacement_mm=displacement,
        reactions_n=np.where(held, internal - loads, 0.0),
        iterations=iterations,
        residual=residual,
        strain_energy_nmm=0.5 * float(np.sum(displacement * internal)),
    )


def _preconditioner(mesh: Mesh, k: Stiffness, held: Flags, free: Buffer, device: Device) -> Operator:
    """Multigrid, of grids where the mesh is structured, else of aggregates; the nodes' own blocks of a small mesh."""
    if mesh.n_nodes <= SMALL:
        blocks = k.inverse_blocks(free)

        def multiply(r: Buffer, out: Buffer) -> None:
            k.device.launch("vectors.blocks_times", k.n_nodes, blocks, r, k.n_nodes, out)

        return multiply
    if mesh.element.order == 2:
        return corners(mesh, k, held, free, device).apply
    # of orthotropic elements the mean modulus preconditions
    like = k if k.roots is None else None
    grids = multilevel(without_orthotropy(mesh), held, device, k.modulus, like)

    def cycle(r: Buffer, out: Buffer) -> None:
        correction = k.device.put(grids.cycle(np.reshape(k.device.get(r), (3, -1))))
        Vectors(k.device, 3 * k.n_nodes).combine(correction, 1.0, 0.0, out)

    return cycle


def _put(device: Device, values: NDArray[Any]) -> Buffer:
    """(n, 3) as planes."""
    return device.put(np.ascontiguousarray(values.T, dtype=np.float64))


def _get(device: Device, buffer: Buffer) -> Floats:
    """Planes as a copy of (n, 3)."""
    return np.array(np.reshape(device.get(buffer), (3, -1)).T, dtype=np.float64)


def _multiply(k: Stiffness, displacement: Floats, free: Buffer) -> Floats:
    """Forces (n, 3), N, of a displacement (n, 3), mm."""
    out = k.device.empty(3 * k.n_nodes)
    k.apply(_put(k.device, displacement), free, out)
    return _get(k.device, out)


def _inputs(
    mesh: Mesh, fixed: ArrayLike, forces_n: ArrayLike, prescribed_mm: ArrayLike | None
) -> tuple[Flags, Floats, Floats]:
    held, loads = np.asarray(fixed, dtype=bool), np.asarray(forces_n, dtype=np.float64)
    moved = np.zeros(loads.shape) if prescribed_mm is None else np.asarray(prescribed_mm, dtype=np.float64)
    for name, values in (("supports", held), ("forces", loads), ("prescribed displacements", moved)):
        if values.shape != (mesh.n_nodes, 3):
            raise InputError(f"expected {name} of shape {(mesh.n_nodes, 3)}, got {values.shape}")
        if not np.all(np.isfinite(values)):
            raise InputError(f"expected finite {name}, got one that is not")
    return held, loads, moved


def _hold(mesh: Mesh, held: Flags, loads: Floats) -> Flags:
    """Hold nodes of no element too; see that the rest cannot move as a rigid body."""
    labels = np.zeros(mesh.n_nodes, dtype=np.int64)
    bodies = 1
    if mesh.structure is None:
        used = np.zeros(mesh.n_nodes, dtype=bool)
        used[mesh.cells] = True
        if np.any(loads[~used]):
            raise InputError(
                f"expected forces on nodes of elements, got one on node {np.argmax(~used & loads.any(axis=1))}"
            )
        held = held | ~used[:, None]
        bodies, labels = _bodies(mesh, used)
    for body in range(bodies):
        _check_supports(mesh, held, np.flatnonzero(held.any(axis=1) & (labels == body)))
    return held


def _bodies(mesh: Mesh, used: Flags) -> tuple[int, NDArray[Any]]:
    """Number of the parts that share no node, and of each node its part's; -1 in no element."""
    first, other = np.repeat(mesh.cells[:, 0], mesh.cells.shape[1] - 1), mesh.cells[:, 1:].ravel()
    graph = sparse.coo_array((np.ones(len(first), dtype=np.int8), (first, other)), shape=2 * (mesh.n_nodes,))
    _, labels = sparse.csgraph.connected_components(graph, directed=False)
    present, numbers = np.unique(labels[used], return_inverse=True)
    found = np.full(mesh.n_nodes, -1)
    found[used] = numbers
    return len(present), found


def _check_supports(mesh: Mesh, held: Flags, nodes: NDArray[Any]) -> None:
    """Raise unless the held directions of a body's nodes leave none of its six rigid motions."""
    rank = 0
    if len(nodes):
        rows = rigid_motions(mesh, nodes)[held[nodes]]
        rank = int(np.linalg.matrix_rank(rows.T @ rows, tol=1e-12, hermitian=True))
    if rank < 6:
        raise InputError(
            f"expected supports that hold the mesh, got {len(nodes)} nodes that leave {6 - rank} of 6 rigid motions"
        )
