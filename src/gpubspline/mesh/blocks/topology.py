"""Where the topology of a core differs from that of the region: what no sequence of simple points takes away.

A point of a grid is simple where adding or taking it changes no body, tunnel or cavity. A core is brought to the
region's samples point by point, simple ones only: where that ends with points left over, one has a bridge, a gap, a
tunnel or a cavity that the other has not.

Points inside are neighbours of the 26 around them, those outside of the 6 that share a face: the inside is a union of
closed cubes, as in ``core.euler_characteristic``.

Source: Bertrand and Malandain 1994, A new characterization of three-dimensional simple points, Pattern Recognition
Letters 15: one body of points inside among the 26, one body of points outside, that touches a face, among the 18.
"""

from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import find_objects, label

from gpubspline.mesh.blocks.core import Cells, euler_characteristic
from gpubspline.mesh.blocks.level_set import SAMPLES

Bits = NDArray[np.int32]

MOVED = 2.5
"""Distance, in elements, within which a tunnel closed and one pierced, or two such bridges, are one that has moved.

Round a thin wall's hole the core's cells may lie above it on one side and below it on the other.
"""

_STEPS = tuple(product((-1, 0, 1), repeat=3))  # bit n of a neighbourhood is k, j, i of the nth
_CENTRE = 13


def _bits(wanted: Any) -> int:
    return sum(1 << n for n, step in enumerate(_STEPS) if wanted(step))


_NEAR_26 = _bits(lambda step: any(step))
_NEAR_18 = _bits(lambda step: 0 < np.abs(step).sum() < 3)
_NEAR_6 = _bits(lambda step: np.abs(step).sum() == 1)
_MAY_RISE = tuple((3**axis, _bits(lambda step, a=2 - axis: step[a] < 1)) for axis in range(3))
_MAY_FALL = tuple((3**axis, _bits(lambda step, a=2 - axis: step[a] > -1)) for axis in range(3))


def is_simple(near: Bits) -> NDArray[np.bool_]:
    """Whether points are simple, by their 26 neighbours (n,): bit 9 (k + 1) + 3 (j + 1) + i + 1 where one is inside."""
    inside, outside = near & _NEAR_26, ~near & _NEAR_18
    touched = outside & _NEAR_6
    whole = (inside != 0) & (_flooded(inside & -inside, inside, _grown_26) == inside)
    return np.asarray(whole & (touched != 0) & (touched & ~_flooded(touched & -touched, outside, _grown_6) == 0))


def _flooded(seed: Bits, allowed: Bits, grown: Any) -> Bits:
    while True:
        more = grown(seed) & allowed
        if np.array_equal(more, seed):
            return seed
        seed = more


def _grown_6(bits: Bits) -> Bits:
    out = bits.copy()
    for (step, up), (_, down) in zip(_MAY_RISE, _MAY_FALL, strict=True):
        out |= (bits & up) << step | (bits & down) >> step
    return np.asarray(out)


def _grown_26(bits: Bits) -> Bits:
    out = bits.copy()
    for (step, up), (_, down) in zip(_MAY_RISE, _MAY_FALL, strict=True):
        out |= (out & up) << step | (out & down) >> step
    return np.asarray(out)


def _neighbourhoods(points: NDArray[np.bool_], flat: NDArray[np.int64]) -> Bits:
    """Bits of the 26 neighbours of points (n,), flat indices that lie on no border."""
    _, n_j, n_i = points.shape
    values, found = points.reshape(-1), np.zeros(len(flat), dtype=np.int32)
    for bit, (k, j, i) in enumerate(_STEPS):
        if bit != _CENTRE:
            found |= values[flat + (k * n_j + j) * n_i + i].astype(np.int32) << np.int32(bit)
    return found


def deform(points: NDArray[np.bool_], wanted: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Flip simple points towards those wanted, until none is left; those of the border stay.

    Points of one parity along each axis are no neighbours: they are flipped at once.
    """
    points = points.copy()
    values, aim = points.reshape(-1), wanted.reshape(-1)
    inner = np.zeros(points.shape, dtype=bool)
    inner[1:-1, 1:-1, 1:-1] = True
    waiting = np.flatnonzero((values != aim) & inner.reshape(-1))
    parity = sum((index & 1) << axis for axis, index in enumerate(np.unravel_index(waiting, points.shape)))
    classes = [waiting[parity == number] for number in range(8)]
    flips = 1
    while flips:
        flips = 0
        for number, flat in enumerate(classes):
            simple = is_simple(_neighbourhoods(points, flat)) if len(flat) else np.empty(0, dtype=bool)
            values[flat[simple]] ^= True
            flips += int(np.count_nonzero(simple))
            classes[number] = flat[~simple]
    return points


@dataclass(frozen=True, eq=False)
class Difference:
    """A place where the topology of a core differs from the region's.

    Attributes
    ----------
    at: (3,) lattice coordinates, elements.
    filled: whether the core is inside there and the region is not.
    euler: what the Euler characteristic of the core lacks for it.
    """

    at: NDArray[np.float64]
    filled: bool
    euler: int

    @property
    def what(self) -> str:
        """What the core does there to the region."""
        does, one = _DOES[self.filled, self.euler < 0]
        count = abs(self.euler)
        return f"{does} a {one}" if count == 1 else f"{does} {count} {one}s"


_DOES = {
    (True, True): ("closes", "tunnel"),
    (True, False): ("fills", "gap"),
    (False, True): ("cuts", "bridge"),
    (False, False): ("pierces", "wall"),
}
"""By whether the core is inside there, and whether its Euler characteristic is too high. A cavity is a gap too."""


def differences(cells: Cells, inside: NDArray[np.bool_]) -> tuple[Difference, ...]:
    """Places where the topology of cells differs from that of a level set's samples inside.

    Arguments
    ---------
    cells: (n_k, n_j, n_i) of the core.
    inside: (SAMPLES n_k + 1, ...) samples.
    """
    made = deform(on_samples(cells), inside)
    left = np.argwhere(made != inside)
    if not len(left):
        return ()
    first = np.maximum(left.min(axis=0) - 1, 0)  # a border of one: what is inside beyond tells Euler characteristics
    box = tuple(slice(a, b) for a, b in zip(first, left.max(axis=0) + 2, strict=True))
    made, numbers = made[box], label((made != inside)[box], np.ones((3, 3, 3)))[0]
    found = []
    for number, near in enumerate(find_objects(numbers), start=1):
        wide = tuple(slice(max(side.start - 1, 0), side.stop + 1) for side in near)
        own = numbers[wide] == number
        lacks = euler_characteristic(made[wide] ^ own) - euler_characteristic(made[wide])
        if lacks:
            k, j, i = np.argwhere(own).mean(axis=0) + [side.start for side in wide] + first
            found.append(Difference(np.array([i, j, k]) / SAMPLES, bool(made[wide][own].all()), lacks))
    return _unmoved(found)


def _unmoved(found: list[Difference]) -> tuple[Difference, ...]:
    """Without pairs that lie near each other and cancel, the nearest first."""
    pairs = [
        (float(np.linalg.norm(one.at - other.at)), first, second)
        for first, one in enumerate(found)
        for second, other in enumerate(found[:first])
        if one.euler == -other.euler
    ]
    gone = set[int]()
    for away, first, second in sorted(pairs):
        if away < MOVED and not gone & {first, second}:
            gone |= {first, second}
    return tuple(place for number, place in enumerate(found) if number not in gone)


def on_samples(cells: Cells) -> NDArray[np.bool_]:
    """Whether each sample of the level set's grid is in the core: those at corners of cells by a cell beside."""
    fine = cells
    for axis in range(3):
        fine = np.repeat(fine, SAMPLES, axis=axis)
    return np.pad(fine, ((0, 1),) * 3)
