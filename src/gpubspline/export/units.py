"""Systems of units that a deck can be written in, each consistent with Newton's law."""

import re
from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from gpubspline.errors import InputError


@dataclass(frozen=True)
class Units:
    """A consistent system; the factors turn the project's mm, MPa, g/cm3 and mm/s2 into it. Forces are N in both.

    Attributes
    ----------
    name: as ``write`` takes it.
    words: length, force, stress, mass, density, for the comment of a deck.
    per_mm, per_mpa, per_g_cm3: what one of the project's units is.
    length, stress, density: what the names of fields end in.
    """

    name: str
    words: str
    per_mm: float
    per_mpa: float
    per_g_cm3: float
    length: str
    stress: str
    density: str

    def fields(self, fields: dict[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
        """Fields whose names carry a unit, in this system and renamed to it; others as they are."""
        if self.name == DEFAULT_UNITS:
            return fields
        return dict(self._field(name, values) for name, values in fields.items())

    def _field(self, name: str, values: NDArray[Any]) -> tuple[str, NDArray[Any]]:
        if name == "strain_energy_density":  # of no unit in its name: N mm/mm3 is a stress
            return name, values * values.dtype.type(self.per_mpa)
        found = _UNIT.fullmatch(name)
        if found is None:
            return name, values
        unit, factor = {
            "mm": (self.length, self.per_mm),
            "MPa": (self.stress, self.per_mpa),
            "mpa": (self.stress.lower(), self.per_mpa),
            "g_cm3": (self.density, self.per_g_cm3),
        }[found["unit"]]
        return f"{found['of']}_{unit}{found['part']}", values * values.dtype.type(factor)


_UNIT = re.compile(r"(?P<of>.+)_(?P<unit>mm|MPa|mpa|g_cm3)(?P<part>(_([xyz]|\d+))?)")
"""A quantity, its unit, and which component or Gauss point of it the field is."""

DEFAULT_UNITS = "mm-N-MPa"
UNITS = {
    units.name: units
    for units in (
        Units(DEFAULT_UNITS, "mm, N, MPa, tonne, tonne/mm3", 1.0, 1.0, 1e-9, "mm", "MPa", "tonne_mm3"),
        Units("m-N-Pa", "m, N, Pa, kg, kg/m3", 1e-3, 1e6, 1e3, "m", "Pa", "kg_m3"),
    )
}


def find_units(name: str) -> Units:
    """System of units by name; raises InputError where there is none."""
    if name not in UNITS:
        raise InputError(f"expected units of {', '.join(UNITS)}, got {name!r}")
    return UNITS[name]
