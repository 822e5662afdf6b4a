"""Outliers, and the table and the page that show them."""

import csv
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import median_abs_deviation

from gpubspline.batch.outliers import FEWEST, LIMIT, modified_z_scores, outliers
from gpubspline.batch.page import write_page
from gpubspline.batch.record import Record
from gpubspline.batch.table import write_table


def record(name: str, least: float, volume: float, **known: object) -> Record:
    mesh = {"scaled_jacobian": {"min": least, "inverted": 0}, "volume_mm3": {"mesh": volume}, "elements": 5610}
    return Record(name, "f" * 64, figures={"mesh": mesh | {"element_type": "hex8"}}, **known)  # type: ignore[arg-type]


def cohort(n: int = 40) -> list[Record]:
    rng = np.random.default_rng(3)
    least, volume = rng.normal(0.4, 0.02, n), rng.normal(5e4, 2e3, n)
    return [record(f"s{k:02}", float(a), float(b)) for k, (a, b) in enumerate(zip(least, volume, strict=True))]


def test_scores_are_scaled_median_deviations() -> None:
    values = np.random.default_rng(0).normal(7.0, 3.0, 501)
    expected = (values - np.median(values)) / median_abs_deviation(values, scale="normal")
    assert np.allclose(modified_z_scores(values.tolist()), expected, rtol=1e-4)
    moved = modified_z_scores((100 - 5 * values).tolist())
    assert np.allclose(moved, -expected, rtol=1e-4)  # of any unit and origin


def test_scores_where_most_values_are_one() -> None:
    scores = modified_z_scores([2.0] * 20 + [3.0])
    assert np.all(scores[:20] == 0) and scores[20] > LIMIT
    assert not modified_z_scores([2.0] * 20).any()
    assert not modified_z_scores([1.0] * (FEWEST - 2) + [1e9]).any() and modified_z_scores([]).size == 0


def test_only_the_bad_side_counts() -> None:
    assert outliers(cohort()) == {}
    odd = [record("worst", 0.1, 5e4), record("best", 0.9, 5e4), record("large", 0.4, 9e4), record("small", 0.4, 1e4)]
    failed = record("failed", -1.0, 1e9, error="no model")
    expected = {"worst": ["scaled_jacobian_min"], "large": ["volume_mm3"], "small": ["volume_mm3"]}
    assert outliers([*cohort(), *odd, failed]) == expected


def weighed(records: list[Record], kind: str, mass: float) -> list[Record]:
    """The same subjects with masses of a kind, scattered about one."""
    masses = mass * (1 + 0.04 * np.random.default_rng(1).uniform(-1, 1, len(records)))
    made = []
    for known, of in zip(records, masses, strict=True):
        mesh = known.figures["mesh"] | {"mass_g": float(of), "mass_density": kind}
        made.append(replace(known, subject=f"{known.subject}-{kind}", figures={"mesh": mesh}))
    return made


def test_masses_of_unlike_densities_are_not_compared(tmp_path: Path) -> None:
    """Ash is 0.6 of what bone weighs: a few subjects by another law are no outliers, one of their own kind is."""
    wet, ash = weighed(cohort(), "apparent", 100.0), weighed(cohort(8), "ash", 60.0)
    assert outliers([*wet, *ash]) == {}
    (odd,) = weighed([record("odd", 0.4, 5e4)], "ash", 100.0)  # wet, it would be the median
    assert outliers([*wet, *ash, odd]) == {"odd-ash": ["mass_g"]}
    write_table([*wet, *ash, odd], tmp_path / "cohort.csv")
    with (tmp_path / "cohort.csv").open(newline="") as file:
        assert {row["mass_density"] for row in csv.DictReader(file)} == {"apparent", "ash"}
    write_page([*wet, *ash, odd], 49, tmp_path / "cohort.html")
    text = (tmp_path / "cohort.html").read_text()
    assert "Mass, g, wet" in text and "Mass, g, mineral alone" in text and text.count("Mass is") == 1
    write_page(wet, 40, tmp_path / "cohort.html")
    text = (tmp_path / "cohort.html").read_text()
    assert "<h3>Mass, g</h3>" in text and "Mass is" not in text and "own kind" not in text


def test_table_has_a_row_a_subject(tmp_path: Path) -> None:
    records = [*cohort(), record("odd", 0.4, 9e4), Record("bad", "0" * 64, error='a "quoted", reason')]
    write_table(records, tmp_path / "cohort.csv")
    with (tmp_path / "cohort.csv").open(newline="") as file:
        rows = {row["subject"]: row for row in csv.DictReader(file)}
    assert list(rows) == [r.subject for r in records]
    assert rows["odd"]["outlier_in"] == "volume_mm3" and float(rows["odd"]["volume_mm3"]) == 9e4
    assert rows["bad"]["status"] == "failed" and rows["bad"]["error"] == 'a "quoted", reason'
    assert rows["s00"]["stiffness_n_per_mm"] == rows["bad"]["volume_mm3"] == ""


class Page(HTMLParser):
    """Counts elements, and checks that each that is opened is closed."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.open: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in ("meta", "link", "br"):
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def test_page_needs_nothing_else(tmp_path: Path) -> None:
    records = [*cohort(), record("odd", 0.4, 9e4), Record("bad", "0" * 64, error="expected <b> & got c")]
    write_page(records, 50, tmp_path / "cohort.html")
    text = (tmp_path / "cohort.html").read_text()
    page = Page(text)
    assert page.open == [] and not re.search(r"(?:src|href)=|url\(|https?:|@import", text)
    assert "41 models, 1 failed, 8 still to come" in text and "expected &lt;b&gt; &amp; got c" in text
    dots = [known for tag, known in page.tags if tag == "i"]
    assert len(dots) == 3 * 41  # scaled Jacobian, volume and time of each model
    assert [known["title"] for known in dots if known.get("class") == "apart"] == ["odd: 90,000"]
    assert text.count("<tr>") == 1 + len(records)


@pytest.mark.parametrize("records", [[], [Record("bad", "", error="no")], [record("one", 0.4, 5e4)]])
def test_page_of_few(tmp_path: Path, records: list[Record]) -> None:
    write_page(records, 3, tmp_path / "p.html")
    assert "None are looked for" in (tmp_path / "p.html").read_text()
