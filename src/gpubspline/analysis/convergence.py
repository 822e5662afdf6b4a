"""What a study's models tell together: changes against the finest, limits and observed orders; as JSON and CSV."""

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gpubspline.analysis.richardson import Extrapolation, extrapolate
from gpubspline.files import whole_file

QUANTITIES = {
    "max_von_mises_mpa": "maximum von Mises stress",
    "p99_von_mises_mpa": "99th percentile of von Mises stress",
    "max_displacement_mm": "greatest displacement",
    "strain_energy_nmm": "strain energy",
}
"""What is followed through the meshes."""

COLUMNS = (
    "elements",
    "unknowns",
    *QUANTITIES,
    "max_von_mises_at_point_mpa",
    "iterations",
    "seconds",
    "peak_memory_mb",
)
"""Of the CSV, after the samples and before the changes."""


@dataclass(frozen=True)
class Convergence:
    """A study's models together.

    Attributes
    ----------
    models: figures of each, see ``run_study``, by growing number of elements.
    changes: (n,) of each of ``QUANTITIES``, (value - finest) / finest: the paper's Delta sigma_v of the stress.
    limits: at elements of no size, of each of ``QUANTITIES``.
    """

    models: tuple[dict[str, Any], ...]
    changes: dict[str, tuple[float, ...]]
    limits: dict[str, Extrapolation]

    @property
    def last_change(self) -> float:
        """Of the maximum von Mises stress from the last mesh but one to the finest, as a share."""
        return abs(self.changes["max_von_mises_mpa"][-2])

    def monotone_from(self, name: str = "max_von_mises_mpa") -> int:
        """Number of elements from which on a quantity only grows or only falls."""
        steps = np.sign(np.diff([model[name] for model in self.models]))
        turns = np.flatnonzero(steps != steps[-1])
        return int(self.models[turns[-1] + 1 if len(turns) else 0]["elements"])

    def to_dict(self) -> dict[str, Any]:
        """Plain values, for JSON."""
        finest = self.models[-1]
        return {
            "load_case": finest["load_case"],
            "element_type": finest["element_type"],
            "modulus": finest["modulus"],
            "formulation": finest["formulation"],
            "max_von_mises_is": finest["max_von_mises_is"],
            "p99_von_mises_is": finest["p99_von_mises_is"],
            "reference_elements": finest["elements"],
            "last_change_of_max_von_mises": self.last_change,
            "max_von_mises_monotone_from_elements": self.monotone_from(),
            "limits": {name: found.to_dict() for name, found in self.limits.items()},
            "models": [
                model | {f"change_of_{name}": change[number] for name, change in self.changes.items()}
                for number, model in enumerate(self.models)
            ],
        }


def converge(models: Sequence[dict[str, Any]]) -> Convergence:
    """Compare a study's models, two or more; sizes are the cube root of 1 over the number of elements."""
    ordered = tuple(sorted(models, key=lambda model: model["elements"]))
    size = [model["elements"] ** (-1 / 3) for model in ordered]
    changes, limits = {}, {}
    for name in QUANTITIES:
        values = [float(model[name]) for model in ordered]
        changes[name] = tuple(value / values[-1] - 1 for value in values)
        limits[name] = extrapolate(size, values)
    return Convergence(ordered, changes, limits)


def write_csv(found: Convergence, path: Path) -> None:
    """Write a row a model, whole or not at all."""
    heads = ["samples_u", "samples_v", "samples_w", *COLUMNS, *(f"change_of_{name}" for name in QUANTITIES)]
    with whole_file(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(heads)
        for number, model in enumerate(found.models):
            changes = [found.changes[name][number] for name in QUANTITIES]
            writer.writerow([*model["samples"], *(model[name] for name in COLUMNS), *changes])
