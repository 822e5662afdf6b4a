"""A mesh before and after as a table of a report."""

from gpubspline.mesh.quality import Quality
from gpubspline.report.page.account import Table
from gpubspline.report.page.charts import percent


def compared(before: Quality, after: Quality, title: str, note: str = "") -> Table:
    """Give the figures of two qualities beside each other."""
    rows = [
        ("least scaled Jacobian", f"{before.min:.4f}", f"{after.min:.4f}"),
        ("mean", f"{before.mean:.4f}", f"{after.mean:.4f}"),
        ("above 0.5", percent(before.fraction_above_0_5), percent(after.fraction_above_0_5)),
        ("below 0.2", percent(before.fraction_below_0_2), percent(after.fraction_below_0_2)),
        ("below 0.1", percent(before.fraction_below_0_1), percent(after.fraction_below_0_1)),
        ("inverted", before.inverted, after.inverted),
    ]
    return Table(title, ("", "before", "after"), rows, note)
