"""Subjects whose figures stand apart from those of the others."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gpubspline.batch.record import Record

LIMIT = 3.5
"""Of the modified z-score, as recommended by Iglewicz and Hoaglin, How to Detect and Handle Outliers (1993)."""

FEWEST = 5
"""Subjects below which nothing is called an outlier."""


@dataclass(frozen=True)
class Quantity:
    """A figure that subjects are compared by.

    Attributes
    ----------
    name: of its column, with the unit.
    title: for a person.
    path: keys to it in a record's figures.
    sides: ``"both"``, or the one on which standing apart is bad: ``"low"`` or ``"high"``.
    kind: keys to what it is of, where subjects of unlike kinds have nothing to be compared by.
    """

    name: str
    title: str
    path: tuple[str, ...]
    sides: str = "both"
    kind: tuple[str, ...] = ()

    def of(self, record: Record) -> float | None:
        """Value of a subject; None where it has none."""
        value = look_up({**record.figures, "seconds": record.seconds}, self.path)
        return None if value is None else float(value)

    def by_kind(self, records: Sequence[Record]) -> dict[str, list[tuple[str, float]]]:
        """Names and values of the subjects that have a model and one, by what they are of."""
        found: dict[str, list[tuple[str, float]]] = {}
        for record in records:
            value = None if record.failed else self.of(record)
            if value is not None:
                kind = look_up(record.figures, self.kind) if self.kind else ""
                found.setdefault(str(kind or ""), []).append((record.subject, value))
        return found


def look_up(figures: Mapping[str, Any], path: Sequence[str]) -> Any:
    """Figure at the end of a path of keys; None where the path does."""
    value: Any = figures
    for key in path:
        value = value.get(key) if isinstance(value, Mapping) else None
    return value


QUANTITIES = (
    Quantity("scaled_jacobian_min", "Least scaled Jacobian", ("mesh", "scaled_jacobian", "min"), "low"),
    Quantity("above_0.5", "Share of elements above 0.5", ("mesh", "scaled_jacobian", "fraction_above_0.5"), "low"),
    Quantity(
        "surface_distance_mm", "Mean distance from the region, mm", ("mesh", "surface_distance_mm", "mean"), "high"
    ),
    Quantity("volume_mm3", "Volume, mm³", ("mesh", "volume_mm3", "mesh")),
    Quantity("mass_g", "Mass, g", ("mesh", "mass_g"), kind=("mesh", "mass_density")),
    Quantity("modulus_mean_mpa", "Mean Young's modulus, MPa", ("mesh", "modulus_mpa", "mean")),
    Quantity("stiffness_n_per_mm", "Stiffness, N/mm", ("solve", "stiffness_n_per_mm")),
    Quantity("von_mises_p99_mpa", "von Mises stress, 99 % of the volume, MPa", ("solve", "p99_von_mises_mpa")),
    Quantity("seconds", "Time, s", ("seconds",), "high"),
)


def outliers(records: Sequence[Record]) -> dict[str, list[str]]:
    """Names of the quantities by which each subject stands apart, by subject; those of none are left out.

    Masses of ash and of wet bone are no one distribution: each is compared with those of its own kind of density.
    """
    found: dict[str, list[str]] = {}
    for quantity in QUANTITIES:
        for known in quantity.by_kind(records).values():
            scores = modified_z_scores([value for _, value in known])
            for (subject, _), score in zip(known, scores, strict=True):
                if (score > LIMIT and quantity.sides != "low") or (score < -LIMIT and quantity.sides != "high"):
                    found.setdefault(subject, []).append(quantity.name)
    return found


def modified_z_scores(values: Sequence[float]) -> "np.ndarray[Any, np.dtype[np.float64]]":
    """Distance of each value (n,) from the median, in standard deviations that the median distance stands for.

    Zeros for fewer than ``FEWEST`` values. Where over half the values are one, the mean distance stands in for the
    median one, which is zero.

    Source: Iglewicz and Hoaglin 1993, section 3.3: 0.6745 is the third quartile of the standard normal distribution;
    1.2533, the ratio of its standard deviation to its mean absolute deviation.
    """
    given = np.asarray(values, dtype=np.float64)
    if given.size < FEWEST:
        return np.zeros(given.size)
    off = given - np.median(given)
    scale = np.median(np.abs(off)) / 0.6745 or np.mean(np.abs(off)) * 1.2533
    return off / scale if scale > 0 else np.zeros(given.size)
