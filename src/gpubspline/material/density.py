"""From HU to the density that a law takes: HU -> QCT -> ash -> apparent, each step a named line with its source.

A step is one table of ``conversions.toml``::

    [ash-from-QCT]
    takes = "QCT"                      # or "HU", "ash", "apparent"
    gives = "ash"
    slope = 0.877                      # or points = [[value, g/cm3], [value, g/cm3]]
    intercept = 0.079
    source = "Schileo et al. 2008"
    unconfirmed = []                   # optional, what could not be checked against the source
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib import resources
from itertools import pairwise
from types import MappingProxyType
from typing import Any

import numpy as np

from gpubspline.errors import InputError
from gpubspline.tables import checked, pair, parse

DENSITY_KINDS = ("QCT", "ash", "apparent")
"""Calibrated mineral equivalent, mineral mass and wet mass over the bulk volume, in the order of the chain.

They are never interchangeable, and masses of two kinds are no sum."""

WEIGHED = "apparent"
"""The kind that a balance shows and that gravity pulls at: what masses of unlike kinds are converted to."""

MASS_OF = {"QCT": "mineral equivalent", "ash": "mineral alone", "apparent": "wet"}
"""What a mass is of, by the kind of its density."""


@dataclass(frozen=True)
class Step:
    """One line of a density chain, ``gives = slope * takes + intercept``.

    Attributes
    ----------
    name: what it is called in outputs.
    takes, gives: ``"HU"`` or a kind of density; a kind of density.
    slope, intercept: g/cm3 per HU or per g/cm3, and g/cm3.
    source: where the line comes from.
    unconfirmed: what of it could not be checked against the source.

    Raises
    ------
    InputError for a kind that does not exist or a line that does not rise.
    """

    name: str
    takes: str
    gives: str
    slope: float
    intercept: float = 0.0
    source: str = ""
    unconfirmed: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Check the line once, at the door."""
        if self.takes not in ("HU", *DENSITY_KINDS) or self.gives not in DENSITY_KINDS or self.takes == self.gives:
            kinds = ", ".join(DENSITY_KINDS)
            raise InputError(f"expected a step from HU or a density of {kinds} to another, got {self.describe()}")
        _check_rise(self.slope, self.intercept, self.takes)

    def describe(self) -> str:
        """Say what goes in and what comes out."""
        return f"{self.takes} to {self.gives}"

    def reversed(self) -> "Step":
        """Read the line backwards."""
        name = f"{self.name}, backwards"
        return replace(
            self,
            name=name,
            takes=self.gives,
            gives=self.takes,
            slope=1 / self.slope,
            intercept=-self.intercept / self.slope,
        )


@dataclass(frozen=True)
class DensityRelation:
    """The relation from HU to density, a line or a rising table, cut off at 0 from below.

    Attributes
    ----------
    kind: which density it gives, one of ``DENSITY_KINDS``.
    slope_g_cm3_per_hu, intercept_g_cm3: the line; of a table, the one through its ends.
    source: where it comes from.
    steps: the chain that it was composed of, in order; empty where it is a line of its own.
    table: (HU, g/cm3) points with straight lines between, the outer ones going on beyond the ends; empty for a line.

    Raises
    ------
    InputError for a kind that does not exist or a relation that falls, or stays at no density.
    """

    kind: str
    slope_g_cm3_per_hu: float
    intercept_g_cm3: float = 0.0
    source: str = ""
    steps: tuple[Step, ...] = ()
    table: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        """Check the relation once, at the door."""
        if self.kind not in DENSITY_KINDS:
            raise InputError(f"expected a density kind of {', '.join(DENSITY_KINDS)}, got {self.kind!r}")
        if not (self.is_constant and 0 < self.intercept_g_cm3 < np.inf):
            _check_rise(self.slope_g_cm3_per_hu, self.intercept_g_cm3, "HU")

    @classmethod
    def from_points(
        cls, kind: str, points: tuple[tuple[float, float], ...], source: str = "", steps: tuple[Step, ...] = ()
    ) -> "DensityRelation":
        """Join (HU, g/cm3) points by straight lines.

        Raises InputError for fewer than two points, or points that do not rise.
        """
        ordered = tuple(sorted(points))
        if len(ordered) < 2:
            raise InputError(f"expected at least two points (HU, g/cm3) of a density, got {len(ordered)}")
        for (hu_0, rho_0), (hu_1, rho_1) in pairwise(ordered):
            if not (hu_0 < hu_1 and rho_0 < rho_1):
                got = f"{rho_0:g} g/cm3 at {hu_0:g} HU and {rho_1:g} at {hu_1:g}"
                raise InputError(f"expected a density that rises with HU, got {got}")
        (hu_0, rho_0), (hu_1, rho_1) = ordered[0], ordered[-1]
        slope = (rho_1 - rho_0) / (hu_1 - hu_0)
        table = ordered if len(ordered) > 2 else ()
        return cls(kind, slope, rho_0 - slope * hu_0, source, steps, table)

    @property
    def is_constant(self) -> bool:
        """Whether the density is one, whatever the HU."""
        return self.slope_g_cm3_per_hu == 0

    @property
    def lines(self) -> tuple[tuple[float, float, float], ...]:
        """(HU from which it holds, slope, intercept) of each straight line, by rising HU; the first has no start."""
        if not self.table:
            return ((-np.inf, self.slope_g_cm3_per_hu, self.intercept_g_cm3),)
        found: list[tuple[float, float, float]] = []
        for (hu_0, rho_0), (hu_1, rho_1) in pairwise(self.table):
            slope = (rho_1 - rho_0) / (hu_1 - hu_0)
            found.append((hu_0 if found else -np.inf, slope, rho_0 - slope * hu_0))
        return tuple(found)

    def density_g_cm3(self, hu: float) -> float:
        """Density at one HU value."""
        _, slope, intercept = [line for line in self.lines if hu >= line[0]][-1]
        return max(slope * hu + intercept, 0.0)

    def hu(self, density_g_cm3: float) -> float:
        """HU of a density: the relation read backwards; raises InputError where there is one density for all HU."""
        if self.is_constant:
            raise InputError(
                f"expected a density that rises with HU, got {self.intercept_g_cm3:g} g/cm3 for all of them"
            )
        lines = self.lines
        starts = [-np.inf] + [slope * hu + intercept for hu, slope, intercept in lines[1:]]
        _, slope, intercept = [line for line, start in zip(lines, starts, strict=True) if density_g_cm3 >= start][-1]
        return (density_g_cm3 - intercept) / slope

    def then(self, step: Step) -> "DensityRelation":
        """Go one step on; raises InputError where the step takes another kind than this relation gives."""
        if step.takes != self.kind:
            raise InputError(f"expected a step from the density {self.kind}, got {step.name}: {step.describe()}")
        return DensityRelation(
            step.gives,
            step.slope * self.slope_g_cm3_per_hu,
            step.slope * self.intercept_g_cm3 + step.intercept,
            f"{self.source}; {step.source}",
            (*self.steps, step),
            tuple((hu, step.slope * rho + step.intercept) for hu, rho in self.table),
        )

    def to(self, kind: str) -> "DensityRelation":
        """Go on to another kind of density by the steps of ``conversions.toml``; the same where it is that kind.

        Raises InputError for a kind that does not exist.
        """
        if kind not in DENSITY_KINDS:
            raise InputError(f"expected a density kind of {', '.join(DENSITY_KINDS)}, got {kind!r}")
        found = self
        for step in steps_between(self.kind, kind):
            found = found.then(step)
        return found

    @property
    def unconfirmed(self) -> tuple[str, ...]:
        """What of the steps could not be checked against their sources."""
        return tuple(f"{step.name}: {what}" for step in self.steps for what in step.unconfirmed)


def _check_rise(slope: float, intercept: float, takes: str) -> None:
    if not (np.isfinite(intercept) and 0 < slope < np.inf):
        raise InputError(f"expected a density that rises with {takes}, got rho = {slope:g} {takes} + {intercept:g}")


def steps_between(takes: str, gives: str) -> tuple[Step, ...]:
    """Steps of ``conversions.toml`` from one kind of density to another; none where they are the same."""
    at, wanted = DENSITY_KINDS.index(takes), DENSITY_KINDS.index(gives)
    way = 1 if wanted > at else -1
    return tuple(_between(DENSITY_KINDS[n], DENSITY_KINDS[n + way]) for n in range(at, wanted, way))


def _between(takes: str, gives: str) -> Step:
    for step in conversions().values():
        if (step.takes, step.gives) == (takes, gives):
            return step
        if (step.gives, step.takes) == (takes, gives):
            return step.reversed()
    raise AssertionError(f"conversions.toml has no step between {takes} and {gives}")


def first_step(name: str) -> DensityRelation:
    """Begin a chain with a conversion from HU by its name.

    Raises
    ------
    InputError where there is no such conversion, or it does not take HU.
    """
    step = conversion(name)
    if step.takes != "HU":
        raise InputError(f"expected a chain of densities to begin with a step from HU, got {name}: {step.describe()}")
    return DensityRelation(step.gives, step.slope, step.intercept, step.source, (step,))


def conversion(name: str) -> Step:
    """Find a conversion by its name; raises InputError where there is none."""
    if name not in conversions():
        raise InputError(f"expected a density step of {', '.join(conversions())}, got {name!r}")
    return conversions()[name]


@lru_cache(maxsize=1)
def conversions() -> Mapping[str, Step]:
    """Read the steps that come with the package, by name."""
    text = resources.files("gpubspline.material").joinpath("conversions.toml").read_text(encoding="utf-8")
    return MappingProxyType({name: _step(name, table) for name, table in parse(text, "the conversions").items()})


def _step(name: str, table: Any) -> Step:
    fields = checked(
        table,
        f"the step {name}",
        required={"takes": str, "gives": str, "source": str},
        optional={"slope": float, "intercept": float, "points": list, "unconfirmed": list},
    )
    if "points" in fields:
        (x_0, y_0), (x_1, y_1) = (pair(point, f"a point of {name}") for point in fields.pop("points"))
        fields["slope"] = (y_1 - y_0) / (x_1 - x_0)
        fields["intercept"] = y_0 - fields["slope"] * x_0
    return Step(name, **fields | {"unconfirmed": tuple(fields.get("unconfirmed", ()))})
