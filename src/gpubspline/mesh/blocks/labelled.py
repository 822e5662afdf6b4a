"""Several bodies that touch: one conforming mesh, each body an element set, interfaces between them at their boundary.

Between two bodies nodes slide on half the difference of their distances, on the surface on the distance of all bodies
together, and where three meet along the curve of both.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label

from gpubspline.ct.region import Region
from gpubspline.errors import InputError
from gpubspline.mesh.blocks.bricks import bricks_round
from gpubspline.mesh.blocks.chords import measure_chords
from gpubspline.mesh.blocks.contacts import nearest_body
from gpubspline.mesh.blocks.core import Cells, count_neighbours
from gpubspline.mesh.blocks.level_set import CLIP, SAMPLES, Field, Part, brought_back, bulged
from gpubspline.mesh.blocks.pillow import Owners, Pillowed
from gpubspline.mesh.blocks.reach import core_distance, near
from gpubspline.mesh.movable import FREE

MOST_BODIES = 60
"""Bodies round a node are bits of an integer."""

SPECK = 4
"""Cells below which a piece of a body that lies apart is none."""

JUNCTION_SLACK = 0.25
"""Farthest, in elements, that nodes are from the line or the point where three bodies or more meet."""


def check_parts(region: Region, parts: Mapping[str, Region]) -> None:
    """Raise InputError unless the parts lie on the region's grid, fill it, and do not overlap."""
    if len(parts) > MOST_BODIES:
        raise InputError(f"expected at most {MOST_BODIES} labels, got {len(parts)}")
    for name, part in parts.items():
        if part.mask.shape != region.mask.shape or not np.allclose(part.affine, region.affine):
            raise InputError(f"expected the label {name} on the region's grid, got another")
    count = np.sum([part.mask for part in parts.values()], axis=0)
    if parts and (np.any(count > 1) or np.any(region.mask & (count == 0))):
        raise InputError("expected labels that fill the region without overlap, got others")


def assign(inside: NDArray[np.bool_], means: NDArray[np.float32]) -> Owners:
    """Give each cell inside to the body it lies deepest in.

    Arguments
    ---------
    inside: (n_k, n_j, n_i) cells of all bodies together.
    means: (bodies, n_k, n_j, n_i) distance of each cell from each body, in elements.

    Returns: int8, 0 outside; specks of fewer than ``SPECK`` cells and spikes of one body into another (one neighbour or
    none) are given to the next nearest.
    """
    if len(means) == 1:
        return inside.astype(np.int8)
    ranked = np.argsort(means, axis=0, kind="stable")
    owners = np.where(inside, ranked[0] + 1, 0).astype(np.int8)
    for body in range(1, len(means) + 1):
        own = owners == body
        loose = _specks(own) | (own & (count_neighbours(own) <= 1))
        owners[loose] = (np.where(ranked[0] + 1 == body, ranked[1], ranked[0]) + 1)[loose]
    return owners


def _specks(own: Cells) -> Cells:
    """Cells of the pieces of a body that are small, but for its largest."""
    pieces, count = label(own)
    sizes = np.bincount(pieces.reshape(-1), minlength=count + 1)
    small = sizes < SPECK
    if count:
        small[0] = small[1 + int(np.argmax(sizes[1:]))] = False
    return np.asarray(small[pieces] & own)


def costs(whole: NDArray[np.float32], means: NDArray[np.float32]) -> NDArray[np.float32]:
    """(1 + bodies, ...) what it costs a cell to become outside or a body's: how far it lies on the wrong side."""
    behind = 0.5 * (means - means.min(axis=0)) + np.maximum(whole, 0)
    return np.concatenate([np.maximum(-whole, 0)[None], behind]).astype(np.float32)


@dataclass(frozen=True, eq=False)
class Held:
    """What holds the nodes of several bodies.

    Attributes
    ----------
    pairs: bodies (a, b) that touch.
    slack, levels: (n,), (2, n) as ``movable`` takes them, with the volumes of ``level_volumes``.
    junctions: bodies, and 0 for outside, that meet along a line or at a point inside; see ``level_volumes``.
    """

    pairs: tuple[tuple[int, int], ...]
    slack: NDArray[np.float64]
    levels: NDArray[np.int32]
    junctions: tuple[tuple[int, ...], ...]


def hold(hexes: Pillowed) -> Held:
    """Find which levels hold each node.

    Nodes between two owners lie on the surface between them, those of two bodies and the outside on the curve where two
    surfaces meet. Where three bodies meet a smooth line would cut faces of the lattice at straight angles: nodes may
    leave it by ``JUNCTION_SLACK``.
    """
    masks = [int(mask) for mask in np.unique(hexes.bodies[hexes.n_core :])]
    owners_of = {mask: tuple(owner for owner in range(MOST_BODIES) if mask >> owner & 1) for mask in masks}
    pairs = sorted({pair for owners in owners_of.values() for pair in combinations(owners, 2) if pair[0] > 0})
    junctions = tuple(owners for owners in owners_of.values() if len(owners) - (owners[0] == 0) > 2)
    number = {owners: 1 + place for place, owners in enumerate((*pairs, *junctions))}
    slack = np.where(np.arange(hexes.n_nodes) < hexes.n_core, FREE, 0.0)
    levels = np.stack([np.zeros(hexes.n_nodes, dtype=np.int32), np.full(hexes.n_nodes, -1, dtype=np.int32)])
    for mask, owners in owners_of.items():
        at = np.flatnonzero(hexes.bodies == mask)
        if owners in junctions:
            levels[0, at], slack[at] = number[owners], JUNCTION_SLACK
        elif owners[0] > 0:
            levels[0, at] = number[owners]
        elif len(owners) == 3:
            levels[1, at] = number[owners[1:]]
    return Held(tuple(pairs), slack, levels, junctions)


@dataclass(frozen=True, eq=False)
class Interface:
    """What lies between two bodies.

    Attributes
    ----------
    phi: half the difference of their distances: its zero is their boundary.
    held: what nodes are held by: bulged, and no farther than the cells of both reach.
    """

    phi: Field
    held: Field


Interfaces = dict[tuple[int, int], Interface]


def find_interfaces(
    parts: Sequence[Part],
    pairs: Iterable[tuple[int, int]],
    owners: Cells | Owners,
    moved: Callable[[Field], Field] = bulged,
    *,
    clamp: bool = True,
) -> Iterator[tuple[tuple[int, int], Interface]]:
    """Find what lies between each pair of bodies that touch.

    ``moved``: what nodes are held by instead. ``clamp``: hold them near the cells, without which those of thin bodies
    are drawn to other sheets.
    """
    pairs = list(pairs)
    own = {body: core_distance(owners == body).field for body in {body for pair in pairs for body in pair}}
    for a, b in pairs:
        one, other = parts[a - 1], parts[b - 1]
        bricks = bricks_round(one.phi, CLIP).joined(bricks_round(other.phi, CLIP))
        phi, raw = 0.5 * (one.phi - other.phi), 0.5 * (one.raw - other.raw)
        bricks.put(brought_back(bricks, *(bricks.of(field, -CLIP, CLIP) for field in (phi, raw))), phi)
        yield (a, b), Interface(phi, near(moved(phi), 0.5 * (own[a] - own[b])) if clamp else moved(phi))


def straightened(interfaces: Interfaces, hexes: Pillowed, points: NDArray[Any]) -> Interfaces:
    """Move what holds nodes (n, 3), lattice coordinates, by how far the faces between them lie from each boundary."""
    moved: Interfaces = {}
    for pair, interface in interfaces.items():
        faces = hexes.interfaces[(hexes.sides == pair).all(axis=1)]
        if len(faces):  # bodies may touch at edges alone
            interface = replace(interface, held=measure_chords(points, faces, interface.phi).added_to(interface.held))
        moved[pair] = interface
    return moved


def body_volumes(phi: Field, parts: Mapping[str, Part]) -> dict[str, float]:
    """Volume, in elements, of each body within the zero level of all: what lies deepest in it, not smoothed."""
    owners = nearest_body(phi, [part.raw for part in parts.values()]) if parts else np.zeros(1, dtype=np.int8)
    counts = np.bincount(owners.reshape(-1), minlength=len(parts) + 1)[1:] / SAMPLES**3
    return dict(zip(parts, counts.tolist(), strict=True))


def level_volumes(whole: Field, interfaces: Interfaces, held: Held) -> list[Field]:
    """Distances that hold nodes: of the whole, between each pair, and from the line or point of each junction."""
    between = {pair: interface.held for pair, interface in interfaces.items()}
    volumes = [whole, *between.values()]
    for owners in held.junctions:
        bodies = [owner for owner in owners if owner > 0]
        squared = sum(between[pair] ** 2 for pair in pairwise(bodies)) + (whole**2 if owners[0] == 0 else 0)
        volumes.append(np.sqrt(squared))
    return volumes


def element_sets(hexes: Pillowed, names: tuple[str, ...]) -> dict[str, NDArray[np.int32]]:
    """Elements of each body."""
    return {name: np.flatnonzero(hexes.owners == body + 1).astype(np.int32) for body, name in enumerate(names)}


def node_sets(
    hexes: Pillowed, names: tuple[str, ...], pairs: tuple[tuple[int, int], ...]
) -> dict[str, NDArray[np.int32]]:
    """Nodes of the outer surface, and of each interface as ``A_to_B``."""
    sets = {"surface": np.unique(hexes.quads).astype(np.int32)}
    for a, b in pairs:
        both = (1 << a) | (1 << b)
        at = np.flatnonzero((hexes.bodies & both) == both)
        sets[f"{names[a - 1]}_to_{names[b - 1]}"] = at.astype(np.int32)
    return sets
