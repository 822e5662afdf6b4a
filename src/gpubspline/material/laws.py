"""Material laws: HU to density to Young's modulus, one power law per piece of the HU axis."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from gpubspline.errors import InputError
from gpubspline.material.density import DENSITY_KINDS as DENSITY_KINDS
from gpubspline.material.density import WEIGHED
from gpubspline.material.density import DensityRelation as DensityRelation

FARTHEST_HU = 1e6
"""Beyond any HU, either way: the range of a law that asks for none."""


@dataclass(frozen=True)
class Piece:
    """One power law, ``E = factor * rho**exponent + offset``, on ``lower <= HU < upper``; a constant of factor 0.

    Attributes
    ----------
    lower_hu, upper_hu: the range; the last piece of a law includes its upper end.
    factor_mpa: MPa per (g/cm3)**exponent.
    exponent: no unit.
    offset_mpa: MPa.
    poisson: Poisson's ratio, 0 up to and without 0.5.

    Raises
    ------
    InputError for an empty range, a negative factor, an exponent out of bounds, or a Poisson's ratio of no solid.
    """

    lower_hu: float
    upper_hu: float
    factor_mpa: float
    exponent: float
    offset_mpa: float = 0.0
    poisson: float = 0.3

    def __post_init__(self) -> None:
        """Check the numbers once, at the door."""
        if not -np.inf < self.lower_hu < self.upper_hu < np.inf:
            raise InputError(f"expected a range of HU that rises, got {self.lower_hu:g} to {self.upper_hu:g}")
        if not (0 <= self.factor_mpa < np.inf and 0 < self.exponent <= 10 and np.isfinite(self.offset_mpa)):
            power = f"{self.factor_mpa:g} rho^{self.exponent:g} + {self.offset_mpa:g}"
            raise InputError(f"expected a factor of 0 or more and an exponent above 0 up to 10, got E = {power}")
        if not 0 <= self.poisson < 0.5:
            raise InputError(f"expected a Poisson's ratio from 0 up to and without 0.5, got {self.poisson:g}")

    def modulus_mpa(self, density_g_cm3: float) -> float:
        """Young's modulus at one density."""
        return float(self.factor_mpa * density_g_cm3**self.exponent + self.offset_mpa)


@dataclass(frozen=True)
class Law:
    """A material law with its pedigree.

    Attributes
    ----------
    name, title: the short name it is asked for by, and what it is.
    density: the relation from HU to the density that the powers take.
    pieces: the power laws, by rising HU.
    site: the anatomical site it was measured at.
    direction: of the modulus in the bone, such as ``"axial"``.
    strain_rate_per_s: at which it was measured or, where it is a variable of the law, is evaluated; None if unknown.
    specimens_g_cm3: least and greatest density of the specimens, of the law's kind; None if unknown. Beyond it the law
        is an extrapolation, which outputs count.
    citation: the source of the powers.
    unconfirmed: the parts that could not be confirmed from the source; outputs that use the law repeat them.
    notes: what its user should know.

    Raises
    ------
    InputError for no piece, overlapping pieces, or a modulus that is not positive somewhere in the range.
    """

    name: str
    title: str
    density: DensityRelation
    pieces: tuple[Piece, ...]
    site: str = ""
    direction: str = ""
    strain_rate_per_s: float | None = None
    specimens_g_cm3: tuple[float, float] | None = None
    citation: str = ""
    unconfirmed: tuple[str, ...] = ()
    notes: str = ""

    def __post_init__(self) -> None:
        """Sort the pieces and check that they fit together."""
        pieces = tuple(sorted(self.pieces, key=lambda piece: piece.lower_hu))
        if not pieces:
            raise InputError(f"expected at least one piece in the law {self.name!r}, got none")
        for low, high in pairwise(pieces):
            if low.upper_hu > high.lower_hu:
                ranges = f"{low.lower_hu:g} to {low.upper_hu:g} and {high.lower_hu:g} to {high.upper_hu:g}"
                raise InputError(f"expected pieces that do not overlap in the law {self.name!r}, got HU {ranges}")
        rate, specimens = self.strain_rate_per_s, self.specimens_g_cm3
        if rate is not None and not 0 < rate < np.inf:
            raise InputError(f"expected a positive strain rate in the law {self.name!r}, got {rate:g} per second")
        if specimens is not None and not 0 <= specimens[0] < specimens[1] < np.inf:
            got = f"{specimens[0]:g} to {specimens[1]:g}"
            raise InputError(f"expected densities of specimens that rise in the law {self.name!r}, got {got} g/cm3")
        for piece in pieces:  # E rises with rho, so its least value is at the lower end
            least = piece.modulus_mpa(self.density.density_g_cm3(piece.lower_hu))
            if least <= 0:
                at = f"{least:g} MPa at {piece.lower_hu:g} HU"
                raise InputError(f"expected a positive modulus everywhere in the law {self.name!r}, got {at}")
        object.__setattr__(self, "pieces", pieces)

    @property
    def range_hu(self) -> tuple[float, float]:
        """The lowest and the highest HU the law speaks of; there may be gaps between."""
        return self.pieces[0].lower_hu, self.pieces[-1].upper_hu

    @property
    def is_constant(self) -> bool:
        """Whether it gives one modulus, whatever the HU: it has no range then that anybody measured."""
        return len(self.pieces) == 1 and self.pieces[0].factor_mpa == 0

    @property
    def all_unconfirmed(self) -> tuple[str, ...]:
        """What could not be confirmed, of the law and of the steps to its density."""
        return (*self.unconfirmed, *self.density.unconfirmed)

    def modulus_mpa(self, hu: float) -> float:
        """Young's modulus at one HU, and outside every range that of the nearest end of one."""
        inside = [piece for piece in self.pieces if piece.lower_hu <= hu < piece.upper_hu]
        off = [max(piece.lower_hu - hu, hu - piece.upper_hu) for piece in self.pieces]
        piece = inside[0] if inside else self.pieces[off.index(min(off))]
        return piece.modulus_mpa(self.density.density_g_cm3(min(max(hu, piece.lower_hu), piece.upper_hu)))

    def calibrated(self, relation: DensityRelation) -> "Law":
        """Take the density from another relation, such as a calibration of the scanner.

        The relation is gone on from to the law's kind of density. Each piece keeps the densities at its ends, and with
        them every density its modulus; its HU change. One density whatever the HU stays.
        """
        if self.density.is_constant:
            return self
        relation = relation.to(self.density.kind)

        def moved(hu: float) -> float:
            return relation.hu(self.density.slope_g_cm3_per_hu * hu + self.density.intercept_g_cm3)

        if self.density.table:
            raise InputError(f"expected a law of one line from HU to calibrate, got {self.name!r}, which has a table")
        pieces = tuple(
            replace(piece, lower_hu=moved(piece.lower_hu), upper_hu=moved(piece.upper_hu)) for piece in self.pieces
        )
        return replace(self, density=relation, pieces=pieces)

    def beside(self, other: "Law") -> "Law":
        """The same law beside another in one mesh: a constant without a density of its own takes that of the other."""
        return replace(self, density=other.density) if self.is_constant and not self.density.is_constant else self

    def weighed(self, kind: str) -> "Law":
        """A law of the same ranges of HU whose density is of a kind, for masses: its modulus is 1 MPa, whatever it was.

        The law itself where its density is of that kind.
        """
        if self.density.kind == kind:
            return self
        pieces = tuple(replace(piece, factor_mpa=0.0, exponent=1.0, offset_mpa=1.0) for piece in self.pieces)
        return replace(self, density=self.density.to(kind), pieces=pieces)

    def jumps(self) -> list[tuple[float, float, float]]:
        """List where the modulus steps by more than 1 %: (HU, MPa below, MPa above) of each such boundary."""
        steps = []
        for low, high in pairwise(self.pieces):
            below = low.modulus_mpa(self.density.density_g_cm3(low.upper_hu))
            above = high.modulus_mpa(self.density.density_g_cm3(high.lower_hu))
            if abs(above - below) > 0.01 * max(below, above):
                steps.append((high.lower_hu, below, above))
        return steps


def common_kind(laws: Iterable[Law]) -> str:
    """Kind of density of all laws, or the one that masses of unlike kinds are converted to."""
    kinds = {law.density.kind for law in laws}
    return kinds.pop() if len(kinds) == 1 else WEIGHED


def constant_law(
    modulus_mpa: float, poisson: float, density_g_cm3: float | None = None, *, density: DensityRelation
) -> Law:
    """Make a law of one modulus and one Poisson's ratio, whatever the HU: of an implant, or of what has no law.

    Arguments
    ---------
    density_g_cm3: one density as well; that of the HU by ``density`` where None.
    density: the relation of the laws beside it.

    Raises
    ------
    InputError for a modulus, a Poisson's ratio or a density of no solid.
    """
    if not 0 < modulus_mpa < np.inf:
        raise InputError(f"expected a positive modulus in MPa, got {modulus_mpa:g}")
    words = f"constant:E={modulus_mpa:g},nu={poisson:g}"
    if density_g_cm3 is not None:
        if not 0 < density_g_cm3 < np.inf:
            raise InputError(f"expected a positive density in g/cm3, got {density_g_cm3:g}")
        words += f",rho={density_g_cm3:g}"
        density = DensityRelation(density.kind, 0.0, density_g_cm3, "given")
    title = "one modulus, whatever the HU; " + ("density by the HU" if density_g_cm3 is None else "density given")
    piece = Piece(-FARTHEST_HU, FARTHEST_HU, 0.0, 1.0, modulus_mpa, poisson)
    return Law(words, title, density, (piece,), citation="given by the user")
