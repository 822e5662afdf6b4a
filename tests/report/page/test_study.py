"""A study in a report: every mesh in the table, every quantity a curve, limits with their reasons."""

import numpy as np
import pytest

from gpubspline.analysis.convergence import QUANTITIES, converge
from gpubspline.report.page.study import study_parts


def test_a_study_becomes_a_table_and_curves() -> None:
    models = []
    for n in (5, 9, 17):
        size = 1 / (n - 1)
        model = {name: 10.0 + 4 * size**2 for name in QUANTITIES} | {"strain_energy_nmm": 1.0 + size}
        model |= {"samples": (n, n, n), "elements": (n - 1) ** 3, "unknowns": 3 * n**3, "max_von_mises_is": "the most"}
        models.append(model)
    parts = study_parts(converge(models))
    table, ends = parts["tables"]
    assert [row[0] for row in table.rows] == ["5 x 5 x 5", "9 x 9 x 9", "17 x 17 x 17"]
    assert all(len(row) == len(table.columns) for row in table.rows) and "the most" in table.note
    assert (
        table.rows[0][-1] == f"{100 * ((10 + 4 / 16) / (10 + 4 / 256) - 1):+.2f} %" and table.rows[-1][-1] == "+0.00 %"
    )
    assert [row[1] for row in ends.rows] == pytest.approx([10.0, 10.0, 10.0, 1.0], rel=1e-6)
    assert [row[2] for row in ends.rows] == pytest.approx([2.0, 2.0, 2.0, 1.0], rel=1e-6)
    x, y = parts["curves"][0].series["maximum von Mises stress"]
    assert x == [64.0, 512.0, 4096.0] and y[-1] == 0.0 and np.all(np.diff(y) < 0)
