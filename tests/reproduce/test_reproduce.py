"""The paper's results: what is asked for is made, once; the page needs nothing else; the study converges as told."""

import json
import re
from collections.abc import Callable
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path

import pytest

from gpubspline.clock import Clock
from gpubspline.device import open_device
from gpubspline.errors import InputError
from gpubspline.reproduce import run as reproduction
from gpubspline.reproduce.markup import percent, table
from gpubspline.reproduce.paper import FIGURES, MODELS, STUDY_SAMPLES, TABLE
from gpubspline.reproduce.run import NAMES, pictures, reproduce

Command = Callable[..., tuple[int, str, str]]
REDUCED = ((6, 7, 11), (8, 9, 14), (10, 11, 17))
"""The study's first meshes and coarser ones, for a test that is not slow."""


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with three figures and a reduced study."""
    folder = tmp_path_factory.mktemp("reproduce") / "out"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(reproduction, "STUDY_SAMPLES", REDUCED)
        reproduce(folder, open_device(), Clock(), ["fig7", "fig10", "fig13"])
    return folder


def test_the_table_is_the_papers() -> None:
    """Counts of elements follow from the samples; the paper's figures are those of its text."""
    for name in TABLE:
        model, product = MODELS[name], 1
        for n in model.samples:
            product *= n - 1
        assert product == model.elements
    counts = [(u - 1) * (v - 1) * (w - 1) for u, v, w in STUDY_SAMPLES]
    assert len(counts) == 11 and {1350, 12000, 27000} <= set(counts) and counts == sorted(counts)
    for one, other in pairwise(STUDY_SAMPLES):
        assert all(a < b for a, b in zip(one, other, strict=True))
    assert [figure.number for figure in FIGURES] == [3, 4, 5, 6, 7, 8, 9, 10, 11] and NAMES[-1] == "fig13"


def test_what_was_asked_for_is_there(made: Path) -> None:
    numbers = json.loads((made / "reproduce.json").read_text())
    assert list(numbers["figures"]) == ["fig7", "fig10", "fig13"]
    child = numbers["figures"]["fig7"]["models"][0]
    assert child["elements"] == child["paper"]["elements"] == 5610 and child["inverted"] == 0
    assert child["percent_above_0.5"] > 76 and child["percent_below_0.1"] < 10.5
    study = numbers["figures"]["fig13"]["study"]
    assert [model["elements"] for model in study["models"]] == [5 * 6 * 10, 7 * 8 * 13, 9 * 10 * 16]
    files = [file for part in numbers["figures"].values() for file in part["pictures"]]
    assert "fig10-distal-slice-E_MPa.png" in files and "fig13-study.png" in files
    assert all((made / file).read_bytes()[:4] == b"\x89PNG" for file in files)
    assert (made / "study" / "study.csv").read_text().count("\n") == 4


def test_the_page_needs_nothing_else_and_is_well_formed(made: Path) -> None:
    text = (made / "reproduce.html").read_text(encoding="utf-8")
    assert not re.search(r"(src|href)=\"(?!data:image/png;base64,|#)", text) and "url(" not in text
    for words in (
        "Fig. 7",
        "76 % above 0.5",
        "Where this graph is not the paper",
        "prefers-color-scheme: dark",
        "5,610",
    ):
        assert words in text
    assert "Not made yet: Fig. 3, Fig. 4" in text and str(made) not in text
    assert text.count("<img ") == 4 and text.count('alt="') == 4

    class Balanced(HTMLParser):
        open: list[str] = []

        def handle_starttag(self, tag: str, attrs: object) -> None:
            if tag not in ("meta", "img"):
                self.open.append(tag)

        def handle_endtag(self, tag: str) -> None:
            assert self.open.pop() == tag

    parser = Balanced()
    parser.feed(text)
    assert parser.open == []


def test_a_run_goes_on_and_makes_nothing_twice(made: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reproduction, "STUDY_SAMPLES", REDUCED)
    kept = {path: path.stat().st_mtime_ns for path in made.rglob("*.png") if path.name != "fig13-study.png"}
    kept |= {path: path.stat().st_mtime_ns for path in (made / "study" / "models").iterdir()}

    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("a picture that is there was made again")

    monkeypatch.setattr(reproduction, "write_picture", refuse)
    reproduce(made, open_device(), Clock(), ["fig7", "fig10", "fig13"])
    assert {path: path.stat().st_mtime_ns for path in kept} == kept


def test_a_run_that_was_stopped_keeps_whole_figures(made: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reproduction, "STUDY_SAMPLES", REDUCED)
    figure = next(figure for figure in FIGURES if figure.name == "fig10")
    first, second = (made / file for _, _, file in pictures(figure))
    second.unlink()
    real, stop = reproduction.write_picture, [False]

    def interrupted(mesh: object, path: Path, **how: object) -> None:
        if Path(path) == second and not stop[0]:
            stop[0] = True
            raise KeyboardInterrupt
        real(mesh, path, **how)

    monkeypatch.setattr(reproduction, "write_picture", interrupted)
    with pytest.raises(KeyboardInterrupt):
        reproduce(made, open_device(), Clock(), ["fig10"])
    assert first.exists() and not second.exists()
    reproduce(made, open_device(), Clock(), ["fig10"])
    assert second.exists()


def test_unknown_figures_are_refused_before_anything_is_written(run: Command, tmp_path: Path) -> None:
    for words, message in [
        (("--only", "fig12"), "expected figures of fig3, fig4"),
        (("-o", tmp_path / "no" / "out"), "an existing folder"),
    ]:
        status, out, err = run("reproduce", "-o", tmp_path / "out", *words)
        assert (status, out) == (2, "") and message in err and err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(InputError, match="figures of fig3"):
        reproduce(tmp_path / "out", open_device(), Clock(), ["all"])


def test_percents_do_not_round_to_all_or_none() -> None:
    assert [percent(v) for v in (0, 0.01, 12.34, 76.0, 99.95, 100)] == ["0", "< 0.1", "12.3", "76", "> 99.9", "100"]
    assert "<td>a &lt; b</td>" in table(["x"], [["a < b"]])


@pytest.mark.slow
def test_the_study_of_eleven_models_converges(tmp_path: Path) -> None:
    """Item by item what the study has to hold: monotone by 12,000 elements, the last refinement below 1 %."""
    numbers = reproduce(tmp_path / "out", open_device(), Clock(), ["fig13"])
    study = numbers["figures"]["fig13"]["study"]
    elements = [model["elements"] for model in study["models"]]
    assert len(elements) == 11 and elements[0] == 1350 and elements[6] == 12000 and elements[-1] == 27000
    assert study["max_von_mises_monotone_from_elements"] <= 12000
    assert study["last_change_of_max_von_mises"] < 0.01
    change = [model["change_of_max_von_mises_mpa"] for model in study["models"]]
    assert change[0] > 0.1 and all(abs(c) < 0.02 for c in change[6:])
    energy = [model["strain_energy_nmm"] for model in study["models"]]
    assert all(a > b for a, b in pairwise(energy[:8]))  # without modes it falls, then rises
    limit = study["limits"]["max_von_mises_mpa"]
    assert limit["order"] is not None and abs(limit["limit"] / study["models"][-1]["max_von_mises_mpa"] - 1) < 0.03
