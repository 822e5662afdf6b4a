"""Reports of the commands: what they hold, and what they never hold."""

import json
import re
import shutil
from collections.abc import Callable
from importlib import resources
from pathlib import Path

import pydicom
import pytest

from gpubspline.ct.phantom_dicom import write_phantom

Command = Callable[..., tuple[int, str, str]]
FEMUR = ["--control", "9,9,14", "--nodes", "9,9,14"]


@pytest.fixture(scope="module")
def femur(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The child femur, of a patient with a name, in a folder of that name, with a slice missing."""
    folder = tmp_path_factory.mktemp("Hannelore") / "Mustermann_Hannelore"
    write_phantom("child-femur", folder)
    for path in sorted(folder.iterdir()):
        dataset = pydicom.dcmread(path)
        dataset.PatientName, dataset.PatientID = "Mustermann^Hannelore", "4711-0815"
        dataset.save_as(path)
    sorted(folder.iterdir())[20].unlink()
    return folder


def data_of(text: str) -> dict[str, object]:
    found = re.search(r'<script type="application/json" id="data">(.*?)</script>', text, re.S)
    assert found
    loaded: dict[str, object] = json.loads(found[1])
    return loaded


def test_report_of_a_mesh_holds_the_run_and_no_patient(run: Command, femur: Path, tmp_path: Path) -> None:
    page = tmp_path / "Mustermann.html"
    given = ["-o", tmp_path / "Hannelore.vtu", "--report", page, *FEMUR, "--allow-gaps"]
    status, out, err = run("mesh", femur, *given, "--law", "morgan-2003-femoral-neck")
    assert status == 0 and "Mustermann.html" in out and "warning" in err
    text = page.read_text(encoding="utf-8")
    for word in ("mustermann", "hannelore", "4711"):
        assert word not in text.lower(), word
    typed = re.search(r"<pre>(gpubspline mesh INPUT [^<]*)</pre>", text)
    assert typed and "Mustermann" not in typed[1]
    for words in ("--allow-gaps", "--control 9,9,14", "--nodes 9,9,14", "--law morgan-2003-femoral-neck"):
        assert words in typed[1]
    assert "--output FILE.vtu" in typed[1] and "--report FILE.html" in typed[1]
    assert "<dt class=given>--law</dt><dd>morgan-2003-femoral-neck</dd>" in text
    assert "<dt>--smooth-rows</dt><dd>1.5</dd>" in text and "<dt>--threshold</dt><dd>Otsu&#x27;s threshold</dd>" in text
    assert "Morgan, Bayraktar, Keaveny, J Biomech 36 (2003) 897-904" in text
    warned = text[: text.index("<main>")]
    assert re.search(r"<li>[^<]*slice", warned) and "not confirmed from its source" in warned  # the gap, and the law
    for words in (r"<b>\d+ × \d+ × 99 mm</b>", r"<b>[\d.]+ cm³</b><span>volume", r"<b>[\d.]+ g</b><span>mass, by"):
        assert re.search(words, warned), words  # what a clinician knows of a child's femur
    data = data_of(text)
    assert len(data["slices"]["views"]) == 3 and len(data["scene"]["worst"]) == 10  # type: ignore[index, call-overload]


def test_report_of_a_solved_mesh(run: Command, femur: Path, tmp_path: Path) -> None:
    files = ["-o", tmp_path / "s.vtu", "--report", tmp_path / "s.html"]
    assert run("mesh", femur, *FEMUR, "--allow-gaps", "-o", tmp_path / "m.vtu")[0] == 0
    stance = resources.files("gpubspline.analysis").joinpath("stance.toml").read_text(encoding="utf-8")
    (tmp_path / "Mustermann.toml").write_text(stance, encoding="utf-8")
    assert run("solve", tmp_path / "m.vtu", "--load", tmp_path / "Mustermann.toml", *files)[0] == 0
    text = (tmp_path / "s.html").read_text(encoding="utf-8")
    assert "Single-legged stance: 832 hex8 solved" in text and "femoral head" in text
    assert "greatest von Mises stress" in text and "gpubspline solve INPUT --load FILE.toml" in text
    assert "mustermann" not in text.lower()
    scene = data_of(text)["scene"]
    names = [field["name"] for field in scene["fields"]]  # type: ignore[index, call-overload]
    assert names == ["von_mises_mpa", "HU", "E_MPa", "displacement_mm", "density_g_cm3", "scaled_jacobian"]


def test_report_of_a_mesh_file(run: Command, femur: Path, tmp_path: Path) -> None:
    assert run("mesh", femur, *FEMUR, "--allow-gaps", "-o", tmp_path / "m.vtu")[0] == 0
    assert run("quality", tmp_path / "m.vtu", "--report", tmp_path / "q.html")[0] == 0
    text = (tmp_path / "q.html").read_text(encoding="utf-8")
    assert "Quality of 832 hex8" in text and "gpubspline quality FILE.vtu --report FILE.html" in text
    assert run("quality", tmp_path / "m.vtu", "--report", tmp_path / "m.vtu")[0] == 2


def test_report_of_an_optimized_mesh(run: Command, femur: Path, tmp_path: Path) -> None:
    assert run("mesh", femur, *FEMUR, "--allow-gaps", "-o", tmp_path / "m.vtu")[0] == 0
    words = ["optimize", tmp_path / "m.vtu", "-o", tmp_path / "o.vtu", "--report", tmp_path / "o.html"]
    status, out, _ = run(*words, "--summary", tmp_path / "o.json")
    assert status == 0 and "o.html" in out
    text = (tmp_path / "o.html").read_text(encoding="utf-8")
    row = re.search(r"<td>least scaled Jacobian</td><td>([\d.]+)</td><td>([\d.]+)</td>", text)
    assert row and 0 < float(row[1]) < float(row[2])
    after = json.loads((tmp_path / "o.json").read_text(encoding="utf-8"))["scaled_jacobian"]["min"]
    assert float(row[2]) == pytest.approx(after, abs=1e-4) and "Optimized: 832 hex8" in text


def test_report_of_a_study(run: Command, femur: Path, tmp_path: Path) -> None:
    given = ["--allow-gaps", "--control", "9,9,14", "--load", "stance", "--nodes-list", "5x5x8 6x6x9 7x7x10"]
    assert run("study", femur, *given, "-o", tmp_path / "study", "--report", tmp_path / "s.html")[0] == 0
    text = (tmp_path / "s.html").read_text(encoding="utf-8")
    assert "Single-legged stance: 3 meshes, the finest of 324 hex8" in text
    assert "<td>5 x 5 x 8</td><td>112</td>" in text and "change against the finest (%)" in text
    assert "--nodes-list 5x5x8 6x6x9 7x7x10" in text and "mustermann" not in text.lower()


def test_a_mesh_written_in_slabs_is_told_apart_from_the_coarser_one_shown(
    run: Command, femur: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gpubspline.streaming.LOOKED_AT", 8)
    files = ["-o", tmp_path / "m.vts", "--report", tmp_path / "m.html"]
    assert run("mesh", femur, *FEMUR, "--allow-gaps", *files)[0] == 0
    text = (tmp_path / "m.html").read_text(encoding="utf-8")
    assert "Mesh of 832 hex8" in text
    scene = data_of(text)["scene"]
    assert "coarser one of 343 elements is shown" in scene["note"] and scene["worst"] == []  # type: ignore[index, call-overload]


@pytest.mark.parametrize(
    ("page", "message"),
    [("page.pdf", "ends in .html"), ("none/page.html", "does not exist"), ("m.vtu", "ends in .html")],
)
def test_bad_pages_are_refused_before_the_work(
    run: Command, femur: Path, tmp_path: Path, page: str, message: str
) -> None:
    status, out, err = run("mesh", femur, "-o", tmp_path / "m.vtu", "--report", tmp_path / page)
    assert (status, out) == (2, "") and message in err and err.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_a_report_does_not_replace_an_input(run: Command, femur: Path, tmp_path: Path) -> None:
    shutil.copy(next(femur.iterdir()), tmp_path / "scan.html")
    status, _, err = run("mesh", tmp_path / "scan.html", "-o", tmp_path / "m.vtu", "--report", tmp_path / "scan.html")
    assert status == 2 and "a file of its own" in err
