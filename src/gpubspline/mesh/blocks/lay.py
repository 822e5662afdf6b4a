"""Lattices laid over a region: what each would lose is known before hexes are made, for a tenth of the work."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gpubspline.errors import InputError, MeshError
from gpubspline.mesh.blocks.core import Cells, cell_means, euler_characteristic, largest_body
from gpubspline.mesh.blocks.grow import Core
from gpubspline.mesh.blocks.level_set import SAMPLES, LevelSet, Part
from gpubspline.mesh.blocks.pillow import count_hexes
from gpubspline.mesh.blocks.placement import Placement
from gpubspline.mesh.blocks.reach import LostFeature, lost_features, within_reach
from gpubspline.mesh.blocks.repair import repair

Failure = InputError | MeshError

MOST_LOST = 1.2
"""How far, in elements, a feature may stand out of the mesh without another place being tried."""

FILLED = 0.15
"""Share of a cell's samples that are lost from which the cell is taken in."""

KEPT = -0.3
"""Distance, in elements, that such a cell is given, so that the repair keeps it."""

FILLINGS = 3
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
    """

    place: Placement
    level: LevelSet
    within: dict[str, Part]
    core: Core

    @cached_property
    def elements(self) -> int:
        """Hexes that there will be, the layers between bodies not counted."""
        return count_hexes(self.core.cells > 0)

    @cached_property
    def reached(self) -> NDArray[np.float32]:
        """The level set as far as the core reaches."""
        return within_reach(self.level.phi, self.core.cells > 0)

    @cached_property
    def lost(self) -> tuple[LostFeature, ...]:
        """Parts of the level set's inside that the core does not reach."""
        return lost_features(self.level, self.reached)

    @cached_property
    def wrong(self) -> float:
        """Tunnels, cavities and bodies too many or too few, and by how many elements lost features stand out."""
        return abs(self.core.euler["mesh"] - self.core.euler["region"]) + self.far

    @property
    def far(self) -> float:
        """By how many elements lost features stand out, together."""
        out = [feature.out_mm / self.level.size_mm for feature in self.lost]
        return sum(far for far in out if far > MOST_LOST)


def thickened(laid: Laid) -> Laid:
    """Take in cells that thin features pass through, round after round, while less is lost than before.

    A wall thinner than two elements passes between the middles of cells: none of them lies inside.
    """
    means = cell_means(laid.level.phi)
    for _ in range(FILLINGS):
        if not laid.far:
            break
        own = laid.core.cells > 0
        wanted = own | _missing(laid)
        means = np.where(wanted & ~own, np.minimum(means, KEPT), means)
        cells, flips, unsound = repair(wanted, means)
        cells = largest_body(cells)
        more = replace(laid, core=Core(cells, flips, {**laid.core.euler, "mesh": euler_characteristic(cells)}))
        if len(unsound) or more.wrong >= laid.wrong:
            break
        laid = more
    return laid


def _missing(laid: Laid) -> Cells:
    """Cells that hold much of what is lost."""
    lost = (laid.level.phi < 0) & (laid.reached > 0)
    n_k, n_j, n_i = laid.core.cells.shape
    each = lost[:-1, :-1, :-1].reshape(n_k, SAMPLES, n_j, SAMPLES, n_i, SAMPLES)
    return np.asarray(each.mean(axis=(1, 3, 5)) > FILLED)


def in_turn(lay: Callable[[int], Laid], attempts: int) -> Iterator[Laid | Failure]:
    """Lay a lattice in place after place, and give the laid, those that lose least first.

    While the first loses nothing the others follow as they come. Else all are laid, until one loses nothing, before the
    first is given; they are not kept but laid again, since each holds as much memory as a mesh.

    Arguments
    ---------
    lay: lays the lattice in the place of a number, from 0; errors that it raises are given in the place's turn.
    """

    def laid(number: int) -> Laid | Failure:
        try:
            return lay(number)
        except (InputError, MeshError) as error:
            return error

    def wrong(found: Laid | Failure) -> float:
        return found.wrong if isinstance(found, Laid) else float("inf")

    best, at = laid(0), 0
    losses = [wrong(best)]
    for number in range(1, attempts):
        if losses[at] == 0:
            break
        found = laid(number)
        losses.append(wrong(found))
        if losses[number] < losses[at]:
            best, at = found, number
    yield best
    later = [number for number in range(attempts) if number != at]
    for number in sorted(later, key=lambda n: losses[n] if n < len(losses) else 0.0):
        yield laid(number)
