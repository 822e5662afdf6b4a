"""Which of two meshes is better, and whether another place of the lattice could give one that is worth its time.

One order tells which mesh is kept, which places are passed over and when no more are tried. A place that has no hexes
yet stands for the best that may be hoped of it; it is passed over where that is no better than a mesh that there is.
"""

from dataclasses import dataclass

from gpubspline.mesh.blocks.grow import Grown
from gpubspline.mesh.blocks.lay import Laid
from gpubspline.mesh.blocks.reach import MOST_LOST
from gpubspline.mesh.blocks.tips import TINY
from gpubspline.mesh.mend import POOR

GOOD = 0.65
"""Worst scaled Jacobian beyond which none is hoped for: other places gain 0.02 then, and take as long as the first."""

MOST_TRIED = 20_000
"""Hexes, of all meshes made, from which no other place is tried where the worst is not poor: time is linear in them."""

MOST_MENDED = 100_000
"""Hexes, of all meshes made, from which no other place is tried where the worst is poor, but none is inverted."""

MOST_OFF = 0.02
"""By what part a body's volume may be off: of two places that lose as much, the one that is less off is taken."""

SWOLLEN = 0.05
"""By what part it may be off before each hundredth more is as bad as an element lost or a place of another topology."""


@dataclass(frozen=True, order=True)
class Merit:
    """How good a mesh is: of two the greater is better. What stands first counts first.

    Attributes
    ----------
    sound: no hex is poor. Those may fail in a solver, whatever else the mesh keeps.
    wrong: what it has otherwise than the region, less than 0: places of another topology, elements by which features
        that its core does not reach stand out, those by which others stand out more than allowed, and hundredths of
        volume beyond ``SWOLLEN``. They weigh alike, so that no volume is bought with a tunnel.
    off: by how many times ``MOST_OFF`` a body's volume is off, less than 0. In steps: hundredths of a percent do not
        outweigh hexes.
    least: the worst scaled Jacobian.
    """

    sound: bool
    wrong: float
    off: float
    least: float


def merit(laid: Laid, made: Grown) -> Merit:
    """Merit of the hexes that grew on a lattice laid."""
    least = made.placed.nodes.least
    out, swollen = max(made.farthest - MOST_LOST, 0.0), 100 * max(made.off - SWOLLEN, 0.0)
    sound = least >= POOR and made.least_determinant >= TINY
    return Merit(sound, -(laid.wrong + out + swollen), -(made.off // MOST_OFF), least)


def hope(wrong: float = 0.0, *, several: bool = False) -> Merit:
    """Merit that is hoped for in a place whose core is wrong by so much; of several bodies one not poor is enough."""
    return Merit(True, -wrong, 0.0, POOR if several else GOOD)


def is_worth_trying(hoped: Merit, best: Merit | None, made_hexes: int) -> bool:
    """Whether hexes are to be made in a place of which so much is hoped, after so many in all.

    Best is what they gave; while that has inverted hexes they are, however many were made.
    """
    if best is None or best.least <= 0:
        return True
    return hoped > best and made_hexes < (MOST_TRIED if best.sound else MOST_MENDED)
