"""Surfaces that curved hexes follow: the outer one of a mesh, and those between its parts.

A sheet is made of faces of hexes. What lies on its faces, their edges and corners is brought onto it; where two sheets
meet, onto each in turn, which ends on the curve of both.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.mesh.shared_lattice import FACES, SharedLattice

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Project = Callable[[Floats, Floats], Floats]
"""Moves points (n, 3), mm, near a surface onto it; with the unit normals (n, 3) of the faces there."""

TURNS = 3
"""Times that points where sheets meet are brought onto each."""


@dataclass(frozen=True, eq=False)
class Sheet:
    """Faces of hexes that are to follow one surface.

    Attributes
    ----------
    faces: (f, 2) hex and which of its ``FACES``, outward; of a sheet within a mesh those of the hexes on one side.
    project: onto the surface.
    stay: corners that are off it on purpose; what lies near them goes to it the less the nearer.
    """

    faces: Integers
    project: Project
    stay: NDArray[Any]


@dataclass(frozen=True, eq=False)
class OnSheet:
    """Points of a lattice that are on a sheet.

    Attributes
    ----------
    numbers: (p,) sorted, of the points.
    normals: (p, 3) unit normals there, of straight hexes.
    share: (p,) which part of its way each goes.
    project: onto the surface.
    """

    numbers: Integers
    normals: Floats
    share: Floats
    project: Project

    def within(self, first: int, stop: int) -> "OnSheet":
        """Those numbered from ``first`` to before ``stop``, numbered from 0."""
        part = slice(*np.searchsorted(self.numbers, [first, stop]))
        return OnSheet(self.numbers[part] - first, self.normals[part], self.share[part], self.project)

    def among(self, wanted: NDArray[np.bool_]) -> "OnSheet":
        """Some of them: (p,)."""
        return OnSheet(self.numbers[wanted], self.normals[wanted], self.share[wanted], self.project)


def outer_faces(lattice: SharedLattice) -> Integers:
    """(f, 2) faces that one hex alone has."""
    count, number = lattice.faces
    return np.argwhere(count[number] == 1)


def faces_between(lattice: SharedLattice, owner: NDArray[Any]) -> dict[tuple[int, int], Integers]:
    """(f, 2) faces of one owner's hexes towards another's, by owners (a, b), a < b, that touch; ``owner`` is (m,)."""
    count, number = lattice.faces
    low, high = np.full(len(count), np.iinfo(np.int64).max), np.full(len(count), -1)
    np.minimum.at(low, number, owner[:, None])
    np.maximum.at(high, number, owner[:, None])
    faces = np.argwhere((low < high)[number] & (low[number] == owner[:, None]))
    ends = np.stack([owner[faces[:, 0]], high[number[tuple(faces.T)]]], axis=1)
    return {(int(a), int(b)): faces[(ends == (a, b)).all(axis=1)] for a, b in np.unique(ends, axis=0)}


def corners_of(lattice: SharedLattice, faces: Integers) -> Integers:
    """(f, 2, 2) corners of faces (f, 2), along the other two axes in turn."""
    return _on_faces(lattice.corners, faces, 1)


def _on_faces(numbers: Integers, faces: Integers, last: int) -> Integers:
    """Of numbers (m, last + 1, last + 1, last + 1) those (f, last + 1, last + 1) on faces (f, 2)."""
    found = np.empty((len(faces), last + 1, last + 1), dtype=np.int64)
    for number, (axis, side) in enumerate(FACES):
        some = faces[:, 1] == number
        found[some] = np.take(numbers[faces[some, 0]], side * last, axis=1 + axis)
    return found


def laid_on(lattice: SharedLattice, corners: Floats, faces: Integers) -> tuple[Integers, Floats]:
    """Sorted numbers (p,) of a lattice's points on faces (f, 2) of straight hexes, and outward unit normals (p, 3)."""
    d, quads = lattice.degree, corners_of(lattice, faces)
    outward = np.array([(1, -1, 1)[axis] * (1 if side else -1) for axis, side in FACES])  # u x w looks against v
    diagonals = corners[quads[:, 1, 1]] - corners[quads[:, 0, 0]], corners[quads[:, 0, 1]] - corners[quads[:, 1, 0]]
    at_corners = np.zeros((lattice.n_corners, 3))
    np.add.at(at_corners, quads, (outward[faces[:, 1], None] * np.cross(*diagonals))[:, None, None])
    along = np.stack([1 - np.linspace(0, 1, d + 1), np.linspace(0, 1, d + 1)], axis=1)
    normals = np.einsum("ai,bj,fijx->fabx", along, along, _unit(at_corners)[quads])
    numbers, first = np.unique(_on_faces(lattice.numbers, faces, d), return_index=True)
    return numbers, _unit(normals.reshape(-1, 3)[first])


def ways(sheets: Sequence[OnSheet], points: Floats) -> Floats:
    """How points (n, 3) of a lattice go (n, 3) to the sheets that they are on; 0 for those on none."""
    at = points.copy()
    for sheet in sheets:
        _bring(at, sheet)
    shared = np.bincount(np.concatenate([sheet.numbers for sheet in sheets]), minlength=len(points)) > 1
    meeting = [sheet.among(shared[sheet.numbers] & (sheet.share == 1)) for sheet in sheets]
    for _ in range(TURNS - 1):
        for sheet in meeting:
            _bring(at, sheet)
    return np.asarray(at - points)


def _bring(at: Floats, sheet: OnSheet) -> None:
    if sheet.numbers.size:
        before = at[sheet.numbers]
        at[sheet.numbers] += sheet.share[:, None] * (sheet.project(before, sheet.normals) - before)


def _unit(vectors: Floats) -> Floats:
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors / np.where(lengths > 0, lengths, 1.0))
