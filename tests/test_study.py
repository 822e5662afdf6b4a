"""The command 'study': on the child femur as the paper's section 3.6, run again, and what is refused."""

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gpubspline.analysis import study
from gpubspline.ct.image import read_volume
from gpubspline.ct.phantom_dicom import write_phantom
from gpubspline.errors import InputError

Command = Callable[..., tuple[int, str, str]]
LIST = "7x8x12 9x10x15 11x13x19"


@pytest.fixture(scope="module")
def scan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The child femur's series."""
    folder = tmp_path_factory.mktemp("study") / "ct"
    write_phantom("child-femur", folder)
    return folder


def test_a_study_from_a_ct_and_again_from_its_folder(run: Command, scan: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    words = ("study", scan, "--control", "9,11,20", "--load", "stance", "--nodes-list", LIST, "-o", out)
    status, said, err = run(*words)
    assert (status, err) == (0, "")
    assert sorted(path.name for path in out.iterdir()) == ["models", "study.csv", "study.json", "study.png"]
    told = json.loads((out / "study.json").read_text())
    assert [model["elements"] for model in told["models"]] == [6 * 7 * 11, 8 * 9 * 14, 10 * 12 * 18]
    assert told["models"][-1]["change_of_max_von_mises_mpa"] == 0 and told["formulation"] == "incompatible"
    rows = list(csv.DictReader((out / "study.csv").open()))
    assert [float(row["strain_energy_nmm"]) for row in rows] == [m["strain_energy_nmm"] for m in told["models"]]
    for model in told["models"]:
        np.testing.assert_allclose(model["applied_n"], [0, 0, -328], atol=1e-9)
        assert model["max_von_mises_mpa"] < model["max_von_mises_at_point_mpa"]
    for text in ("1,008", "2,160", "order", "over balls of 3 mm", "study.csv", "+0.00 %"):
        assert text in said
    stamps = {path: path.stat().st_mtime_ns for path in (out / "models").iterdir()}
    status, again, _ = run(*words)
    assert status == 0 and again == said and {path: path.stat().st_mtime_ns for path in stamps} == stamps
    finer = (*words[:7], f"{LIST} 12x14x21", *words[8:])
    assert run(*finer)[0] == 0 and {path: path.stat().st_mtime_ns for path in stamps} == stamps
    assert len(list((out / "models").iterdir())) == 4


def test_a_mapping_that_reads_the_ct_is_not_taken_for_that_of_the_model_file(
    run: Command, scan: Path, tmp_path: Path
) -> None:
    """Both have one hyperpatch; the CT's sharper cortex makes the stiffer bone."""
    model, out = tmp_path / "model.npz", tmp_path / "out"
    assert run("fit", scan, "--control", "9,11,20", "-o", model)[0] == 0
    words = ("--load", "stance", "--nodes-list", "5x5x9 6x7x10", "--mapping", "gauss", "-o", out)
    energies = []
    for source in ((model,), (scan, "--control", "9,11,20")):
        status, _, err = run("study", *source, *words)
        assert (status, err) == (0, "")
        energies.append(json.loads((out / "study.json").read_text())["models"][-1]["strain_energy_nmm"])
    assert energies[1] < 0.8 * energies[0]
    load, to = ("--load", "stance"), ("-o", tmp_path / "refused")
    for line in (
        ("study", model, "--threshold", 300, *load, *to),
        ("study", model, model, *load, *to),
        ("solve", model, "--degree", 2, *load, "-o", tmp_path / "refused.vtu"),
    ):
        status, said, err = run(*line)
        assert status == 2 and "one model file, without options that fit one to CT" in err and said == ""
    status, _, err = run("fit", scan, "--labels", scan, "-o", tmp_path / "refused.npz")
    assert status == 2 and "No such option: --labels" in err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["model.npz", "out"]


def test_a_calibration_counts_by_what_it_measures(
    run: Command, scan: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The mask of its rods may lie elsewhere, or hold other places under one name."""
    volume, keys = read_volume(scan), list[str]()
    (tmp_path / "here").mkdir()

    def note(*_: Any, made_from: str, **__: Any) -> None:
        keys.append(made_from)
        raise InputError("seen enough")

    def mark(shift: int) -> None:
        labels = np.zeros(volume.hu.shape, np.uint8)
        at = np.argwhere(volume.hu > 900)[0]
        labels[:, :4, shift : shift + 4], labels[tuple(at)] = 1, 2
        np.save(tmp_path / "here" / "rods.npy", labels)

    def key(folder: Path) -> str:
        status, _, err = run(
            "study", scan, "--load", "stance", "--calibration", folder / "c.toml", "-o", tmp_path / "o"
        )
        assert (status, err) == (2, "gpubspline: error: seen enough\n")
        return keys.pop()

    monkeypatch.setattr(study, "run_study", note)
    mark(0)
    rods = "".join(f"[[rods]]\ndensity_g_cm3 = {rho}\nlabel = {n}\n" for n, rho in ((1, 0.0), (2, 1.2)))
    (tmp_path / "here" / "c.toml").write_text(f"kind = 'QCT'\nmask = 'rods.npy'\n{rods}")
    first = key(tmp_path / "here")
    (tmp_path / "here").rename(tmp_path / "there")
    assert key(tmp_path / "there") == first
    (tmp_path / "there").rename(tmp_path / "here")
    mark(6)
    assert key(tmp_path / "here") != first


WRONG = {
    "one mesh": (("--nodes-list", "5x5x9"), "two or more meshes such as '11x18x34 14x24x46' for --nodes-list"),
    "no numbers": (("--nodes-list", "5x5x9 5xax9"), "two or more meshes such as"),
    "two directions": (("--nodes-list", "5x5x9 5x9"), "two or more meshes such as"),
    "no elements": (("--nodes-list", "5x5x9 5x1x9"), "two or more meshes such as"),
    "one size": (("--nodes-list", "5x5x9 9x5x5"), "meshes of different numbers of elements"),
    "labels": (("--labels", "parts.nii.gz"), "expected a --law LABEL=LAW with --labels"),
    "commas": (("--nodes-list", "5,5,9 7,7,11"), "two or more meshes such as"),
    "nodes": (("--nodes", "5,5,9"), "No such option: --"),
    "slice": (("--slice", "3"), "No such option: --"),
    "load": (("--load", "jump"), "a load case of stance"),
    "formulation": (("--formulation", "reduced"), "full, incompatible, bbar, got 'reduced'"),
    "modulus": (("--modulus", "mean"), "graded or element, got 'mean'"),
    "tolerance": (("--tolerance", "0"), "positive tolerance"),
    "no folder": (("-o", "nowhere/out"), "an existing folder"),
    "control": (("--control", "900,9,9"), "at most"),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_is_one_line_and_writes_nothing(
    run: Command, scan: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    options, message = WRONG[name]
    monkeypatch.chdir(tmp_path)
    words = {"--control": "5,5,9", "--load": "stance", "--nodes-list": "4x4x6 5x5x8", "-o": "out"}
    words[options[0]] = options[1]
    status, out, err = run("study", scan, *(word for pair in words.items() for word in pair))
    assert (status, out) == (2, "") and message in err and err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_a_file_in_the_folders_place_is_refused(run: Command, scan: Path, tmp_path: Path) -> None:
    (tmp_path / "out").write_text("mine")
    status, _, err = run("study", scan, "--load", "stance", "-o", tmp_path / "out")
    assert status == 2 and "a folder to fill, got the file" in err and (tmp_path / "out").read_text() == "mine"
