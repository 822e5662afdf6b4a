"""Which bodies touch where, and cells given to the body between two that do not.

A body thinner than a cell is pierced where each cell goes to the body it lies deepest in: its neighbours on both sides
would meet through it, along curves that are nowhere in the region and that no node can be held by.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label

from gpubspline.mesh.blocks.level_set import SAMPLES, Field
from gpubspline.mesh.blocks.pillow import Owners

LEAST_CONTACT = 2.0
"""Area, in faces of cells, below which two bodies count as not touching: no elements follow the rim of less."""

ROUNDS = 20
"""Most rounds in which cells are given away."""

KEPT = 4.0
"""What it costs more, in elements of distance, to take such a cell back."""

_BODIES = 64
_NEAR = np.ones((3, 3, 3), dtype=bool)
_STEPS = np.stack(np.nonzero(_NEAR), axis=1) - 1


@dataclass(frozen=True, eq=False)
class Contacts:
    """Where bodies touch each other, or the outside.

    Attributes
    ----------
    shape: (n_k, n_j, n_i) lattice cells.
    keys: sorted: (64 a + b) cells + cell, for each cell within one of a place where the bodies a < b touch.
    """

    shape: tuple[int, ...]
    keys: NDArray[np.int64]

    def strangers(self, owners: Owners) -> NDArray[np.int64]:
        """Flat cells (f, 2) on both sides of each face between bodies that do not touch there."""
        numbers = np.arange(owners.size).reshape(owners.shape)
        found = []
        for axis in range(3):
            line, number = np.moveaxis(owners, axis, 0), np.moveaxis(numbers, axis, 0)
            differ = line[:-1] != line[1:]
            ends = np.stack([number[:-1][differ], number[1:][differ]], axis=1)
            pair = _pair(line[:-1][differ], line[1:][differ])
            found.append(ends[~(self._touch(pair, ends[:, 0]) | self._touch(pair, ends[:, 1]))])
        return np.concatenate(found)

    def _touch(self, pair: NDArray[np.int64], cells: NDArray[np.int64]) -> NDArray[np.bool_]:
        wanted = pair * int(np.prod(self.shape)) + cells
        at = np.minimum(np.searchsorted(self.keys, wanted), len(self.keys) - 1)
        return np.asarray(self.keys[at] == wanted)


def find_contacts(phi: Field, parts: Sequence[Field]) -> Contacts:
    """Find where bodies touch.

    Small patches count only for bodies that touch no other anywhere else.

    Arguments
    ---------
    phi, parts: distances, in elements, of all bodies together and of each, sampled on one grid.
    """
    owners = nearest_body(phi, parts)
    shape = tuple((n - 1) // SAMPLES for n in phi.shape)
    keys, faces = np.unique(np.concatenate([_meetings(owners, axis, shape) for axis in range(3)]), return_counts=True)
    pairs, first = np.unique(keys // int(np.prod(shape)), return_index=True)
    cells = np.split(keys % int(np.prod(shape)), first[1:])
    areas = [_patch_areas(*each, shape) for each in zip(cells, np.split(faces, first[1:]), strict=True)]
    large = [pair for pair, area in zip(pairs, areas, strict=True) if pair >= _BODIES and area.max() >= LEAST_CONTACT]
    held = set(np.concatenate(np.divmod(large, _BODIES)).tolist()) if large else set[int]()
    kept = []
    for pair, at, area in zip(pairs, cells, areas, strict=True):
        needed = pair >= _BODIES and not set(divmod(int(pair), _BODIES)) <= held
        kept.append(pair * int(np.prod(shape)) + _around(at[(area >= LEAST_CONTACT) | needed], shape))
    return Contacts(shape, np.concatenate(kept))


def nearest_body(phi: Field, parts: Sequence[Field]) -> Owners:
    """Body that each sample lies deepest in, from 1; 0 outside of all."""
    owners, least = np.ones(phi.shape, dtype=np.int8), parts[0]
    for number, part in enumerate(parts[1:], start=2):
        owners[part < least] = number
        least = np.minimum(least, part)
    owners[phi >= 0] = 0
    return owners


def _meetings(owners: Owners, axis: int, shape: tuple[int, ...]) -> NDArray[np.int64]:
    """Key of the pair and the cell of each two neighbouring samples of different owners."""
    line = np.moveaxis(owners, axis, 0)
    at = np.nonzero(np.moveaxis(line[:-1] != line[1:], 0, axis))
    one = owners[at]
    beyond = list(at)
    beyond[axis] = at[axis] + 1
    cells = tuple(np.minimum(index // SAMPLES, n - 1) for index, n in zip(at, shape, strict=True))
    return _pair(one, owners[tuple(beyond)]) * int(np.prod(shape)) + np.ravel_multi_index(cells, shape)


def _pair(one: Owners, other: Owners) -> NDArray[np.int64]:
    return np.asarray(np.minimum(one, other).astype(np.int64) * _BODIES + np.maximum(one, other))


def _patch_areas(cells: NDArray[np.int64], faces: NDArray[np.int64], shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Area, in faces of cells, of the connected patch that each flat cell (c,) belongs to."""
    at = np.stack(np.unravel_index(cells, shape), axis=1)
    at -= at.min(axis=0)
    there = np.zeros(at.max(axis=0) + 1, dtype=bool)
    there[tuple(at.T)] = True
    patch = label(there, _NEAR)[0][tuple(at.T)]
    return np.asarray(np.bincount(patch, faces)[patch] / SAMPLES**2)


def _around(cells: NDArray[np.int64], shape: tuple[int, ...]) -> NDArray[np.int64]:
    """Flat cells (c,) with all their neighbours, each once."""
    at = np.stack(np.unravel_index(cells, shape), axis=1)[:, None] + _STEPS
    at = np.clip(at, 0, np.array(shape) - 1).reshape(-1, 3)
    return np.unique(np.ravel_multi_index(tuple(at.T), shape))


def part_strangers(
    owners: Owners, costs: NDArray[np.float32], contacts: Contacts
) -> tuple[Owners, NDArray[np.float32]]:
    """Give cells on faces between bodies that do not touch there to what lies between these.

    Arguments
    ---------
    owners: (n_k, n_j, n_i), 0 outside.
    costs: (1 + bodies, n_k, n_j, n_i), of a cell given away; see ``repair_owners``.

    Returns: owners, and costs that keep these cells from being taken back.
    """
    owners, costs = owners.copy(), costs.copy()
    flat, price = owners.reshape(-1), costs.reshape(len(costs), -1)
    for _ in range(ROUNDS):
        ends = contacts.strangers(owners)
        if not len(ends):
            break
        offers = np.moveaxis(price[:, ends], 0, 2)  # (f, 2, 1 + bodies)
        np.put_along_axis(offers, np.stack([flat[ends]] * 2, axis=1).astype(np.int64), np.inf, axis=2)
        end, new = np.divmod(offers.reshape(len(ends), -1).argmin(axis=1), len(costs))
        cells = ends[np.arange(len(ends)), end]
        price[flat[cells], cells] += KEPT
        flat[cells] = new
    return owners, costs
