"""Scaled Jacobian of every element, and what it says about the mesh."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.device import Buffer, Device, check_device, open_device
from gpubspline.errors import InputError, MeshError, expect
from gpubspline.mesh import structure
from gpubspline.mesh.mesh import Mesh
from gpubspline.shown import brief, shown

COLUMN_CELLS = 64  # along w, along which a work item of a GPU goes
TILE = 32  # of a GPU, as in its kernel
TILE_ROWS = 4
_PART = 1 << 15  # values counted at a time, which stay in a cache
_BLOCK = 256  # values, of which the least is looked at first
OTHER_WAYS = "other counts of control points, --optimize or 'gpubspline mesh --method blocks'"
"""To a mesh without inverted elements, of one by the tensor method."""

WORST = 10
"""How many of the worst elements a ``Quality`` names."""


def scaled_jacobian(mesh: Mesh, device: Device) -> NDArray[Any]:
    """Scaled Jacobian of each element: the least, over its 4 or 8 corners, determinant of the unit edge vectors.

    Quads lie in space: their corners' normals are measured against the normal at the centre. Of elements of order 2 the
    corners count, with straight edges between them. An element with an edge of no length gets 0 or less, never NaN.

    Returns
    -------
    (m,) of the device's precision, -1..1; an element of 0 or less is inverted.

    Raises
    ------
    InputError where a node is nowhere: NaN or infinity.

    Source: eqs 3.4 and 3.5 of the paper; Knupp 2000. VTK takes the hex's centre into the minimum too, which is below
    all corners only where a corner is negative already.
    """
    kind = _kind(mesh)
    if mesh.structure is None:
        return np.asarray(device.get(_explicit(mesh, f"{kind}_scaled_jacobian", 1, device)))
    result = device.empty(mesh.n_elements)
    points = _put_points(mesh, device, structure.corner_nodes(mesh.element, mesh.structure))
    launch_structured(kind, points, mesh.structure, result, device)
    return np.asarray(device.get(result))


def corner_scaled_jacobian(mesh: Mesh, device: Device) -> NDArray[Any]:
    """Scaled Jacobian at each corner of each element, (m, 4) or (m, 8), in the order of the vertices."""
    result = _explicit(mesh, f"{_kind(mesh)}_corner_jacobian", mesh.element.n_corners, device)
    return np.asarray(np.reshape(device.get(result), (-1, mesh.n_elements)).T)


def launch_structured(
    kind: str, points: Sequence[Buffer], counts: tuple[int, ...], result: Buffer, device: Device
) -> None:
    """Launch the kernel for a grid that suits the device, on hexes of a GPU along columns.

    Arguments
    ---------
    kind: ``"hex"`` or ``"quad"``.
    points: x, y, z (n,) each of the nodes.
    counts: of nodes along u, v and w.
    result: a number for each element.
    """
    launched = structure.element_counts(counts)[::-1]
    if kind == "hex" and not device.cores:
        n_w, n_v, n_u = launched
        items = (-(-n_w // COLUMN_CELLS), -(-n_v // (2 * TILE_ROWS)) * -(-n_u // TILE) * TILE_ROWS * TILE)
        device.launch("quality_columns.hex_scaled_jacobian", items, *points, *counts, COLUMN_CELLS, result)
        return
    kernel = {"hex": "structured_quality.hex_scaled_jacobian", "quad": "quality.quad_scaled_jacobian_structured"}[kind]
    device.launch(kernel, launched, *points, *counts, result)


def launch_explicit(
    kernel: str, points: Sequence[Buffer], n_nodes: int, cells: Buffer, n_cells: int, result: Buffer, device: Device
) -> None:
    """Launch a kernel of ``quality`` over a table of nodes.

    Its gathers, which are most of its time, want the three coordinates of a node side by side.

    Arguments
    ---------
    kernel: ``"hex_scaled_jacobian"`` or another that takes ``nodes``.
    points: x, y, z (n_nodes,) each.
    cells: (n_cells, 4) or (n_cells, 8) corners.
    result: (n_cells,), or as many planes of them as there are corners.
    """
    nodes = device.empty(4 * n_nodes)
    device.launch("quality.interleave", n_nodes, *points, n_nodes, nodes)
    device.launch(f"quality.{kernel}", n_cells, nodes, cells, n_cells, result)


def _explicit(mesh: Mesh, kernel: str, n_planes: int, device: Device) -> Buffer:
    result = device.empty(n_planes * mesh.n_elements)
    points, cells = _put_points(mesh, device), device.put(_corner_cells(mesh))
    launch_explicit(kernel, points, mesh.n_nodes, cells, mesh.n_elements, result, device)
    return result


def _kind(mesh: Mesh) -> str:
    return mesh.element_type.rstrip("0123456789")


def _corner_cells(mesh: Mesh) -> NDArray[np.int32]:
    return np.ascontiguousarray(mesh.cells[:, : mesh.element.n_corners])


def _put_points(mesh: Mesh, device: Device, corners: NDArray[Any] | None = None) -> list[Buffer]:
    """Coordinates, of all nodes or some; from their middle where float32 then keeps more of their digits."""
    planes = mesh.planes if corners is None else mesh.planes[:, corners]
    with np.errstate(invalid="ignore", over="ignore"):  # opposite infinities
        middle = planes.mean(axis=1)
    if not np.isfinite(middle).all():  # a node that is nowhere shows here, at little cost
        mesh.check_finite()
    if planes.dtype.itemsize > device.real.itemsize:
        planes = planes - middle[:, None]
    return [device.put(plane) for plane in planes]


@dataclass(frozen=True, eq=False)
class Quality:
    """Summary of the scaled Jacobians of a mesh.

    Attributes
    ----------
    n_elements: number of elements.
    min, mean: of the scaled Jacobian.
    inverted: number of elements with 0 or less.
    fraction_below_0_1, fraction_below_0_2: share of elements below, inverted ones included.
    fraction_above_0_5: share of elements above.
    edges: (11,) of ten equal bins over 0..1, as in the paper's Figs. 6 to 9.
    counts: (10,) elements per bin, each without its lower and with its upper edge; with ``inverted`` they sum to
        ``n_elements``.
    worst: element numbers of the worst, worst first.
    worst_values: their scaled Jacobian.
    worst_centroids_mm: (w, 3) the mean of their corners, LPS.
    """

    n_elements: int
    min: float
    mean: float
    inverted: int
    fraction_below_0_1: float
    fraction_below_0_2: float
    fraction_above_0_5: float
    edges: NDArray[np.float64]
    counts: NDArray[np.int64]
    worst: NDArray[np.int64]
    worst_values: NDArray[np.float64]
    worst_centroids_mm: NDArray[np.float64]

    __repr__ = brief

    def _repr_html_(self) -> str:
        return str(shown("quality_html", self))

    def check(self, instead: str = OTHER_WAYS) -> None:
        """Raise MeshError where an element is inverted: no solver takes it; ``instead`` is what may be tried."""
        if self.inverted:
            x, y, z = self.worst_centroids_mm[0]
            raise MeshError(
                f"{self.inverted:,} of {self.n_elements:,} elements are inverted, the worst at "
                f"({x:.4g}, {y:.4g}, {z:.4g}) mm; nothing is written: try {instead}, "
                "or ask for the mesh as it is by --allow-inverted"
            )

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers and lists, for JSON."""
        rows = zip(self.worst.tolist(), self.worst_values.tolist(), self.worst_centroids_mm.tolist(), strict=True)
        return {
            "min": self.min,
            "mean": self.mean,
            "fraction_above_0.5": self.fraction_above_0_5,
            "fraction_below_0.1": self.fraction_below_0_1,
            "fraction_below_0.2": self.fraction_below_0_2,
            "inverted": self.inverted,
            "histogram": {"edges": self.edges.tolist(), "counts": self.counts.tolist()},
            "worst": [{"element": e, "scaled_jacobian": v, "centroid_mm": c} for e, v, c in rows],
        }


def summarise(mesh: Mesh, values: NDArray[Any], worst: int = WORST) -> Quality:
    """Summarise scaled Jacobians (m,) of a mesh, and say where its worst elements are.

    An element that has no value, NaN, counts as inverted, with -1.

    Raises
    ------
    InputError where there is not one value per element, or no element.
    """
    if values.shape != (mesh.n_elements,) or values.size == 0:
        raise InputError(f"expected a scaled Jacobian for each of {mesh.n_elements} elements, got {values.shape}")
    if np.isnan(values.min()):
        values = np.where(np.isnan(values), values.dtype.type(-1), values)
    edges = np.arange(11) / 10
    above = _count_above(values, edges[:-1])
    at_least_0_1, at_least_0_2 = _count_above(values, np.nextafter(edges[1:3], 0))
    order = _least(values, worst)
    corners = mesh.cells_of(order)[:, : mesh.element.n_corners]
    return Quality(
        n_elements=values.size,
        min=float(values.min()),
        mean=float(values.mean(dtype=np.float64)),
        inverted=values.size - int(above[0]),
        fraction_below_0_1=float((values.size - at_least_0_1) / values.size),
        fraction_below_0_2=float((values.size - at_least_0_2) / values.size),
        fraction_above_0_5=float(above[5] / values.size),
        edges=edges,
        counts=-np.diff(above, append=0),
        worst=order,
        worst_values=values[order].astype(np.float64),
        worst_centroids_mm=mesh.points[corners].astype(np.float64).mean(axis=1),
    )


def _count_above(values: NDArray[Any], edges: NDArray[np.float64]) -> NDArray[np.int64]:
    """How many values are above each edge; edges are brought to the precision of the values, none to its other side."""
    limits = edges.astype(values.dtype)
    limits = np.where(limits > edges, np.nextafter(limits, values.dtype.type(-2)), limits)
    parts = np.split(values, range(_PART, values.size, _PART))
    return np.asarray(np.sum([[np.count_nonzero(part > limit) for limit in limits] for part in parts], axis=0))


def _least(values: NDArray[Any], count: int) -> NDArray[np.int64]:
    """Indices of the least values, least first, without sorting all of them.

    As many blocks of values have their least among the ``count`` least of blocks, and so as many values are no greater.
    """
    blocks = values[: values.size // _BLOCK * _BLOCK].reshape(-1, _BLOCK).min(axis=1)
    limit = np.partition(blocks, count - 1)[count - 1] if count < blocks.size else np.inf
    candidates = np.flatnonzero(values <= limit)
    return np.asarray(candidates[np.argsort(values[candidates], kind="stable")[:count]])


def merge(parts: Sequence[Quality], worst: int = WORST) -> Quality:
    """Summary of a mesh from those of its parts, whose elements are numbered one part after another."""
    counts = np.array([part.n_elements for part in parts])
    before = np.cumsum(counts) - counts
    share = counts / counts.sum()
    values = np.concatenate([part.worst_values for part in parts])
    order = np.argsort(values, kind="stable")[:worst]
    return Quality(
        n_elements=int(counts.sum()),
        min=float(values[order[0]]),
        mean=float(share @ [part.mean for part in parts]),
        inverted=sum(part.inverted for part in parts),
        fraction_below_0_1=float(share @ [part.fraction_below_0_1 for part in parts]),
        fraction_below_0_2=float(share @ [part.fraction_below_0_2 for part in parts]),
        fraction_above_0_5=float(share @ [part.fraction_above_0_5 for part in parts]),
        edges=parts[0].edges,
        counts=np.sum([part.counts for part in parts], axis=0),
        worst=np.concatenate([part.worst + first for part, first in zip(parts, before, strict=True)])[order],
        worst_values=values[order],
        worst_centroids_mm=np.concatenate([part.worst_centroids_mm for part in parts])[order],
    )


def assess(mesh: Mesh, device: Device | None = None) -> tuple[Mesh, Quality]:
    """Give the mesh with its element field ``scaled_jacobian``, and the summary of it.

    The device is ``open_device()`` unless told.
    """
    expect(mesh, Mesh, "sample makes one, read_mesh reads one")
    check_device(device)
    values = scaled_jacobian(mesh, device or open_device())
    return mesh.with_cell_fields({"scaled_jacobian": values}), summarise(mesh, values)
