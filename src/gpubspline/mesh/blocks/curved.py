"""Blocks curved on to their level set: hyperpatches to sample at any density, hex20 and hex27."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from gpubspline.device import Device
from gpubspline.mesh.bezier import BezierBlocks, bezier_blocks
from gpubspline.mesh.blocks.labelled import find_interfaces
from gpubspline.mesh.blocks.level_set import SAMPLES, LevelSet, part_of
from gpubspline.mesh.blocks.result import Blocks
from gpubspline.mesh.movable import one_level, put_level
from gpubspline.mesh.shared_lattice import SharedLattice
from gpubspline.mesh.sheets import Project, Sheet, corners_of, faces_between

Floats = NDArray[np.float64]

LEAST = 0.4
"""Least scaled Jacobian inside curved blocks: more costs distance from the surface, less gains none."""

MOST_BEND = 0.02
"""Largest correction of a sample, in elements: a kink bends more, and is no curvature."""

FAR = 1.0
"""How far, in elements, the surface is looked for."""

ASKEW, ABOUT = 4.0, 0.1
"""A normal that leads farther than so many times the distance, and this, in elements, runs along the surface."""

NEAR = 0.35
"""How far, in elements, points between bodies may go to their boundary: one farther away is that of other places."""

AROUND = 2
"""Elements round the faces between two bodies in which their boundary is kept."""

_STEPS, _BISECTIONS = 8, 4
_SLIDES = 3
"""Times that a point takes the Newton steps of the kernel: enough from a chord's middle."""


def curve(made: Blocks, *, degree: int = 2, floor: float = LEAST, between: bool = True, device: Device) -> BezierBlocks:
    """Make each hex a Bezier hyperpatch whose outer faces follow the level set, as far as no block folds.

    Faces between bodies follow their boundary. Corners that were drawn out to tips of the region stay there, and so do
    those between bodies where three or more of them meet.

    Arguments
    ---------
    degree: 1 to 3.
    floor: least scaled Jacobian inside a block; see ``bezier_blocks``.
    between: curve faces between bodies, too.
    """
    within = list(interfaces(made, device)) if between else []
    return bezier_blocks(made.mesh, onto(made.surface(), device), degree, floor, made.tips, within)


def interfaces(made: Blocks, device: Device) -> Iterator[Sheet]:
    """Faces between each two bodies that touch, onto the zero of half the difference of their distances.

    Corners stay where three bodies meet, which no node is held to exactly.
    """
    if len(made.parts) < 2:
        return
    owner = np.zeros(made.mesh.n_elements, dtype=np.int64)
    for number, name in enumerate(made.parts, start=1):
        owner[made.mesh.element_sets[name]] = number
    lattice = SharedLattice(made.mesh.cells.astype(np.int64), made.mesh.n_nodes, 1)
    faces = faces_between(lattice, owner)
    corners = {pair: np.unique(corners_of(lattice, those)) for pair, those in faces.items()}
    junctions = np.flatnonzero(np.bincount(np.concatenate(list(corners.values()))) > 1)
    parts = [part_of(made.level, part, device=device) for part in made.parts.values()]
    at = made.level.in_lattice(made.mesh.points)
    for pair, between in find_interfaces(parts, faces, made.core, unbiased):
        level = _cropped(replace(made.level, phi=between.held, region=None), at[corners[pair]])
        yield Sheet(faces[pair], _no_farther(onto_zero(level, device), NEAR * level.size_mm), junctions)


def _no_farther(project: Project, most_mm: float) -> Project:
    """Leave points where they are that would go farther."""

    def near(points: Floats, normals: Floats) -> Floats:
        there = project(points, normals)
        return np.where(np.linalg.norm(there - points, axis=1, keepdims=True) <= most_mm, there, points)

    return near


def _cropped(level: LevelSet, points: Floats) -> LevelSet:
    """The part of a level set round points (n, 3), lattice coordinates."""
    low = np.maximum(np.floor(points.min(axis=0)).astype(int) - AROUND, 0)
    high = np.ceil(points.max(axis=0)).astype(int) + AROUND
    part = tuple(slice(SAMPLES * a, SAMPLES * b + 1) for a, b in zip(low[::-1], high[::-1], strict=True))
    to_mm = level.to_mm.copy()
    to_mm[:3, 3] = level.in_mm(low[None])[0]
    return replace(level, phi=level.phi[part].copy(), to_mm=to_mm)


def onto(level: LevelSet, device: Device) -> Project:
    """Projection of points (n, 3), mm, on to the zero level: along normals (n, 3), then nearest."""
    return onto_zero(replace(level, phi=unbiased(level.phi)), device)


def onto_zero(level: LevelSet, device: Device) -> Project:
    """Do the same where the samples are right on average as they are."""
    phi = level.phi
    held = put_level(phi, np.hstack([np.eye(3) * SAMPLES, np.zeros((3, 1))]), device)

    def project(points: Floats, normals: Floats) -> Floats:
        at = along(phi, level.in_lattice(points), normals @ level.axes)
        count = len(at)
        x = device.put(np.ascontiguousarray(at.T))
        slack, levels = device.put(np.zeros(count)), device.put(one_level(count))
        normal = device.empty(3 * count)
        for _ in range(_SLIDES):
            device.launch("optimize.slide", count, x, count, slack, levels, *held.arguments, x, normal)
        return level.in_mm(np.array(device.get(x)).reshape(3, -1).T)

    return project


def along(phi: NDArray[np.float32], at: Floats, normals: Floats) -> Floats:
    """Go from points (n, 3), lattice coordinates, to the zero level: outward from inside, inward from outside.

    Where the distance has no slope, as midway between two sheets, its gradient leads nowhere. Points that meet no zero
    within ``FAR``, or one that is much farther than the nearest, stay.
    """

    def value(points: Floats) -> Floats:
        return np.asarray(map_coordinates(phi, points[:, ::-1].T * SAMPLES, order=1, mode="nearest"))

    start = value(at)
    way = normals * -np.sign(start)[:, None]
    low, high, found = np.zeros(len(at)), np.zeros(len(at)), np.zeros(len(at), dtype=bool)
    for step in np.arange(1, _STEPS + 1) * FAR / _STEPS:
        rest = np.flatnonzero(~found)
        crossed = rest[value(at[rest] + step * way[rest]) * start[rest] <= 0]
        low[crossed], high[crossed], found[crossed] = step - FAR / _STEPS, step, True
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        beyond = value(at + middle[:, None] * way) * start <= 0
        low, high = np.where(beyond, low, middle), np.where(beyond, middle, high)
    far = 0.5 * (low + high)
    return np.asarray(at + np.where(found & (far <= ASKEW * np.abs(start) + ABOUT), far, 0.0)[:, None] * way)


def unbiased(phi: NDArray[np.float32]) -> NDArray[np.float32]:
    """Samples whose trilinear interpolant is right on average: that of a bent field lies a twelfth of its bend off."""
    bend = np.zeros_like(phi)
    for axis in range(3):
        line, out = np.moveaxis(phi, axis, 0), np.moveaxis(bend, axis, 0)
        out[1:-1] += line[2:] - 2 * line[1:-1] + line[:-2]
    return np.asarray(phi - np.clip(bend / np.float32(12), -MOST_BEND, MOST_BEND), dtype=np.float32)
