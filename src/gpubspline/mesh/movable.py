"""Hexes or quads whose nodes may move, on a device: inside freely, on the boundary along what holds them.

That is the zero level of a distance, or a surface of pieces that they walk on.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.device import Buffer, Device
from gpubspline.device.vectors import inner_product
from gpubspline.errors import InputError
from gpubspline.mesh.quality import launch_explicit

FREE = 1e9
"""Slack of a node that may go anywhere."""

FIXED = -1.0
"""Slack of a node that stays."""


@dataclass(frozen=True, eq=False)
class Level:
    """Sampled distances on a device, one or more; or instead of them pieces to walk on.

    Attributes
    ----------
    volume: (levels, n_k, n_j, n_i), in the unit of the coordinates.
    counts: (n_i, n_j, n_k).
    to_index: row-major 3 x 4 map from coordinates to the index (i, j, k).
    pieces: (18, n_pieces) corners of triangles with their normals, and of segments, as triangles whose second and third
        corner are one, with their directions.
    around_start, around: (n_pieces + 1,) and what it points to: the pieces that touch each one.
    """

    volume: Buffer
    counts: tuple[int, int, int]
    to_index: Buffer
    pieces: Buffer
    n_pieces: int
    around_start: Buffer
    around: Buffer

    @property
    def planes(self) -> int:
        """Planes of the coordinates: 4 where the last one says on which piece a node is."""
        return 4 if self.n_pieces else 3

    @property
    def arguments(self) -> tuple[Any, ...]:
        """As the kernels take it."""
        walk = (self.pieces, self.n_pieces, self.around_start, self.around)
        return self.volume, *self.counts, self.to_index, *walk


def put_level(volume: NDArray[Any], to_index: NDArray[np.float64], device: Device) -> Level:
    """Bring distances ([levels,] n_k, n_j, n_i) and the map (3 or 4, 4) from coordinates to their index to a device."""
    n_k, n_j, n_i = volume.shape[-3:]
    levels = device.put(np.ascontiguousarray(volume)), (n_i, n_j, n_k), device.put(np.ascontiguousarray(to_index[:3]))
    none = device.put(np.zeros(2, dtype=np.int32))
    return Level(*levels, device.put(np.zeros(18)), 0, none, none)


def put_pieces(
    corners: NDArray[Any], normals: NDArray[Any], start: NDArray[Any], around: NDArray[Any], device: Device
) -> Level:
    """Bring pieces (n_pieces, 3, 3), their normals and what touches each of them to a device.

    Raises InputError where they are more than the plane of ``real`` that says on which one a node is can number.
    """
    most = 2 ** (np.finfo(device.real).nmant + 1)
    if len(corners) > most:
        raise InputError(
            f"expected a surface of at most {most:,} pieces, got {len(corners):,}: optimise a coarser mesh"
        )
    unused = device.put(np.ones(8)), (2, 2, 2), device.put(np.eye(4)[:3].copy())
    planes = np.concatenate([corners.reshape(-1, 9), normals.reshape(-1, 9)], axis=1)
    walk = device.put(np.ascontiguousarray(planes.T)), len(corners), device.put(start), device.put(around)
    return Level(*unused, *walk)


@dataclass(frozen=True)
class Goal:
    """What the energy of a mesh wants.

    Attributes
    ----------
    jacobian: scaled Jacobian that every corner should reach.
    power: 2 or 4, of what it lacks.
    edges: weight of the squared logarithm of the edges' lengths against their targets.
    """

    jacobian: float
    power: int
    edges: float


@dataclass(frozen=True, eq=False)
class Movable:
    """Hexes or quads on a device.

    Attributes
    ----------
    cells: (m, k) int32, k = 8 or 4, on the host.
    nodes: (k, m) the same by vertex.
    log_lengths: (3, m) logarithm of the squared target length of the edges along u, v, w; (2, m) of quads.
    start, slots: (n + 1,), (k m,) where the elements of each node are.
    scale: (3, n) size of the smallest element of each node, for each of its coordinates.
    slack: (n,) how far a node may be from the zero level; ``FREE`` or ``FIXED``.
    level: what boundary nodes slide on.
    places: (3, n) where curved pieces have the nodes that were slid last; None without pieces.
    levels: (2, n) which of its distances, and a second one for nodes on the curve where two meet, else -1.
    """

    device: Device
    n_nodes: int
    cells: NDArray[np.int32]
    nodes: Buffer
    log_lengths: Buffer
    start: Buffer
    slots: Buffer
    scale: Buffer
    slack: Buffer
    level: Level
    levels: Buffer
    places: Buffer | None
    normal: Buffer
    energy: Buffer
    shares: Buffer
    ones: Buffer

    @property
    def n_elements(self) -> int:
        """Number of elements."""
        return len(self.cells)

    @property
    def n_corners(self) -> int:
        """Vertices of an element: 8 or 4."""
        return int(self.cells.shape[1])

    @property
    def planes(self) -> int:
        """Planes of what says where the nodes are."""
        return self.level.planes

    @property
    def _kind(self) -> str:
        return "hex" if self.n_corners == 8 else "quad"

    @cached_property
    def _table(self) -> Buffer:
        """(m, k) vertices by element, as the quality's kernels want them."""
        return self.device.put(self.cells)

    def with_slack(self, slack: NDArray[Any]) -> "Movable":
        """Give the same elements with other slack (n,)."""
        return replace(self, slack=self.device.put(slack.astype(np.float64)))

    def slide(self, x: Buffer) -> None:
        """Bring the nodes x (planes, n) back to within their slack."""
        held = (self.slack, self.levels, *self.level.arguments)
        args = (x, self.n_nodes, *held, self.slid(x), self.normal)
        self.device.launch("optimize.slide", self.n_nodes, *args)

    def slid(self, x: Buffer) -> Buffer:
        """Places (3, n) of nodes x that have just been slid."""
        return x if self.places is None else self.places

    def evaluate(self, x: Buffer, goal: Goal, gradient: Buffer) -> float:
        """Energy at x (planes, n), slid before, and its gradient (3, n) along what the nodes may do."""
        m, device = self.n_elements, self.device
        wanted = (float(goal.jacobian), goal.power, float(goal.edges))
        device.launch(
            f"energy.{self._kind}_energy",
            m,
            self.slid(x),
            self.n_nodes,
            self.nodes,
            m,
            self.log_lengths,
            *wanted,
            self.energy,
            self.shares,
        )
        table = (self.start, self.slots, self.normal, self.slack, self.levels)
        args = (self.shares, self.n_corners, m, *table, self.n_nodes, gradient)
        device.launch("energy.node_gradient", self.n_nodes, *args)
        return inner_product(device, self.energy, self.ones, m)

    def scaled_jacobian(self, x: Buffer) -> NDArray[Any]:
        """Scaled Jacobian (m,) of each element at x (planes, n)."""
        if self.places is not None:
            self.slide(x)
        planes = self.device.get(self.slid(x)).reshape(3, -1)
        out = self.device.empty(self.n_elements)
        points, kernel = [self.device.put(plane) for plane in planes], f"{self._kind}_scaled_jacobian"
        launch_explicit(kernel, points, self.n_nodes, self._table, self.n_elements, out, self.device)
        return np.array(self.device.get(out))


def movable(
    cells: NDArray[np.int32],
    n_nodes: int,
    slack: NDArray[Any],
    level: Level,
    device: Device,
    log_lengths: NDArray[Any] | None = None,
    levels: NDArray[Any] | None = None,
) -> Movable:
    """Bring hexes (m, 8) or quads (m, 4) of n nodes with their slack (n,) to a device.

    Target lengths are 1 unless given (3, m), of quads (2, m); nodes are held by the first distance alone unless
    ``levels`` (2, n) says by which.
    """
    m = len(cells)
    start, slots = node_slots(cells, n_nodes)
    lengths = np.zeros((3, m)) if log_lengths is None else log_lengths
    return Movable(
        device=device,
        n_nodes=n_nodes,
        cells=cells,
        nodes=device.put(np.ascontiguousarray(cells.T)),
        log_lengths=device.put(lengths),
        start=device.put(start),
        slots=device.put(slots),
        scale=device.put(np.tile(node_sizes(lengths, start, slots), 3)),
        slack=device.put(slack.astype(np.float64)),
        level=level,
        levels=device.put(one_level(n_nodes) if levels is None else levels),
        places=device.empty(3 * n_nodes) if level.n_pieces else None,
        normal=device.put(np.zeros(3 * n_nodes)),
        energy=device.empty(m),
        shares=device.empty(3 * cells.size),
        ones=device.put(np.ones(m)),
    )


def one_level(n_nodes: int) -> NDArray[np.int32]:
    """(2, n) of nodes that the first distance alone holds."""
    return np.stack([np.zeros(n_nodes, dtype=np.int32), np.full(n_nodes, -1, dtype=np.int32)])


def node_sizes(log_lengths: NDArray[Any], start: NDArray[np.int32], slots: NDArray[np.int32]) -> NDArray[Any]:
    """Least target length (n,) of the edges of each node's elements; 1 for a node of none."""
    shortest = np.exp(0.5 * log_lengths.min(axis=0))
    used = np.flatnonzero(np.diff(start))
    sizes = np.ones(len(start) - 1)
    sizes[used] = np.minimum.reduceat(shortest[slots % len(shortest)], start[used])
    return sizes


def node_slots(cells: NDArray[np.int32], n_nodes: int) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Where each node is a vertex: slots a m + e from ``start[node]`` to ``start[node + 1]``, increasing."""
    by_vertex = cells.T.reshape(-1)
    start = np.zeros(n_nodes + 1, dtype=np.int32)
    np.cumsum(np.bincount(by_vertex, minlength=n_nodes), out=start[1:])
    return start, np.argsort(by_vertex, kind="stable").astype(np.int32)
