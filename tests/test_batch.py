"""``gpubspline batch`` as a user meets it, on real CT and phantoms of reduced size."""

import csv
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gpubspline.batch import cluster
from gpubspline.cli.subject import columns, stiffness_n_per_mm
from gpubspline.ct.phantom_dicom import write_phantom

Command = Callable[..., tuple[int, str, str]]

HEADER = "subject,input,threshold,slices,slice,mask,label,box,control,nodes,load,modulus,picture"


@pytest.fixture
def manifest(tmp_path: Path, data: Path) -> Path:
    """Eight rows: real CT and phantoms, two of them bad."""
    write_phantom("child-femur", tmp_path / "femur")
    shutil.copytree(tmp_path / "femur", tmp_path / "cut")
    slices = sorted((tmp_path / "cut").iterdir())
    slices[7].write_bytes(slices[7].read_bytes()[:20000])
    head, vertebra = data / "head" / "ct_example.nii.gz", data / "vertebra"
    mask = vertebra / "sub-ct_seg-subreg_label-22_msk.nii.gz"
    hips = data / "hips" / "example_ct.nii.gz"
    rows = [
        HEADER,
        f'slice,{head},-200,,8,,,,,"20,20",,,',
        f'head,{head},-200,8:14,,,,,"8,10,6","8,10,6",,,look.png',
        f'body,{vertebra / "sub-ct_label-22_ct.nii.gz"},,,,{mask},49,,,"8,8,8",,,',
        f'hip,{hips},250,,,,,"-146,-66,-190,-100,94,160",,"6,7,8",,,',
        'femur,femur,,,,,,,"7,8,10","7,8,10",,,',
        'stance,femur,,,,,,,"7,8,10","7,8,10",stance,element,',
        f"empty,{hips},5000,,,,,,,,,,",
        "cut,cut,,,,,,,,,,,",
    ]
    path = tmp_path / "cohort.csv"
    path.write_text("\n".join(rows) + "\n")
    return path


def state(folder: Path) -> dict[str, Any]:
    """Every file of a cohort but its table and page, with when it was written."""
    files = (path for path in folder.rglob("*") if path.is_file() and path.parent != folder)
    return {str(path.relative_to(folder)): (path.stat().st_mtime_ns, path.stat().st_size) for path in files}


def test_six_models_two_failures_and_nothing_to_do(run: Command, manifest: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    status, said, err = run("batch", manifest, "-o", out, "--workers", 2)
    assert status == 1 and err == "", err
    assert "6 models, 2 failed; 0 of 8 kept" in said
    with (out / "cohort.csv").open(newline="") as file:
        table = list(csv.DictReader(file))
        rows = {row["subject"]: row for row in table}
    assert [row["subject"] for row in table] == ["slice", "head", "body", "hip", "femur", "stance", "empty", "cut"]
    assert [name for name, row in rows.items() if row["status"] == "failed"] == ["empty", "cut"]
    assert "5000" in rows["empty"]["error"] and "dcm" in rows["cut"]["error"]
    assert all(rows[name]["error"] in said for name in ("empty", "cut"))
    assert (rows["slice"]["elements"], rows["slice"]["element_type"]) == ("361", "quad4")
    assert rows["stance"]["elements"] == rows["femur"]["elements"] == "378"
    assert rows["stance"]["volume_mm3"] == rows["femur"]["volume_mm3"] and rows["slice"]["volume_mm3"] == ""
    mean_g_cm3 = float(rows["femur"]["mass_g"]) / (1e-3 * float(rows["femur"]["volume_mm3"]))
    assert 0.3 < mean_g_cm3 < 1.9  # a shaft and its marrow
    assert all(int(rows[name]["inverted"]) == 0 for name in rows if rows[name]["status"] == "done")
    solved = json.loads((out / "stance" / "solve.json").read_text())
    assert float(rows["stance"]["stiffness_n_per_mm"]) == pytest.approx(stiffness_n_per_mm(solved))
    assert sorted(path.name for path in (out / "head").iterdir()) == [
        "look.png",
        "mesh.json",
        "mesh.vtu",
        "record.json",
    ]
    assert [path.name for path in (out / "cut").iterdir()] == ["record.json"]
    assert "6 models, 2 failed" in (out / "cohort.html").read_text()
    before, table_text = state(out), (out / "cohort.csv").read_bytes()
    status, said, err = run("batch", manifest, "-o", out, "--workers", 2)
    assert status == 1 and "8 of 8 kept" in said and err == ""
    assert state(out) == before and (out / "cohort.csv").read_bytes() == table_text


def test_columns_are_the_options() -> None:
    known = columns()
    assert known["threshold"] == known["load"] == "text" and known["law"] == "texts"
    assert known["mask"] == "file" and known["picture"] == known["output"] == "new file"
    assert known["allow-gaps"] == "flag" and not {"summary", "device", "quiet", "backend", "help"} & known.keys()


def test_stiffness_is_of_a_spring_of_the_same_energy() -> None:
    k, force = 120.0, np.array([30.0, -40.0, 120.0])
    moved = np.linalg.norm(force) / k
    figures = {"applied_n": force.tolist(), "strain_energy_nmm": 0.5 * k * moved**2}
    assert stiffness_n_per_mm(figures) == pytest.approx(k)
    assert stiffness_n_per_mm({"applied_n": [0.0, 0.0, 0.0], "strain_energy_nmm": 1.0}) is None


@pytest.mark.parametrize(
    ("text", "words", "pattern"),
    [
        ("subject,input\na,nowhere.nii.gz\n", (), "existing file for a, line 2 of m.csv, got .*nowhere.nii.gz"),
        ("subject,input,treshold\na,ct.npy,1\n", (), "'treshold'.*did you mean threshold"),
        ("subject,input,device\na,ct.npy,cpu\n", (), "'device'"),
        ("subject,input,threshold\na,ct.npy,high\n", (), "options of 'mesh' for a, line 2.*--threshold"),
        ("subject,input,load,output\na,ct.npy,stance,a.inp\n", (), "an output to be solved, such as mesh.vtu, with"),
        ("subject,input,load,output\na,ct.npy,stance,solved.vtu\n", (), "an output to be solved"),
        ("subject,input,tolerance\na,ct.npy,1e-3\n", (), "tolerance only together with a load for a"),
        ("subject,input\na,ct.npy\n", ("--workers", 0), "--workers of 1 or more"),
        ("subject,input\na,ct.npy\n", ("--workers", 1, "--scheduler", "tcp://x:1"), "--workers or --scheduler"),
        ("subject,input\na,ct.npy\n", ("--scheduler", "tcp://127.0.0.1:1"), "dask scheduler at tcp://127.0.0.1:1"),
        ("subject,input\na,ct.npy\n", ("--backend", "metal"), "expected a backend"),
        ("subject,input\na,ct.npy\n", ("--precision", "float16"), "expected the precision float32 or float64"),
    ],
)
def test_bad_manifests_and_clusters(
    run: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str, words: Any, pattern: str
) -> None:
    import re

    monkeypatch.setattr(cluster, "TIMEOUT_S", 1)
    np.save(tmp_path / "ct.npy", np.zeros((6, 8, 9), dtype=np.int16))
    (tmp_path / "m.csv").write_text(text)
    status, said, err = run("batch", tmp_path / "m.csv", "-o", tmp_path / "out", *words)
    assert (status, said) == (2, "") and len(err.splitlines()) == 1, err
    assert re.search(pattern, err), err
    assert not (tmp_path / "out").exists()
