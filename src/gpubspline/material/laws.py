"""Material laws: HU to density to Young's modulus, one power law per piece of the HU axis."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from gpubspline.errors import InputError

DENSITY_KINDS = ("apparent", "ash", "QCT")
"""Wet mass, mineral mass, and calibrated mineral equivalent, each over the bulk volume: never interchangeable."""


@dataclass(frozen=True)
class DensityRelation:
    """The straight line from HU to density, ``rho = slope * HU + intercept``, cut off at 0 from below.

    Attributes
    ----------
    kind: which density the line gives, one of ``DENSITY_KINDS``.
    slope_g_cm3_per_hu, intercept_g_cm3: the line.
    source: where the line comes from.

    Raises
    ------
    InputError for a kind that does not exist or a line that does not rise.
    """

    kind: str
    slope_g_cm3_per_hu: float
    intercept_g_cm3: float = 0.0
    source: str = ""

    def __post_init__(self) -> None:
        """Check the line once, at the door."""
        if self.kind not in DENSITY_KINDS:
            raise InputError(f"expected a density kind of {', '.join(DENSITY_KINDS)}, got {self.kind!r}")
        if not (np.isfinite(self.intercept_g_cm3) and 0 < self.slope_g_cm3_per_hu < np.inf):
            line = f"{self.slope_g_cm3_per_hu:g} HU + {self.intercept_g_cm3:g}"
            raise InputError(f"expected a density that rises with HU, got rho = {line}")

    def density_g_cm3(self, hu: float) -> float:
        """Density at one HU value."""
        return max(self.slope_g_cm3_per_hu * hu + self.intercept_g_cm3, 0.0)

    def hu(self, density_g_cm3: float) -> float:
        """HU of a density: the line read backwards."""
        return (density_g_cm3 - self.intercept_g_cm3) / self.slope_g_cm3_per_hu


@dataclass(frozen=True)
class Piece:
    """One power law, ``E = factor * rho**exponent + offset``, on ``lower <= HU < upper``.

    Attributes
    ----------
    lower_hu, upper_hu: the range; the last piece of a law includes its upper end.
    factor_mpa: MPa per (g/cm3)**exponent.
    exponent: no unit.
    offset_mpa: MPa.
    poisson: Poisson's ratio, 0 up to and without 0.5.

    Raises
    ------
    InputError for an empty range, a factor or exponent out of bounds, or a Poisson's ratio of no solid.
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
        if not (0 < self.factor_mpa < np.inf and 0 < self.exponent <= 10 and np.isfinite(self.offset_mpa)):
            power = f"{self.factor_mpa:g} rho^{self.exponent:g} + {self.offset_mpa:g}"
            raise InputError(f"expected a positive factor and an exponent above 0 up to 10, got E = {power}")
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

    def jumps(self) -> list[tuple[float, float, float]]:
        """List where the modulus steps by more than 1 %: (HU, MPa below, MPa above) of each such boundary."""
        steps = []
        for low, high in pairwise(self.pieces):
            below = low.modulus_mpa(self.density.density_g_cm3(low.upper_hu))
            above = high.modulus_mpa(self.density.density_g_cm3(high.lower_hu))
            if abs(above - below) > 0.01 * max(below, above):
                steps.append((high.lower_hu, below, above))
        return steps
