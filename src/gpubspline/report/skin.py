"""The quadrilaterals that a picture of a mesh shows: the skin of all of it, and of the half behind a cut."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.mesh import structure
from gpubspline.mesh.mesh import Mesh
from gpubspline.report.camera import Floats
from gpubspline.report.painter import Shell

Integers = NDArray[Any]
Ranges = list[tuple[int, int]]


def skin(mesh: Mesh, field: str) -> Shell:
    """Skin of a whole mesh with a nodal or element field: its outer faces, or the quads of a quad mesh themselves."""
    if mesh.element.dimension == 2:
        return _shell(mesh, field, mesh.cells[:, :4], np.arange(mesh.n_elements))
    if mesh.structure is not None:
        return _block_skin(mesh, field, [(0, n) for n in structure.element_counts(mesh.structure)])
    return _cells_skin(mesh, field, np.arange(mesh.n_elements))


def cut_skin(mesh: Mesh, field: str, viewer: Floats, axis: int | None = None) -> tuple[Shell, Floats]:
    """Skin of half a hex mesh, cut through its middle along its greatest section.

    Arguments
    ---------
    mesh: hexes; a structured mesh is cut between two layers of elements, another one across an axis of the patient.
    field: nodal or element field.
    viewer: (3,) direction of the viewer in LPS; the half on that side is taken away.
    axis: 0, 1, 2 to cut across x, y, z instead.

    Returns
    -------
    The skin of the other half, and the unit normal (3,) of the section, to the viewer's side.
    """
    if axis is not None or mesh.structure is None:
        return _plane_cut(mesh, field, viewer, int(np.argmin(np.ptp(mesh.points, axis=0))) if axis is None else axis)
    counts = structure.element_counts(mesh.structure)
    sections = [_section(mesh, axis) for axis in range(3)]
    axis = int(np.argmax([np.linalg.norm(section) for section in sections]))
    normal = sections[axis] / max(float(np.linalg.norm(sections[axis])), 1e-300)  # toward growing u, v or w
    ranges, half = [(0, n) for n in counts], max(counts[axis] // 2, 1)
    ranges[axis] = (0, half) if normal @ viewer >= 0 else (counts[axis] - half, counts[axis])
    return _block_skin(mesh, field, ranges), normal if normal @ viewer >= 0 else -normal


def _section(mesh: Mesh, axis: int) -> Floats:
    """Area vector (3,), mm2, of the layer boundary at the middle of a parameter, toward its growth."""
    counts = structure.element_counts(mesh.structure or ())
    ranges = [(0, n) for n in counts]
    ranges[axis] = (counts[axis] // 2, counts[axis] // 2 + 1)
    faces = mesh.cells_of(_elements(counts, ranges))[:, mesh.element.side_corners["uvw"[axis] + "0"]]
    corners = mesh.points[faces].astype(np.float64)
    inward = np.cross(corners[:, 3] - corners[:, 1], corners[:, 2] - corners[:, 0])
    return np.asarray(inward.sum(axis=0) / 2)


def _block_skin(mesh: Mesh, field: str, ranges: Ranges) -> Shell:
    """Skin of a block of a structured mesh, of elements ``first`` up to and without ``last`` per direction."""
    counts = structure.element_counts(mesh.structure or ())
    faces, owners = [], []
    for name, corners in mesh.element.side_corners.items():
        axis, layer = "uvw".index(name[0]), list(ranges)
        first, last = ranges[axis]
        layer[axis] = (first, first + 1) if name[1] == "0" else (last - 1, last)
        owners.append(_elements(counts, layer))
        faces.append(mesh.cells_of(owners[-1])[:, corners])
    return _shell(mesh, field, np.concatenate(faces), np.concatenate(owners))


def _elements(counts: tuple[int, ...], ranges: Ranges) -> Integers:
    """Element numbers of a block."""
    grid = np.meshgrid(*(np.arange(*each) for each in ranges), indexing="ij")
    return np.asarray(np.ravel_multi_index([index.ravel(order="F") for index in grid], counts, order="F"))


def _plane_cut(mesh: Mesh, field: str, viewer: Floats, axis: int) -> tuple[Shell, Floats]:
    """Cut across an axis of the patient, between elements."""
    normal = np.eye(3)[axis] * (1.0 if viewer[axis] >= 0 else -1.0)
    height = mesh.points[mesh.cells[:, : mesh.element.n_corners]].mean(axis=1) @ normal
    middle = (height.min() + height.max()) / 2
    return _cells_skin(mesh, field, np.flatnonzero(height <= middle)), normal


def _cells_skin(mesh: Mesh, field: str, elements: Integers) -> Shell:
    """Skin of any elements: the faces that only one of them has."""
    sides = list(mesh.element.side_corners.values())
    faces = mesh.cells_of(elements)[:, sides].reshape(-1, 4)
    keys = np.sort(faces, axis=1).astype(np.int64)
    order = np.lexsort(keys.T)
    same = np.all(keys[order[1:]] == keys[order[:-1]], axis=1)
    shared = np.zeros(len(faces), dtype=bool)
    shared[order[1:][same]] = shared[order[:-1][same]] = True
    return _shell(mesh, field, faces[~shared], np.repeat(elements, len(sides))[~shared])


def _shell(mesh: Mesh, field: str, faces: Integers, owners: Integers) -> Shell:
    corners = np.asarray(mesh.points[faces], dtype=np.float64)
    if field in mesh.fields:
        return Shell(corners, np.asarray(mesh.fields[field][faces], dtype=np.float64))
    return Shell(corners, np.repeat(np.asarray(mesh.cell_fields[field][owners], dtype=np.float64)[:, None], 4, axis=1))
