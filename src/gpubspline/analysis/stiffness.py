"""The stiffness of a mesh of hexes on a device: its product with a displacement, element by element."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from gpubspline.analysis.clusters import Clusters, clusters, in_space
from gpubspline.analysis.moduli import MODULI, check_material, lame_moduli
from gpubspline.device import Buffer, Device
from gpubspline.errors import InputError
from gpubspline.material.orthotropy import is_orthotropic, orthotropic
from gpubspline.mesh.mesh import Mesh

FORMULATIONS = ("full", "incompatible", "bbar")
"""Of hex8; their numbers are those of the kernels."""
BRICK = 8
"""Rows of elements each way that a CPU sums in its caches: 9 x 9 rows of nodes of 9 numbers each stay in the second."""
_CHUNK = 1 << 16
"""Elements whose modes are inverted at a time, which bounds the memory."""

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Stiffness:
    """K of a mesh, which is never formed.

    Attributes
    ----------
    device: where it lives.
    n_nodes, n_elements, n_vertices: n, m and k vertices an element; in clusters the last vector is
        filled with elements of no stiffness.
    modulus: of ``MODULI``.
    formulation: position in ``FORMULATIONS``.
    points: (3, n), mm, from the middle of the mesh.
    nodes: (k, m) vertices of each element.
    slopes: (g, k, 3) derivatives of the shape functions at the Gauss points.
    weights: (g,) of the Gauss points.
    lame: Lame's lambda and mu, MPa, (g, m) each.
    inverse_modes: (9, 9, m) of the incompatible modes, else of no meaning.
    roots: (6, m) of orthotropic elements and Lame's moduli (m) of a modulus of 1 (``material/orthotropy.py``), else
        None; ``lame`` is then that of the mean modulus, which preconditions.
    start, slots: (n + 1,) and (k m,) where the elements of each node keep their forces on it.
    forces, fluxes: what was last computed, (3, k, m) and, but for hex8, (g, 3, 3, m).
    structure: nodes per direction, where the mesh is structured and of isotropic hex8 of full integration, else None;
        ``apply`` then needs no connectivity.
    clusters: in which a CPU takes other such elements, which are in their order here, else None.
    partial: what it writes on the way, see ``structured_elasticity.py``; else None.
    """

    device: Device
    n_nodes: int
    n_elements: int
    n_vertices: int
    modulus: str
    formulation: int
    points: Buffer
    nodes: Buffer
    slopes: Buffer
    weights: Buffer
    lame: tuple[Buffer, Buffer]
    inverse_modes: Buffer
    start: Buffer
    slots: Buffer
    forces: Buffer
    fluxes: Buffer
    roots: tuple[Buffer, Buffer, Buffer] | None = None
    structure: tuple[int, ...] | None = None
    clusters: Clusters | None = None
    partial: Buffer | None = None

    @property
    def n_points(self) -> int:
        """Gauss points of an element."""
        return int(self.weights.size)

    def apply(self, displacement: Buffer, free: Buffer, out: Buffer) -> None:
        """Write the nodal forces K u (3, n), N, of a displacement u (3, n), mm; 0 where ``free`` (3, n) is 0."""
        if self.clusters is not None:
            self.clusters.apply(self.device, displacement, self.lame, free, out)
            return
        if self.structure is None:
            self.element_forces(displacement)
            self._gather(self.forces, 3, free, out)
            return
        n_u, n_v, n_w = self.structure
        where = (self.points, displacement, *self.structure, *self.lame)
        if self.device.cores:
            launched = (*_bricks(self.structure), n_u - 1)
            self.device.launch("structured_elasticity.bricks", launched, *where, BRICK, self.partial)
            how = (self.partial, free, *self.structure, BRICK, out)
            self.device.launch("structured_elasticity.sum_bricks", (n_w, n_v, n_u), *how)
        else:
            launched = (n_w - 1, n_v - 1, n_u - 1)
            self.device.launch("structured_elasticity.shares", launched, *where, self.partial)
            how = (self.partial, free, n_u, n_v * n_w, out)
            self.device.launch("structured_elasticity.sum_shares", (n_v * n_w, n_u), *how)

    def element_forces(self, displacement: Buffer) -> None:
        """Write what each element gives its nodes, N, into ``forces`` (3, k, m)."""
        if self.n_vertices == 8 and self.roots is None:
            self._hex8_forces(displacement)
        else:
            self._fluxes(displacement)

    def _hex8_forces(self, displacement: Buffer) -> None:
        where = (self.points, displacement, self.n_nodes, self.nodes, self.n_elements)
        how = (*self.lame, self.formulation, self.inverse_modes, self.forces)
        self.device.launch("hex8.forces", self.n_elements, *where, *how)

    def _fluxes(self, displacement: Buffer) -> None:
        where = (self.points, displacement, self.n_nodes, self.nodes, self.n_vertices, self.n_elements)
        kernel = "isoparametric.fluxes" if self.roots is None else "orthotropic.fluxes"
        how = (self.slopes, self.weights, self.n_points, *(self.roots or self.lame), self.fluxes)
        self.device.launch(kernel, self.n_elements, *where, *how)
        counts = (self.n_points, self.n_vertices, self.n_elements)
        launched = (self.n_vertices, self.n_elements)
        self.device.launch("isoparametric.flux_forces", launched, self.fluxes, self.slopes, *counts, self.forces)

    def _gather(self, values: Buffer, components: int, free: Buffer, out: Buffer) -> None:
        count = self.n_vertices * self.n_elements
        where = (self.start, self.slots, free, self.n_nodes, out)
        self.device.launch("nodal.gather", self.n_nodes, values, components, count, *where)

    def inverse_blocks(self, free: Buffer) -> Buffer:
        """Inverse (6, n) of each node's own stiffness, 0 where it is not free; the first preconditioner."""
        values = self.device.empty(6 * self.n_vertices * self.n_elements)
        where = (self.points, self.n_nodes, self.nodes, self.n_vertices, self.n_elements)
        how = (self.slopes, self.weights, self.n_points, *self.lame, values)
        self.device.launch("isoparametric.own_stiffness", (self.n_vertices, self.n_elements), *where, *how)
        blocks, inverse = self.device.empty(6 * self.n_nodes), self.device.empty(6 * self.n_nodes)
        self._gather(values, 6, self.device.put(np.ones(6 * self.n_nodes)), blocks)
        self.device.launch("nodal.invert_blocks", self.n_nodes, blocks, free, self.n_nodes, inverse)
        return inverse


def stiffness(mesh: Mesh, device: Device, modulus: str = "graded", formulation: str = "full") -> Stiffness:
    """Bring a mesh of hexes with its fields ``E_MPa`` and ``nu`` (see ``moduli.py``) to a device.

    Arguments
    ---------
    modulus: ``"graded"``, nodal values interpolated by the shape functions (Kim and Paulino 2002) or those at the Gauss
        points where the mesh has them, or ``"element"``, the mean of each element's nodes throughout it.
    formulation: of hex8: ``"full"`` integration, ``"incompatible"`` modes, which bend freely, or ``"bbar"``, the mean
        dilatation, for nearly incompressible material.

    Raises
    ------
    InputError where the mesh has no material, an impossible one or an inverted element, or an option is unknown.
    """
    _check(mesh, modulus, formulation)
    cells, element = mesh.cells, mesh.element
    simple = element.n_nodes == 8 and formulation == "full" and not is_orthotropic(mesh)
    by_rows = mesh.structure if simple and 24 * mesh.n_nodes < 2**31 else None  # 32-bit numbers count the shares
    order = in_space(mesh.points, cells) if simple and by_rows is None and device.cores else np.arange(len(cells))
    cells = cells[order]
    at, weights = element.gauss()
    nodes = device.put(np.ascontiguousarray(cells.T))
    places = (mesh.planes - mesh.planes.mean(axis=1, dtype=np.float64)[:, None]).astype(np.float64)
    points = device.put(places)
    slopes = device.put(np.ascontiguousarray(element.gradient(at).transpose(1, 2, 0)))
    _check_jacobians(mesh, device, points, nodes, slopes, order)
    moduli = lame_moduli(mesh, cells, element.shape(at), modulus, order)
    for values in moduli:
        values[:, mesh.n_elements :] = 0  # elements that only fill the last vector
    lame = [device.put(values) for values in moduli]
    start, slots = _slots(cells, mesh.n_nodes)
    modes, roots = device.empty(1), _roots(mesh, device)
    if formulation == "incompatible":
        modes = _inverse_modes(device, points, mesh.n_nodes, nodes, mesh.n_elements, lame)
    return Stiffness(
        device=device,
        n_nodes=mesh.n_nodes,
        n_elements=len(cells),
        n_vertices=element.n_nodes,
        modulus=modulus,
        formulation=FORMULATIONS.index(formulation),
        points=points,
        nodes=nodes,
        slopes=slopes,
        weights=device.put(weights),
        lame=(lame[0], lame[1]),
        inverse_modes=modes,
        start=device.put(start),
        slots=device.put(slots),
        forces=device.empty(3 * cells.size),
        fluxes=device.empty(1 if element.n_nodes == 8 and roots is None else 9 * len(weights) * mesh.n_elements),
        roots=roots,
        structure=by_rows,
        clusters=clusters(places, cells, device) if simple and by_rows is None and device.cores else None,
        partial=None if by_rows is None else _partial(by_rows, device),
    )


def _bricks(structure: tuple[int, ...]) -> tuple[int, int]:
    """Bricks along w and along v."""
    return -(-(structure[2] - 1) // BRICK), -(-(structure[1] - 1) // BRICK)


def _partial(structure: tuple[int, ...], device: Device) -> Buffer:
    if device.cores:
        return device.empty(int(np.prod(_bricks(structure))) * 3 * (BRICK + 1) ** 2 * structure[0])
    return device.put(np.zeros(24 * int(np.prod(structure)), device.real))


def _roots(mesh: Mesh, device: Device) -> tuple[Buffer, Buffer, Buffer] | None:
    if not is_orthotropic(mesh):
        return None
    material = orthotropic(mesh)
    q = material.roots
    planes = np.stack([q[0, 0], q[1, 1], q[2, 2], q[1, 2], q[0, 2], q[0, 1]])
    lame, shear = material.unit_lame
    return device.put(np.ascontiguousarray(planes)), device.put(lame), device.put(shear)


def _check(mesh: Mesh, modulus: str, formulation: str) -> None:
    if mesh.element.dimension != 3 or mesh.n_elements == 0:
        raise InputError(f"expected a mesh of hexes to solve, got {mesh.n_elements} {mesh.element_type}")
    if modulus not in MODULI:
        raise InputError(f"expected a modulus of {' or '.join(MODULI)}, got {modulus!r}")
    if formulation not in FORMULATIONS:
        raise InputError(f"expected a formulation of {', '.join(FORMULATIONS)}, got {formulation!r}")
    if formulation != "full" and mesh.element_type != "hex8":
        raise InputError(f"expected hex8 for the formulation {formulation!r}, got {mesh.element_type}")
    check_material(mesh)
    if formulation != "full" and is_orthotropic(mesh):
        raise InputError(f"expected the formulation 'full' for orthotropic elements, got {formulation!r}")
    most = (2**31 - 1) // numbers_of(mesh, formulation)
    if mesh.n_elements > most:
        raise InputError(f"expected at most {most:,} {mesh.element_type}, got {mesh.n_elements:,}")


def numbers_of(mesh: Mesh, formulation: str) -> int:
    """Most numbers that an element has in one array, which kernels find by 32-bit indices."""
    vertices, (_, weights) = mesh.element.n_nodes, mesh.element.gauss()
    by_points = vertices > 8 or is_orthotropic(mesh)
    return max(6 * vertices, 9 * len(weights) if by_points else 0, 81 if formulation == "incompatible" else 0)


def _check_jacobians(
    mesh: Mesh, device: Device, points: Buffer, nodes: Buffer, slopes: Buffer, order: NDArray[np.intp]
) -> None:
    n_points = slopes.size // (3 * mesh.element.n_nodes)
    out = device.empty((n_points, len(order)))
    where = (points, mesh.n_nodes, nodes, mesh.element.n_nodes, len(order))
    device.launch("isoparametric.jacobians", len(order), *where, slopes, n_points, out)
    bad = np.unique(order[~(device.get(out).min(axis=0) > 0)])
    if len(bad):
        raise InputError(f"expected no inverted element, got {len(bad)}, the first of them number {bad[0] + 1}")


def _slots(cells: NDArray[np.int32], n_nodes: int) -> tuple[NDArray[Any], NDArray[Any]]:
    """Where each node finds what its elements give it, in the (k, m) order of elements' vertices."""
    vertices = cells.T.ravel()
    columns = np.arange(vertices.size, dtype=np.int32)
    table = sparse.coo_array(
        (np.ones(vertices.size, dtype=np.int8), (vertices, columns)), shape=(n_nodes, vertices.size)
    ).tocsr()
    return table.indptr.astype(np.int32), table.indices.astype(np.int32)


def _inverse_modes(device: Device, points: Buffer, n: int, nodes: Buffer, m: int, lame: list[Buffer]) -> Buffer:
    modes = device.empty((81, m))
    device.launch("hex8.modes", m, points, n, nodes, m, *lame, modes)
    values = np.array(device.get(modes))
    for begin in range(0, m, _CHUNK):
        part = values[:, begin : begin + _CHUNK].T.reshape(-1, 9, 9)
        values[:, begin : begin + _CHUNK] = np.linalg.inv(part).reshape(-1, 81).T
    return device.put(values)
