"""Meshes of blocks made finer: each hex a Bezier solid that is sampled, what comes out poor mended on the surface."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gpubspline.device import Device
from gpubspline.errors import InputError
from gpubspline.mesh.blocks.chords import measure_chords
from gpubspline.mesh.blocks.curved import curve, unbiased
from gpubspline.mesh.blocks.grow import distance_from, off_surface
from gpubspline.mesh.blocks.level_set import ON_SURFACE, SAMPLES, Field
from gpubspline.mesh.blocks.result import Blocks, measured, sets_carried_to
from gpubspline.mesh.even import even_out
from gpubspline.mesh.floors import Effort, Placed, placed
from gpubspline.mesh.improve import improve
from gpubspline.mesh.mesh import Mesh
from gpubspline.mesh.movable import FIXED, FREE, Movable, movable, put_level
from gpubspline.mesh.neighbourhood import edge_lengths, hexes_round, neighbourhood

Floats = NDArray[np.float64]

GIVEN = 0.02
"""How much less than that of the coarse mesh the worst scaled Jacobian may be."""

RINGS = 4
"""Rings of fine hexes round poor ones that move too."""

SHORTEST, LONGEST = 0.3, 2.0
"""Edges are to keep their lengths within these, in those of fine elements."""


def refine(made: Blocks, times: int, *, device: Device) -> Blocks:
    """Divide each hex of a mesh of blocks into ``times`` along each of its directions.

    Nodes of the surface follow the level set that the coarse mesh follows, and the tips that it was drawn out to; they
    lie outside by what the faces between them cut off. The worst hex is as good as the coarse mesh's but for ``GIVEN``,
    as far as nodes on that surface allow: poor ones and those round them are improved as the coarse ones were. Faces
    between bodies are divided as they are: their nodes cannot move, and on a curved boundary some hexes would be poor.

    Raises
    ------
    InputError where ``times`` is below 1.
    """
    if times < 1:
        raise InputError(f"expected to divide blocks into 1 or more, got {times}")
    if times == 1:
        return made
    surface = made.surface()
    mesh = curve(made, between=False, device=device).sample(times, exact=True)
    sets = sets_carried_to(mesh, made.mesh)
    points, phi = surface.in_lattice(mesh.points), unbiased(surface.phi)
    off = distance_from(phi, points)
    phi = _moved_out(phi, points, mesh.boundary(), off)
    slack = _slack(sets, times * off)
    slack[made.tips] = FIXED  # nodes of the coarse mesh come first
    hexes = _held(mesh, times * points, times * phi, slack, times, device)
    best = even_out(hexes, _mended(hexes, slack, times * points, made.report.min_scaled_jacobian - GIVEN))
    points = np.array(device.get(best.x)).reshape(3, -1).T / times
    mesh = replace(mesh, points=surface.in_mm(points).astype(made.mesh.points.dtype), node_sets=sets)
    report = replace(
        made.report,
        size_mm=made.report.size_mm / times,
        min_scaled_jacobian=best.least,
        off_surface_nodes=off_surface(points[sets["surface"]], phi, surface),
        bodies=measured(made.report.bodies, mesh),
    )
    return replace(made, mesh=mesh, report=report)


def _moved_out(phi: Field, points: Floats, faces: NDArray[np.int32], off: Floats) -> Field:
    """Move a level set out by what faces (f, 4) cut off whose nodes (n, 3) are on it: not ``off`` (n,) it."""
    on = (off[faces] <= ON_SURFACE).all(axis=1)
    return measure_chords(points, faces[on], phi).added_to(phi)


def _held(mesh: Mesh, points: Floats, phi: Field, slack: Floats, times: int, device: Device) -> Movable:
    """Fine hexes on a level set, points (n, 3) and distances in fine elements; edges are to be as long as they are."""
    level = put_level(phi, np.hstack([np.eye(3) * SAMPLES / times, np.zeros((3, 1))]), device)
    lengths = np.clip(edge_lengths(points, mesh.cells).mean(axis=2), SHORTEST, LONGEST)
    return movable(mesh.cells, mesh.n_nodes, slack, level, device, 2 * np.log(lengths))


def _mended(hexes: Movable, slack: Floats, points: Floats, floor: float) -> Placed:
    """Points (n, 3) slid on to what holds them, with hexes below the floor improved."""
    device = hexes.device
    x = device.put(points.T)
    hexes.slide(x)
    poor = hexes.scaled_jacobian(x) < floor
    if not poor.any():
        return placed(hexes, x, slack)
    points = np.array(device.get(x)).reshape(3, -1).T
    near = neighbourhood(hexes, slack, hexes_round(hexes, poor, RINGS))
    best = improve(near.hexes, near.colours, device.put(points[near.nodes].T), near.slack, Effort(goal=floor))
    points[near.nodes] = np.array(device.get(best.x)).reshape(3, -1).T
    return placed(hexes, device.put(points.T), slack)


def _slack(sets: dict[str, NDArray[np.int32]], off: Floats) -> Floats:
    """(n,) as ``movable`` takes it: as far ``off`` (n,) the surface, or between bodies, as they are, else free."""
    slack, surface = np.full(len(off), FREE), sets["surface"]
    slack[surface] = np.where(off[surface] > ON_SURFACE, off[surface], 0.0)
    for name, nodes in sets.items():
        if name != "surface":
            slack[nodes] = FIXED
    return slack
