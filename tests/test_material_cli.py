"""Material options of the command line: mappings, depth, calibration, laws, and what is said of bad ones."""

import json
from collections.abc import Callable
from pathlib import Path

import meshio
import numpy as np
import pytest

from gpubspline.ct.phantom_dicom import write_phantom

Command = Callable[..., tuple[int, str, str]]
FEMUR = ["--control", "9,11,18", "--nodes", "9,11,18"]


@pytest.fixture(scope="session")
def child(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("scan") / "femur"
    write_phantom("child-femur", folder)
    return folder


def test_element_mapping_and_calibration(run: Command, child: Path, tmp_path: Path) -> None:
    calibration = tmp_path / "scanner.toml"
    calibration.write_text('kind = "QCT"\nsource = "May"\npoints = [[0, 0], [600, 0.5], [2000, 1.9]]\n')
    made, summary = tmp_path / "m.vtu", tmp_path / "s.json"
    how = ["--mapping", "element-e", "--surface-depth", "1", "--law", "keyak-1998", "--calibration", calibration]
    status, out, err = run("mesh", child, "-o", made, "--summary", summary, *FEMUR, *how)
    assert status == 0 and "error" not in err
    for words in ("element-e, the surface read 1 mm inside", "keyak-1998", "mass of the mesh", "unconfirmed", "May"):
        assert words in out
    figures = json.loads(summary.read_text())
    alarms = figures["alarms"]
    assert alarms["of"] == "elements" and alarms["count"] == figures["elements"] == 8 * 10 * 17
    assert 0 <= alarms["outside_law"] < 1 and alarms["near_zero_modulus"] == 0
    assert alarms["mass_g"]["mesh"] > 0 and abs(alarms["mass_g"]["difference"]) < 0.3
    assert 0 < alarms["order_difference"]["mean"] < alarms["order_difference"]["max"] < 1
    assert figures["calibration"]["method"] == "table" and figures["law"]["density_steps"][-1]["name"] == "ash-from-QCT"
    assert any("ash-from-QCT" in what for what in figures["law"]["unconfirmed"])
    written = meshio.read(made)
    assert {"E_MPa", "nu", "density_ash_g_cm3", "HU", "material"} <= written.cell_data.keys()
    assert "E_MPa" not in written.point_data


def test_gauss_mapping_as_vts(run: Command, child: Path, tmp_path: Path) -> None:
    made = tmp_path / "m.vts"
    status, out, _ = run("mesh", child, "-o", made, *FEMUR, "--mapping", "gauss")
    assert status == 0 and "gauss" in out
    status, out, _ = run("info", made)
    assert status == 0 and "E_MPa_8" in out


def test_depth_changes_the_surface(run: Command, child: Path, tmp_path: Path) -> None:
    hu = []
    for how in (["--partial-volume", "none"], ["--surface-depth", "2"], []):
        status, out, _ = run("mesh", child, "-o", tmp_path / "m.vtu", *FEMUR, *how)
        assert status == 0 and ("folded back in" in out) == (not how) and ("2 mm inside" in out) == ("2" in how)
        assert ("--partial-volume fold gives them their own" in out) == ("none" in how)
        hu.append(meshio.read(tmp_path / "m.vtu").point_data["HU"])
    changed = hu[0] != hu[1]
    assert 0.1 < changed.mean() < 0.9 and np.median(hu[1][changed]) > np.median(hu[0][changed])
    folded = hu[0] != hu[2]
    assert 0.1 < folded.mean() < 0.95 and np.median(hu[2][folded]) > np.median(hu[0][folded]) + 100


def test_laws_say_where_they_jump_and_what_is_unconfirmed(run: Command) -> None:
    status, out, _ = run("laws")
    assert status == 0
    assert "jump: at 350 HU the modulus falls from 438 to 129 MPa" in out
    assert "rho ash = 0.000699387 HU g/cm3 by eq-3.7, then ash-from-apparent" in out
    assert "unconfirmed" in out and "at 0.01 per second" in out and "specimens of 0.26 to 0.75 g/cm3" in out


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--mapping", "voxel"], "mapping of nodal, nodal-hu, nodal-e, gauss, element-hu, element-e, got 'voxel'"),
        (["--surface-depth", "-1"], "positive depth below the surface"),
        (["--floor-modulus", "3"], "--floor-modulus with --out-of-range floor, got clamp"),
        (["--partial-volume", "mirror"], "treatment fold or none, got 'mirror'"),
        (["--partial-volume", "fold", "--surface-depth", "1"], "--partial-volume fold or --surface-depth, got both"),
        (["--quadrature", "3"], "for a mapping with -hu or -e alone, got nodal"),
        (["--law", "hooke"], "material law of wirtz-2000"),
    ],
)
def test_bad_options(run: Command, child: Path, tmp_path: Path, options: list[str], message: str) -> None:
    status, _, err = run("mesh", child, "-o", tmp_path / "m.vtu", *options)
    assert status == 2 and message in err and err.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_one_rod_is_refused_and_a_model_has_no_tissues(run: Command, child: Path, tmp_path: Path) -> None:
    rod = tmp_path / "rod.toml"
    rod.write_text('kind = "QCT"\n[[rods]]\ndensity_g_cm3 = 0.1\ncentre_mm = [0, 0, 0]\n')
    status, _, err = run("mesh", child, "-o", tmp_path / "m.vtu", "--calibration", rod)
    assert status == 2 and "at least two rods of known density" in err
    model, tissues = tmp_path / "m.npz", tmp_path / "t.toml"
    tissues.write_text('kind = "QCT"\n[tissues]\nair = {}\nfat = {}\n')
    assert run("fit", child, "-o", model, "--control", "9,11,18")[0] == 0
    status, _, err = run("sample", model, "-o", tmp_path / "m.vtu", "--calibration", tissues)
    assert status == 2 and "the CT to find the tissues of the calibration in" in err
    status, _, err = run("sample", model, "-o", tmp_path / "m.vtu", "--surface-depth", "1")
    assert status == 2 and "the CT to read the surface's HU" in err


def test_a_scan_without_tissues_is_refused_before_it_is_meshed(
    run: Command, child: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for meshed in ("gpubspline.pipeline.fit_body", "gpubspline.methods.mesh_body"):
        monkeypatch.setattr(meshed, lambda *_: pytest.fail("it was meshed"))
    for method in ("tensor", "blocks"):
        how = ("--method", method, "--calibration", "phantomless")
        status, _, err = run("mesh", child, "-o", tmp_path / "m.vtu", *how)
        assert status == 2 and "expected a peak of" in err and err.count("\n") == 1


def test_labels_by_name_and_as_element_sets(run: Command, data: Path, tmp_path: Path) -> None:
    """A real vertebra by its label, its parts as element sets."""
    folder = data / "vertebra"
    made = tmp_path / "v.inp"
    masks = ["--mask", folder / "sub-ct_seg-vert_label-22_msk.nii.gz", "--label", "22"]
    parts = ["--labels", folder / "sub-ct_seg-subreg_label-22_msk.nii.gz"]
    ct = folder / "sub-ct_label-22_ct.nii.gz"
    status, _, err = run("mesh", ct, *masks, *parts, "--control", "10,10,12", "-o", made)
    assert status == 0 and "error" not in err
    assert "elset=label_49" in made.read_text().lower()
    status, _, err = run("mesh", ct, *masks[:3], "L3", "-o", tmp_path / "w.vtu")
    assert status == 2 and "expected one of the labels" in err and "got L3" in err


def test_orthotropic_elements(run: Command, child: Path, tmp_path: Path) -> None:
    made, summary, solved = tmp_path / "m.vtu", tmp_path / "s.json", tmp_path / "solved.vtu"
    across = ["--transverse-law", "wirtz-2000-transverse"]
    how = ["--mapping", "element-e", *across, "-o", made, "--summary", summary]
    status, out, err = run("mesh", child, *FEMUR, *how)
    assert status == 0 and "across it by wirtz-2000-transverse" in out and "Huber" in out and "error" not in err
    figures = json.loads(summary.read_text())
    assert figures["transverse_law"]["name"] == "wirtz-2000-transverse"
    written = meshio.read(made).cell_data
    names = (
        "E1_MPa",
        "E2_MPa",
        "E3_MPa",
        "nu12",
        "nu13",
        "nu23",
        "G12_MPa",
        "G13_MPa",
        "G23_MPa",
        "axis1_x",
        "axis2_z",
    )
    assert set(names) <= written.keys()
    np.testing.assert_allclose(written["E1_MPa"][0], written["E2_MPa"][0])
    status, out, _ = run("solve", made, "--load", "stance", "-o", solved)
    assert status == 0 and "balance" in out
    status, _, err = run("mesh", child, *FEMUR, *across, "-o", tmp_path / "n.vtu")
    assert status == 2 and "transverse law with element-hu or element-e, got the mapping nodal" in err
    for command in (["export", made], ["mesh", child, *FEMUR, "--mapping", "element-e", *across]):
        status, _, err = run(*command, "-o", tmp_path / "deck.bdf")
        assert status == 2 and "a format that holds orthotropic elements" in err and "got .bdf" in err
    assert not (tmp_path / "deck.bdf").exists()
    assert run("export", made, "-o", tmp_path / "deck.inp")[0] == 0
