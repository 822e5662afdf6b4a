"""Scaled Jacobian of hexes.

Floors, an element: structured, 3 coordinates of the one node that is new to it read and one value written, 16 bytes;
explicit, 8 node numbers more, 48 bytes. Operations: 12 edges of 3 differences, 5 for the square and a reciprocal root,
8 determinants of 19, which lengths are brought into last, 7 minima, about 270, which on a CPU weigh more than the
bytes. A structured grid shares edges between neighbours: 3 an element would be enough, about 130 operations; OpenCL's
rows share along u and make 8, with 4 cross products instead of 8, about 180. Held against ``moving``.

A core of Zen 5 does 64 operations a cycle, so that 16 elements of a grid could take 45 cycles. They take 90, whether or
not they lie in its caches, and as many with roots by estimate and Newton's method: what waits for a root fills the
queues of the core, which thus runs three instructions a cycle. Where edges were divided by their lengths first, longer
chains waited and it took 115.

Where nodes have numbers, their three planes are brought side by side first, so that a node is one load; that is in the
time. On one core of Zen 5 by PoCL an element takes 0.8 ns for that and 7 ns for the rest, of which 1.5 ns turn eight
nodes into lanes and 2.8 ns are square roots and divisions; one of a structured grid takes 1.4 ns. VTK runs on one
thread, with 110 to 120 ns an element, ours on all cores.
"""

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.bench.measure import Peer, Place, Row, check, peer, time_beside
from gpubspline.bench.recorder import Recorder
from gpubspline.mesh.mesh import Mesh
from gpubspline.mesh.quality import scaled_jacobian

STRUCTURED = {"full": [200], "quick": [200], "tiny": [10]}  # nodes a direction
EXPLICIT = {"full": [201], "quick": [201], "tiny": [10]}
FAST = [512, 700]
ROUNDING = 3e-7
"""For each node along an edge of the grid: coordinates grow with it, their differences do not."""
BYTES = {"quality-structured": 16, "quality-explicit": 48}
NEIGHBOURS = np.array([(1, 3, 4), (2, 0, 5), (3, 1, 6), (0, 2, 7), (7, 5, 0), (4, 6, 1), (5, 7, 2), (6, 4, 3)])
"""Of each vertex of a hex, in the order of a right-handed corner."""


def jittered(n: int) -> Mesh:
    """n x n x n nodes a millimetre apart, each moved by up to a fifth of it: no element is inverted."""
    rng, line = np.random.default_rng(3), np.arange(n, dtype=np.float32)
    planes = rng.uniform(-0.2, 0.2, (3, n, n, n)).astype(np.float32)
    for plane, along in zip(planes, (line, line[:, None], line[:, None, None]), strict=True):
        plane += along
    return Mesh(planes.reshape(3, -1).T, "hex8", structure=(n, n, n))


def structured(place: Place) -> Iterator[Row]:
    """Time a grid, whose connectivity is implied."""
    for n in STRUCTURED[place.scale] + FAST * (place.fast and place.scale != "tiny"):
        mesh = jittered(n)
        yield _row(place, "quality-structured", f"{n}x{n}x{n} nodes", mesh, partial(vtk_quality, mesh, explicit=False))


def explicit(place: Place) -> Iterator[Row]:
    """Time a table of node numbers."""
    for n in EXPLICIT[place.scale]:
        grid = jittered(n)
        mesh = Mesh(grid.points, "hex8", connectivity=grid.cells)
        size = f"{mesh.n_elements:,} elements"
        yield _row(place, "quality-explicit", size, mesh, partial(vtk_quality, mesh, explicit=True))


def _row(place: Place, name: str, size: str, mesh: Mesh, vtk: Peer) -> Row:
    recorder = Recorder(place.device)
    values = scaled_jacobian(mesh, recorder)
    some = np.random.default_rng(4).integers(0, mesh.n_elements, 1000)
    tolerance = 1e-5 + ROUNDING * float(np.cbrt(mesh.n_nodes))
    check(f"{name} by its formula", values[some], by_formula(mesh, some), tolerance)
    seconds, others = time_beside(name, recorder.replay, values, tolerance, {"VTK": vtk})
    floor = BYTES[name] * mesh.n_elements / place.moving
    return Row(name, size, place.device.name, seconds, mesh.n_elements, floor / seconds, others)


def by_formula(mesh: Mesh, elements: NDArray[Any]) -> NDArray[Any]:
    """Eqs 3.4 and 3.5 of the paper, in float64."""
    corners = mesh.points[mesh.cells_of(elements)].astype(np.float64)
    edges = corners[:, NEIGHBOURS] - corners[:, :, None]
    edges /= np.linalg.norm(edges, axis=-1, keepdims=True)
    return np.asarray(np.linalg.det(edges).min(axis=1))


def vtk_quality(mesh: Mesh, explicit: bool) -> tuple[Any, Any]:
    """VTK's scaled Jacobian of a grid, or of a table of node numbers."""
    pyvista = peer("pyvista")
    points = np.ascontiguousarray(mesh.points)
    if explicit:
        grid = pyvista.UnstructuredGrid({pyvista.CellType.HEXAHEDRON: mesh.cells}, points)
    else:
        grid = pyvista.StructuredGrid()
        grid.points, grid.dimensions = points, mesh.structure
    return lambda: grid.cell_quality("scaled_jacobian"), lambda judged: judged.cell_data["scaled_jacobian"]
