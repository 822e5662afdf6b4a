"""Lattices laid over a region: what each would lose is known before hexes are made, for a tenth of the work."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, find_objects, label

from gpubspline.ct.region import Region
from gpubspline.device import Device
from gpubspline.errors import InputError, MeshError
from gpubspline.mesh.blocks.core import Cells, cell_means, core_cells, largest_body
from gpubspline.mesh.blocks.grow import Core, find_core
from gpubspline.mesh.blocks.level_set import SAMPLES, Field, LevelSet, Part, level_set, part_of
from gpubspline.mesh.blocks.pillow import count_hexes
from gpubspline.mesh.blocks.placement import Placement, placement
from gpubspline.mesh.blocks.reach import MOST_LOST, LostFeature, lost_features, within_reach
from gpubspline.mesh.blocks.repair import repair
from gpubspline.mesh.blocks.result import Attempt
from gpubspline.mesh.blocks.topology import Difference, differences

Failure = InputError | MeshError

FILLED = 0.15
"""Share of a cell's samples that are lost from which the cell is taken in."""

KEPT = -0.3
"""Distance, in elements, that such a cell is given, so that the repair keeps it."""

FILLINGS = 3
"""Most rounds of it."""

PUSH, AROUND = 0.2, 2.0
"""By how much, in elements, cells within so many of a place of another topology are pushed out or in, each round."""

AT_LEAST = 0.02
"""Distance, in elements, that is given to cells which the repair took to the other side."""

MENDINGS = 8
"""Most rounds of it."""


@dataclass(frozen=True, eq=False)
class Laid:
    """A lattice laid over a region.

    Attributes
    ----------
    place: of the lattice.
    level: the region's level set on it.
    within: distances of the bodies that fill it, by name.
    core: its cells inside.
    means: distance of each cell, in elements, by which they were found.
    """

    place: Placement
    level: LevelSet
    within: dict[str, Part]
    core: Core
    means: Field

    @cached_property
    def elements(self) -> int:
        """Hexes that there will be, the layers between bodies not counted."""
        return count_hexes(self.core.cells > 0)

    @property
    def reached(self) -> Field:
        """The level set as far as the core reaches: as large as a mesh, and not kept."""
        return within_reach(self.level.phi, self.core.distance)

    @cached_property
    def lost(self) -> tuple[LostFeature, ...]:
        """Parts of the level set's inside that the core does not reach."""
        return lost_features(self.level, self.reached)

    @cached_property
    def wrong(self) -> float:
        """Places of another topology, and by how many elements lost features stand out."""
        return len(self.core.differences) + self.far

    @property
    def attempt(self) -> Attempt:
        """What is known of the place without hexes."""
        return Attempt(self.place, self.elements, None, self.core.euler["mesh"])

    @property
    def far(self) -> float:
        """By how many elements lost features stand out, together."""
        out = [feature.out_mm / self.level.size_mm for feature in self.lost]
        return sum(far for far in out if far > MOST_LOST)


def lay(
    region: Region,
    size_mm: float,
    parts: Mapping[str, Region],
    rotation: NDArray[np.float64] | None,
    device: Device,
    number: int,
) -> Laid:
    """Lay the lattice in the place of a number, from 0.

    Raises
    ------
    InputError or MeshError where it has no sound core there.
    """
    place = placement(number)
    level = level_set(region, size_mm, rotation=place.axes(rotation), offset=place.offset, device=device)
    within = {name: part_of(level, part, device=device) for name, part in parts.items()}
    if parts:
        return _of_bodies(place, level, within)
    return mended(thickened(Laid(place, level, {}, find_core(level), cell_means(level.phi))))


def _of_bodies(place: Placement, level: LevelSet, within: dict[str, Part]) -> Laid:
    """Lay several bodies by the middles of cells, and where these lose something by what they would keep as one."""
    means, laid, failure = cell_means(level.phi), None, None
    try:
        laid = Laid(place, level, within, find_core(level, within), means)
        if not laid.wrong:
            return laid
    except MeshError as error:
        failure = error
    try:
        whole = mended(thickened(Laid(place, level, {}, find_core(level), means)))
        as_one = Laid(place, level, within, find_core(level, within, (whole.core.cells > 0, whole.means)), whole.means)
    except MeshError as error:
        if laid is None:
            raise failure or error from None
        return laid
    return as_one if laid is None or as_one.wrong < laid.wrong else laid


def mended(laid: Laid) -> Laid:
    """Push cells out of tunnels that the core closes and into bridges that it cuts, until its topology is the region's.

    Corners of a cell round a rod or a bore about as thick as the cell lie on the other side: their mean leaves it out,
    or fills it. How much has to be pushed is found in steps, at each place alone; elsewhere cells stay as they are.
    """
    best, latest, own = laid, laid.core, laid.core.cells > 0
    pushed = np.where(own, np.minimum(laid.means, -AT_LEAST), np.maximum(laid.means, AT_LEAST)).astype(np.float32)
    for _ in range(MENDINGS):
        if not latest.differences:
            break
        pushed = _pushed(pushed, latest.differences)
        found = _repaired(laid.level, pushed < 0, pushed)
        if found is None:
            break
        latest = found
        if len(found.differences) < len(best.core.differences):
            best = replace(laid, core=found, means=pushed)
    return best if best.wrong < laid.wrong else laid


def _pushed(means: Field, places: Sequence[Difference]) -> Field:
    """Raise the distance of cells round what is filled, lower it round what is cut."""
    pushed = np.array(means)
    for place in places:
        at = place.at[::-1] - 0.5
        low = np.maximum(np.floor(at - AROUND).astype(int), 0)
        window = tuple(slice(a, int(b) + 2) for a, b in zip(low, at + AROUND, strict=True))
        steps = np.indices(pushed[window].shape) + (low - at)[:, None, None, None]
        share = np.clip(1.5 - np.linalg.norm(steps, axis=0) / AROUND, 0, 1)
        pushed[window] += (PUSH if place.filled else -PUSH) * share.astype(np.float32)
    return pushed


def thickened(laid: Laid) -> Laid:
    """Take in cells that thin features pass through, round after round, while less is lost than before.

    A wall thinner than two elements passes between the middles of cells: none of them lies inside.
    """
    for _ in range(FILLINGS):
        if not laid.far:
            break
        own = laid.core.cells > 0
        wanted = joined_by_faces(own | _missing(laid), laid.means)
        means = np.where(wanted & ~own, np.minimum(laid.means, KEPT), laid.means)
        found = _repaired(laid.level, wanted, means)
        if found is None:
            break
        more = replace(laid, core=found, means=means)
        if more.wrong >= laid.wrong:
            break
        laid = more
    return laid


def joined_by_faces(wanted: Cells, means: Field) -> Cells:
    """Take in the cells by which parts hang on the largest one that meet it along an edge or at a corner alone.

    The repair parts what no faces join: an ear of twenty cells went with one of them.
    """
    joined: Cells = wanted.copy()
    numbers, _ = label(wanted)
    largest = int(np.argmax(np.bincount(numbers.reshape(-1))[1:])) + 1
    for part, box in enumerate(find_objects(numbers), start=1):
        if part != largest:
            window = tuple(slice(max(side.start - 2, 0), side.stop + 2) for side in box)
            joined[window] |= _bridge(numbers[window] == part, numbers[window] == largest, means[window])
    return joined


def _bridge(part: Cells, others: Cells, means: Field) -> Cells:
    """Find the cell, or at a corner the two, by which a part is joined to others; none where these are farther off."""
    beside, opposite, found = binary_dilation(part), binary_dilation(others), np.zeros_like(part)
    if not (beside & opposite).any():
        found = _deepest(beside & binary_dilation(opposite), means)
        beside = binary_dilation(found)
    return np.asarray(found | _deepest(beside & opposite, means))


def _deepest(cells: Cells, means: Field) -> Cells:
    """The one of some cells that lies deepest inside, if there are any."""
    return np.asarray(cells & (np.arange(cells.size).reshape(cells.shape) == np.where(cells, means, np.inf).argmin()))


def _repaired(level: LevelSet, wanted: Cells, means: Field) -> Core | None:
    """Core of the cells wanted, repaired; None where that fails."""
    cells, _, unsound = repair(wanted, means)
    if len(unsound) or not cells.any():
        return None
    cells = largest_body(cells)
    flips = int(np.count_nonzero(cells != core_cells(cell_means(level.phi))))
    return Core(cells, flips, differences(cells, level.inside))


def _missing(laid: Laid) -> Cells:
    """Cells that hold much of what is lost."""
    lost = (laid.level.phi < 0) & (laid.reached > 0)
    n_k, n_j, n_i = laid.core.cells.shape
    each = lost[:-1, :-1, :-1].reshape(n_k, SAMPLES, n_j, SAMPLES, n_i, SAMPLES)
    return np.asarray(each.mean(axis=(1, 3, 5)) > FILLED)


@dataclass(frozen=True, eq=False)
class Prospect:
    """A place of the lattice in which hexes may be made.

    Attributes
    ----------
    attempt: what is known of it without them.
    wrong: what its core has otherwise than the region, as ``Laid.wrong``.
    lay: gives the lattice laid there.
    """

    attempt: Attempt
    wrong: float
    lay: Callable[[], Laid]


def in_turn(lay_at: Callable[[int], Laid], attempts: int) -> Iterator[Prospect | Failure]:
    """Lay a lattice in place after place, and give the places, those that lose least first.

    While the first loses nothing the others follow as they come. Else all are laid, until one loses nothing, before the
    first is given; all but that one are laid again when they are asked for, since each holds as much memory as a mesh.

    Arguments
    ---------
    lay_at: lays the lattice in the place of a number, from 0; errors that it raises are given in the place's turn.
    """

    def found(number: int) -> Prospect | Failure:
        try:
            laid = lay_at(number)
        except (InputError, MeshError) as error:
            return error
        return Prospect(laid.attempt, laid.wrong, lambda: laid)

    def forgotten(place: Prospect | Failure, number: int) -> Prospect | Failure:
        return replace(place, lay=partial(lay_at, number)) if isinstance(place, Prospect) else place

    def wrong(place: Prospect | Failure) -> float:
        return place.wrong if isinstance(place, Prospect) else float("inf")

    best, at = found(0), 0
    known = [forgotten(best, 0)]
    for number in range(1, attempts):
        if wrong(best) == 0:
            break
        place = found(number)
        known.append(forgotten(place, number))
        if wrong(place) < wrong(best):
            best, at = place, number
    yield best
    later = [number for number in range(attempts) if number != at]
    for number in sorted(later, key=lambda n: wrong(known[n]) if n < len(known) else 0.0):
        yield known[number] if number < len(known) else found(number)
