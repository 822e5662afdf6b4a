"""Laws of labels on the command line: a bar half of which is an implant, in deck, report, summary, study and cohort."""

import json
import re
from collections.abc import Callable
from pathlib import Path

import meshio
import numpy as np
import pytest
import SimpleITK as sitk

from gpubspline.batch.fingerprint import fingerprint
from gpubspline.batch.manifest import read_manifest
from gpubspline.cli import commands as commands
from gpubspline.cli import subject
from gpubspline.errors import InputError
from gpubspline.mesh.mesh import Mesh

Command = Callable[..., tuple[int, str, str]]
TITANIUM = "7=constant:E=110000,nu=0.3,rho=4.43"
SMALL = ["--control", "5,5,9", "--nodes", "5,5,9"]

PULL = """title = "Pull"
fixed = [{region = "w0"}]
force = [{region = "w1", force_n = [0, 0, 100]}]
"""


@pytest.fixture(scope="module")
def bar(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A bar of 1,000 HU in air, slices 2 to 21, labels 3 and 7 of a half each."""
    folder = tmp_path_factory.mktemp("bar")
    hu, labels = np.full((24, 12, 12), -1000, np.int16), np.zeros((24, 12, 12), np.uint8)
    hu[2:22, 2:10, 2:10] = 1000
    labels[2:12, 2:10, 2:10], labels[12:22, 2:10, 2:10] = 3, 7
    found = {}
    for name, values in (("ct", hu), ("labels", labels)):
        found[name] = folder / f"{name}.nii.gz"
        sitk.WriteImage(sitk.GetImageFromArray(values), str(found[name]))
    return found


def words(bar: dict[str, Path], *laws: str) -> list[object]:
    given = [word for law in laws for word in ("--law", law)]
    return [bar["ct"], "--mask", bar["labels"], "--labels", bar["labels"], *given]


@pytest.mark.parametrize(("method", "off"), [(["--method", "blocks", "--size", "2"], 0.03), (SMALL, 0.15)])
def test_deck_report_and_summary(
    run: Command, bar: dict[str, Path], tmp_path: Path, method: list[str], off: float
) -> None:
    deck, page, summary = tmp_path / "m.inp", tmp_path / "m.html", tmp_path / "s.json"
    written = ["-o", deck, "--report", page, "--summary", summary]
    status, out, err = run("mesh", *words(bar, TITANIUM, "keyak-1998"), *method, *written)
    assert status == 0 and "error" not in err and "left out" not in err
    assert "mapping    element-e" in out and "the set label_7: constant:E=110000,nu=0.3,rho=4.43" in out
    figures = json.loads(summary.read_text())
    rest, metal = figures["law_by_label"]
    assert (rest["set"], rest["law"]["name"]) == ("", "keyak-1998")
    assert rest["elements"] + metal["elements"] == figures["elements"]
    assert (metal["set"], metal["label"], metal["law"]["range_hu"]) == ("label_7", 7, None)
    assert metal["modulus_mpa"] == {"min": 110000, "max": 110000, "mean": 110000}
    assert abs(figures["alarms"]["mass_g"]["difference"]) < off
    assert figures["mass_density"] == figures["alarms"]["mass_g"]["density"] == "apparent"  # ash is no metal's
    assert rest["mass_by_law_g"] == pytest.approx(0.6 * rest["mass_g"], rel=1e-5)
    assert figures["mass_g"] == pytest.approx(rest["mass_g"] + metal["mass_g"], rel=1e-6)
    assert "masses are wet, by apparent density, to which" in out and "g by its law's ash density" in out
    text = deck.read_text()
    assert "** Densities are apparent: wet.\n" in text
    assert "of the rest: keyak-1998" in text and "of the set label_7: constant:E=110000" in text
    read = meshio.read(deck)
    names = [name for name in read.cell_sets if name.startswith("modulus_")]
    last = max(names, key=lambda name: int(name.split("_")[1]))  # of the last law
    own, of_metal = (np.sort(read.cell_sets[name][0]) for name in ("label_7", last))
    np.testing.assert_array_equal(own, of_metal)
    part = Mesh(read.points, "hex8", connectivity=read.cells[0].data[own])
    assert metal["elements"] == own.size and metal["mass_g"] == pytest.approx(4.43e-3 * part.volume_mm3, rel=1e-4)
    constants = re.findall(r"ELASTIC[^\n]*\n([^\n]+)", text, re.IGNORECASE)[-1].split(",")
    assert [float(value) for value in constants[:2]] == pytest.approx([110000, 0.3], rel=1e-6)
    told = page.read_text()
    assert "material of the set label_7" in told and "Law constant:E=110000" in told and "at any HU" in told
    assert re.search(r">--law</dt><dd>7=constant:E=110000,nu=0.3,rho=4.43, keyak-1998<", told)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (["--law", "5=keyak-1998"], "one of the labels 3, 7 of labels.nii.gz, got 5"),
        (["--law", "7=hooke"], "material law of wirtz-2000"),
        (["--law", ""], "material law of wirtz-2000"),
        (["--law", "7="], "expected --law LABEL=LAW, got '7='"),
        (["--law", "7=keyak-1998", "--law", "7=constant:E=1,nu=0"], "one --law for the label 7"),
        (["--law", "7=keyak-1998", "--law", "07=constant:E=1,nu=0"], "one law for the label 7 of labels.nii.gz"),
        (["--law", "keyak-1998", "--law", "wirtz-2000"], "one --law for all that has no law of its own"),
        (["--law", "7=constant:E=1"], "expected constant:E=...,nu=...[,rho=...]"),
        (["--law", TITANIUM, "--mapping", "nodal"], "with laws by label, got nodal"),
        (
            ["--law", TITANIUM, "--transverse-law", "wirtz-2000-transverse", "--mapping", "element-e"],
            "laws by label or a transverse law, got both",
        ),
    ],
)
def test_what_is_refused(run: Command, bar: dict[str, Path], tmp_path: Path, given: list[str], message: str) -> None:
    status, _, err = run("mesh", *words(bar), *given, *SMALL, "-o", tmp_path / "m.vtu")
    assert status == 2 and message in err and err.count("\n") == 1 and not list(tmp_path.iterdir())


def test_labels_of_one_name(run: Command, bar: dict[str, Path], tmp_path: Path) -> None:
    """Laws go by number then, and sets, decks and figures tell the two apart."""
    image = sitk.ReadImage(bar["labels"])
    for place, number in enumerate((3, 7)):
        for key, value in {"ID": f"Segment_{place}", "LabelValue": str(number), "Name": "bone", "Layer": "0"}.items():
            image.SetMetaData(f"Segment{place}_{key}", value)
    named, summary, deck = tmp_path / "named.seg.nrrd", tmp_path / "s.json", tmp_path / "m.inp"
    sitk.WriteImage(image, named)
    laws = ["--law", TITANIUM, "--law", "3=keyak-1998"]
    given = [bar["ct"], "--mask", named, "--labels", named, *laws, *SMALL]
    status, _, err = run("mesh", *given, "-o", deck, "--summary", summary)
    assert status == 0, err
    parts = json.loads(summary.read_text())["law_by_label"]
    found = {part["set"]: (part["label"], part["law"]["name"].partition(":")[0]) for part in parts}
    assert found == {"bone": (3, "keyak-1998"), "bone_7": (7, "constant")}
    assert "of the set bone: keyak-1998" in deck.read_text() and "of the set bone_7: constant" in deck.read_text()


def test_labels_are_needed(run: Command, bar: dict[str, Path], tmp_path: Path) -> None:
    given = [bar["ct"], "--mask", bar["labels"], "--law", TITANIUM]
    status, _, err = run("mesh", *given, *SMALL, "-o", tmp_path / "m.vtu")
    assert status == 2 and "expected --labels FILE with the law of a label, 7, got none" in err
    model = tmp_path / "m.npz"
    assert run("fit", bar["ct"], "--control", "5,5,8", "-o", model)[0] == 0
    status, _, err = run("sample", model, "--law", TITANIUM, "-o", tmp_path / "m.vtu")
    assert status == 2 and "expected --labels FILE" in err


def test_a_study_goes_by_labels_and_its_key_knows_them(run: Command, bar: dict[str, Path], tmp_path: Path) -> None:
    load, out = tmp_path / "pull.toml", tmp_path / "study"
    load.write_text(PULL)
    rest = ["--control", "5,5,9", "--nodes-list", "3x3x5 4x4x9", "--load", load, "-o", out]

    def energy(*laws: str) -> float:
        status, _, err = run("study", *words(bar, *laws), *rest)
        assert status == 0 and "error" not in err
        return float(json.loads((out / "study.json").read_text())["models"][-1]["strain_energy_nmm"])

    soft, hard = "constant:E=1000,nu=0", "7=constant:E=100000,nu=0"
    both = energy(soft, hard)
    assert energy(soft, "7=constant:E=1000,nu=0") == pytest.approx(2 / 1.01 * both, rel=0.1)  # springs in series
    stamps = {path: path.stat().st_mtime_ns for path in (out / "models").iterdir()}
    assert energy(soft, "7=constant:E=1000,nu=0") > both
    assert {path: path.stat().st_mtime_ns for path in stamps} == stamps
    assert energy(soft, hard) == both


def test_a_cohort_has_several_laws_in_a_cell(bar: dict[str, Path], tmp_path: Path) -> None:
    """Parted by semicolons; a law's file is found beside the manifest, and counts by its content."""
    own = tmp_path / "own.toml"
    own.write_text("one")
    row = f'bar,{bar["ct"]},{bar["labels"]},{bar["labels"]},"7=constant:E=5,nu=0; 3=own.toml"'
    (tmp_path / "cohort.csv").write_text(f"subject,input,mask,labels,law\n{row}\n")
    (read,) = read_manifest(tmp_path / "cohort.csv", subject.columns())
    subject.check(read, tmp_path / "cohort.csv")
    (mesh,) = subject.commands(read, tmp_path, "auto", {})
    assert [word for word in mesh if word.startswith("--law=")] == ["--law=7=constant:E=5,nu=0", f"--law=3={own}"]
    before = fingerprint(read, {})
    assert own in read.files and fingerprint(read, {}) == before
    own.write_text("other")
    assert fingerprint(read, {}) != before
    (tmp_path / "cohort.csv").write_text(f"subject,input,mask,labels,law\n{row.replace('own', 'none')}\n")
    with pytest.raises(InputError, match=r"existing file for bar, line 2 of cohort.csv, got .*none\.toml"):
        read_manifest(tmp_path / "cohort.csv", subject.columns())


def test_a_deck_by_element_is_not_called_one_by_node(run: Command, bar: dict[str, Path], tmp_path: Path) -> None:
    load = tmp_path / "pull.toml"
    load.write_text(PULL)
    for mapping in ("element", "node"):
        how = ["--mapping", "element-e" if mapping == "element" else "nodal-e"]
        status, out, _ = run("mesh", *words(bar)[:3], *SMALL, *how, "--load", load, "-o", tmp_path / "m.feb")
        assert status == 0 and f"modulus by {mapping}\n" in out


def test_gravity_on_what_is_no_weight_is_warned_of(run: Command, bar: dict[str, Path], tmp_path: Path) -> None:
    load, made = tmp_path / "weight.toml", {"mesh": tmp_path / "m.inp", "solve": tmp_path / "s.vtu"}
    load.write_text('fixed = [{region = "w0"}]\ngravity = {acceleration_mm_s2 = [0, 0, -9810]}\n')
    words_of = "gravity pulls at the ash density of the law, the mineral alone, which is not what bone weighs"
    for command, output in made.items():
        for law, warned in (("keyak-1998", True), ("wirtz-2000", False)):
            how = [*words(bar)[:3], *SMALL, "--law", law, "--load", load, "-o", output]
            status, _, err = run(command, *how)
            assert status == 0 and (words_of in err) == warned
            assert command == "solve" or ("Gravity takes them for weight" in output.read_text()) == warned
