"""The cohort's table: a CSV file, a row a subject, figures that its models are compared by."""

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from gpubspline.batch.outliers import QUANTITIES, look_up, outliers
from gpubspline.batch.record import Record
from gpubspline.files import whole_file

_MESH = ("elements", "nodes", "element_type", "threshold_hu", "out_of_range_nodes")
_COUNTED = {
    "inverted": ("mesh", "scaled_jacobian", "inverted"),
    "below_0.1": ("mesh", "scaled_jacobian", "fraction_below_0.1"),
    "law": ("mesh", "law", "name"),
    "mass_density": ("mesh", "mass_density"),
    "displacement_max_mm": ("solve", "max_displacement_mm"),
    "von_mises_max_mpa": ("solve", "max_von_mises_mpa"),
}


def table(records: Sequence[Record]) -> list[dict[str, Any]]:
    """Rows of the table, one a subject, all with the same columns; what is not known is an empty text."""
    apart = outliers(records)
    return [_row(record, apart.get(record.subject, [])) for record in records]


def _row(record: Record, apart: Sequence[str]) -> dict[str, Any]:
    row: dict[str, Any] = {
        "subject": record.subject,
        "status": "failed" if record.failed else "done",
        "outlier_in": " ".join(apart),
        "error": record.error,
        "warnings": " | ".join(record.warnings),
    }
    row |= {name: look_up(record.figures, ("mesh", name)) for name in _MESH}
    row |= {name: look_up(record.figures, path) for name, path in _COUNTED.items()}
    row |= {quantity.name: quantity.of(record) for quantity in QUANTITIES}
    row |= {
        "device": look_up(record.figures, ("mesh", "device")) or record.device,
        "worker": record.worker,
        "fingerprint": record.fingerprint,
    }
    return {name: "" if value is None else value for name, value in row.items()}


def write_table(records: Sequence[Record], path: Path) -> None:
    """Write the table as CSV, whole or not at all."""
    rows = table(records)
    with whole_file(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
