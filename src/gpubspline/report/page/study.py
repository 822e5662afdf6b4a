"""A convergence study as a table and curves of a report."""

from typing import Any

from gpubspline.analysis.convergence import QUANTITIES, Convergence
from gpubspline.report.page.account import Curve, Table

UNITS = {
    "max_von_mises_mpa": "MPa",
    "p99_von_mises_mpa": "MPa",
    "max_displacement_mm": "mm",
    "strain_energy_nmm": "N mm",
}


def study_parts(found: Convergence) -> dict[str, Any]:
    """Give the ``tables`` and ``curves`` of an account: the models, and their changes against the finest, %."""
    columns = ("samples", "elements", "unknowns", *(f"{words} ({UNITS[name]})" for name, words in QUANTITIES.items()))
    rows = [
        (
            " x ".join(map(str, model["samples"])),
            *(model["elements"], model["unknowns"]),
            *(model[name] for name in QUANTITIES),
            *(f"{100 * found.changes[name][number]:+.2f} %" for name in ("max_von_mises_mpa",)),
        )
        for number, model in enumerate(found.models)
    ]
    note = f"The maximum is the {found.models[-1]['max_von_mises_is']}; its change is against the finest mesh."
    table = Table("Meshes of the study", (*columns, "change of the maximum"), rows, note)
    limits = [
        (f"{words} ({UNITS[name]})", limit.limit, limit.order, limit.meshes, limit.note)
        for name, words in QUANTITIES.items()
        for limit in [found.limits[name]]
    ]
    columns = ("quantity", "limit", "order", "from meshes", "why there is none")
    ends = Table("Extrapolated to elements of no size", columns, limits)
    elements = [float(model["elements"]) for model in found.models]
    lines = {words: (elements, [100 * c for c in found.changes[name]]) for name, words in QUANTITIES.items()}
    curve = Curve("Convergence", "elements", "change against the finest (%)", lines, log_x=True, note="after Fig. 13")
    return {"tables": [table, ends], "curves": [curve]}
