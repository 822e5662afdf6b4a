"""The faces that a page can show: those of the surface, and those laid open by cuts at a few places along each axis."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.mesh import structure
from gpubspline.mesh.mesh import Mesh

Integers = NDArray[Any]

KEPT_BELOW = (True, False, True)
"""Whether a cut along x, y, z keeps what lies below it: the side that the first view sees is taken away."""

CUTS = 24
"""Cuts along each axis, where the page can hold them."""

SURFACE_FACES, CUT_FACES = 250_000, 600_000
"""Most faces of the surface, and of all cuts together, that a page takes: about 15 MB."""


@dataclass(frozen=True, eq=False)
class Faces:
    """Faces of some elements.

    Attributes
    ----------
    nodes: (f, 4) node numbers of the corners.
    owners: (f,) element each belongs to; the one that is kept, for a face of a cut.
    """

    nodes: Integers
    owners: Integers


@dataclass(frozen=True, eq=False)
class Cut:
    """What is laid open by taking away the elements whose centroid lies beyond a plane.

    Attributes
    ----------
    axis: 0, 1, 2 for x, y, z.
    at_mm: where the plane is.
    faces: between kept and taken elements.
    """

    axis: int
    at_mm: float
    faces: Faces


def pairs(mesh: Mesh) -> tuple[Integers, Integers, Integers]:
    """Neighbours across faces: owner (p,), the number of its side (p,), and the other element (p,), -1 for none."""
    if mesh.structure is not None:
        return _structured_pairs(structure.element_counts(mesh.structure))
    sides = list(mesh.element.side_corners.values())
    faces = np.sort(mesh.cells[:, sides].reshape(-1, 4), axis=1).astype(np.int64)
    first, second = faces[:, 0] * mesh.n_nodes + faces[:, 1], faces[:, 2] * mesh.n_nodes + faces[:, 3]
    order = np.lexsort((second, first))
    same = (first[order[1:]] == first[order[:-1]]) & (second[order[1:]] == second[order[:-1]])
    one, other = order[:-1][same], order[1:][same]
    alone = np.full(len(faces), True)
    alone[one] = alone[other] = False
    outer = np.flatnonzero(alone)
    owner, n = np.concatenate([one, outer]), len(sides)
    return owner // n, owner % n, np.concatenate([other // n, np.full(len(outer), -1)])


def _structured_pairs(counts: tuple[int, ...]) -> tuple[Integers, Integers, Integers]:
    grid = np.arange(int(np.prod(counts))).reshape(counts, order="F")
    owners, sides, others = [], [], []
    for axis in range(len(counts)):
        layers = np.moveaxis(grid, axis, 0)
        for owner, other, end in ((layers[:-1], layers[1:], 1), (layers[:1], None, 0), (layers[-1:], None, 1)):
            owners.append(owner.ravel())
            sides.append(np.full(owner.size, 2 * axis + end))
            others.append(np.full(owner.size, -1) if other is None else other.ravel())
    return np.concatenate(owners), np.concatenate(sides), np.concatenate(others)


def side_faces(mesh: Mesh, elements: Integers, sides: Integers) -> Integers:
    """Node numbers (f, 4) of the corners of the given side of each given element."""
    corners = np.array(list(mesh.element.side_corners.values()))
    return np.take_along_axis(mesh.cells_of(elements), corners[sides], axis=1)


def centroids(mesh: Mesh) -> NDArray[Any]:
    """Mean of the corners of each element, (m, 3), mm."""
    cells, n_corners = mesh.cells, mesh.element.n_corners
    total = np.zeros((mesh.n_elements, 3), dtype=np.float32)
    for corner in range(n_corners):
        total += mesh.points[cells[:, corner]]
    return total / n_corners


def surface_and_cuts(mesh: Mesh) -> tuple[Faces, list[Cut], str]:
    """Surface and cuts of a mesh, as many as a page holds, and what to say where faces were left out.

    The quads of a quad mesh are its surface; it has no cuts.
    """
    if mesh.element.dimension == 2:
        surface, said = _thinned(Faces(mesh.cells[:, :4], np.arange(mesh.n_elements)), mesh)
        return surface, [], said
    owner, side, other = pairs(mesh)
    outer = other < 0
    surface = Faces(side_faces(mesh, owner[outer], side[outer]), owner[outer])
    surface, said = _thinned(surface, mesh)
    middle = centroids(mesh)
    inner = owner[~outer], side[~outer], other[~outer]
    count, cuts = CUTS, _cuts(mesh, middle, inner, CUTS)
    while count > 3 and sum(len(cut.faces.owners) for cut in cuts) > CUT_FACES:
        count = max(3, count * 2 // 3)
        cuts = _cuts(mesh, middle, inner, count)
    of = f"Of {mesh.n_elements:,} elements this page holds the" if count < CUTS else "The page holds the"
    return surface, cuts, f"{of} surface and cuts at {count} places along each axis. {said}".strip()


def _cuts(mesh: Mesh, middle: NDArray[Any], inner: tuple[Integers, Integers, Integers], count: int) -> list[Cut]:
    return [cut for axis in range(3) for cut in _cuts_along(mesh, axis, middle[:, axis], inner, count)]


def _cuts_along(
    mesh: Mesh, axis: int, height: NDArray[Any], inner: tuple[Integers, Integers, Integers], count: int
) -> list[Cut]:
    """Cuts across one axis, evenly between its ends; a pair is open where its elements lie on both sides of one."""
    owner, side, other = inner
    places = np.linspace(height.min(), height.max(), count + 2)[1:-1]
    level = np.searchsorted(places, height, side="left")  # how many places lie below
    below, above = np.minimum(level[owner], level[other]), np.maximum(level[owner], level[other])
    crossing = np.flatnonzero(below < above)
    times = above[crossing] - below[crossing]
    pair = np.repeat(crossing, times)
    place = np.repeat(below[crossing], times) + np.arange(len(pair)) - np.repeat(np.cumsum(times) - times, times)
    order = np.argsort(place, kind="stable")
    faces = side_faces(mesh, owner[pair], side[pair])
    owner_kept = (level[owner[pair]] <= place) == KEPT_BELOW[axis]
    kept = np.where(owner_kept, owner[pair], other[pair])
    ends = np.searchsorted(place[order], np.arange(count + 1))
    parts = [order[ends[i] : ends[i + 1]] for i in range(count)]
    return [Cut(axis, float(places[i]), Faces(faces[part], kept[part])) for i, part in enumerate(parts)]


def _thinned(faces: Faces, mesh: Mesh) -> tuple[Faces, str]:
    """Join nodes of ever larger cubes until the faces are few enough, and drop those that collapse."""
    if len(faces.owners) <= SURFACE_FACES:
        return faces, ""
    points = mesh.points[faces.nodes.ravel()].astype(np.float64)
    low, thinned = points.min(axis=0), faces
    size = float(np.linalg.norm(points[2::4] - points[0::4], axis=1).mean())
    while len(thinned.owners) > SURFACE_FACES:
        size *= 1.3
        _, first, cube = np.unique(np.floor((points - low) / size), axis=0, return_index=True, return_inverse=True)
        nodes = faces.nodes.ravel()[first][cube.reshape(-1)].reshape(-1, 4)
        distinct = 1 + np.count_nonzero(np.diff(np.sort(nodes, axis=1), axis=1), axis=1)
        kept = np.flatnonzero(distinct >= 3)
        _, once = np.unique(np.sort(nodes[kept], axis=1), axis=0, return_index=True)
        kept = kept[np.sort(once)]
        thinned = Faces(nodes[kept], faces.owners[kept])
    shown, whole = len(thinned.owners), len(faces.owners)
    return thinned, f"The surface is thinned from {whole:,} to {shown:,} faces, about {size:.2g} mm wide."
