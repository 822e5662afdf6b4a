"""The command line as a user meets it: what it makes, and what it says of bad input."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pydicom
import pytest
import SimpleITK as sitk

from gpubspline.ct.phantom_dicom import write_phantom

FEMUR = ["--control", "11,18,34", "--nodes", "11,18,34"]

Command = Callable[..., tuple[int, str, str]]


@pytest.fixture(scope="session")
def femur(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The child femur phantom as a DICOM series; tests copy it before they spoil it."""
    folder = tmp_path_factory.mktemp("phantom") / "femur"
    write_phantom("child-femur", folder)
    return folder


@pytest.mark.parametrize("backend", ["warp", "opencl"])
def test_mesh_and_its_summary(run: Command, femur: Path, tmp_path: Path, backend: str) -> None:
    names = {name: tmp_path / name for name in ("m.vtu", "s.json", "p.png", "h.png")}
    files = [
        "-o",
        names["m.vtu"],
        "--summary",
        names["s.json"],
        "--picture",
        names["p.png"],
        "--histogram",
        names["h.png"],
    ]
    status, out, err = run("mesh", femur, *files, *FEMUR, "--backend", backend)
    assert (status, err) == (0, "")
    assert "5,610 hex8" in out
    figures = json.loads(names["s.json"].read_text())
    assert figures["elements"] == 5610 and figures["nodes"] == 11 * 18 * 34 and figures["element_type"] == "hex8"
    assert figures["backend"] == backend and figures["device"]
    quality = figures["scaled_jacobian"]
    assert (
        sum(quality["histogram"]["counts"]) + quality["inverted"] == 5610 and len(quality["histogram"]["edges"]) == 11
    )
    assert {"min", "mean", "fraction_above_0.5", "fraction_below_0.1", "inverted"} <= quality.keys()
    assert 0.8 < figures["volume_mm3"]["mesh"] / figures["volume_mm3"]["region"] < 1.2
    assert {"mean", "p95", "max"} == figures["surface_distance_mm"].keys()
    for spread in ("hu", "modulus_mpa"):
        assert figures[spread]["min"] < figures[spread]["mean"] < figures[spread]["max"]
    assert 0 < figures["out_of_range_nodes"] < figures["nodes"]
    stages = figures["seconds"]
    assert {"read", "region", "lattice", "fit", "sample", "material", "quality", "write", "total"} <= stages.keys()
    assert stages["total"] == pytest.approx(sum(value for stage, value in stages.items() if stage != "total"))
    written = meshio.read(names["m.vtu"])
    assert {"HU", "density_apparent_g_cm3", "E_MPa", "nu"} <= written.point_data.keys()
    assert {"scaled_jacobian", "material"} <= written.cell_data.keys()
    assert all(names[name].read_bytes().startswith(b"\x89PNG") for name in ("p.png", "h.png"))


def test_both_backends_give_one_mesh(run: Command, femur: Path, tmp_path: Path) -> None:
    meshes = []
    for backend in ("warp", "opencl"):
        path = tmp_path / f"{backend}.vtu"
        assert run("mesh", femur, "-o", path, "--nodes", "20,20,50", "--backend", backend, "--quiet") == (0, "", "")
        meshes.append(meshio.read(path))
    one, other = meshes
    assert np.abs(one.points - other.points).max() < 1e-4
    assert np.abs(one.point_data["HU"] - other.point_data["HU"]).max() < 0.05
    assert np.abs(one.cell_data["scaled_jacobian"][0] - other.cell_data["scaled_jacobian"][0]).max() < 1e-4


def test_fit_then_sample_is_mesh(run: Command, femur: Path, tmp_path: Path) -> None:
    model, direct, later = tmp_path / "model.npz", tmp_path / "direct.vtu", tmp_path / "later.vtu"
    assert run("fit", femur, "-o", model, "--control", "11,18,34")[0] == 0
    assert run("sample", model, "-o", later, "--nodes", "9,12,20")[0] == 0
    assert run("mesh", femur, "-o", direct, "--control", "11,18,34", "--nodes", "9,12,20")[0] == 0
    one, other = meshio.read(direct), meshio.read(later)
    assert np.array_equal(one.points, other.points) and np.array_equal(
        one.point_data["E_MPa"], other.point_data["E_MPa"]
    )
    status, out, _ = run("info", model)
    assert status == 0 and "solid of 11 x 18 x 34 control points, degree 3 x 3 x 3" in out


@pytest.mark.parametrize("fit", ["interpolate", "least-squares"])
def test_other_fits_follow_the_boundary(run: Command, femur: Path, tmp_path: Path, fit: str) -> None:
    summary = tmp_path / "s.json"
    words = ["--fit", fit, "--control", "9,12,20", "--nodes", "11,18,34", "--summary", summary]
    assert run("mesh", femur, "-o", tmp_path / "m.vtu", *words)[0] == 0
    figures = json.loads(summary.read_text())
    assert figures["fit"]["method"] == fit and figures["surface_distance_mm"]["mean"] < 1.0


def test_one_slice_gives_quads(run: Command, femur: Path, tmp_path: Path) -> None:
    status, out, err = run("mesh", femur, "-o", tmp_path / "q.vtu", "--slice", 5, "--nodes", "40,70")
    assert (status, err) == (0, "") and "2,691 quad4" in out


@pytest.mark.parametrize(("words", "kind"), [(["--order", "2"], "hex20"), (["--element", "hex27"], "hex27")])
def test_quadratic_elements(run: Command, femur: Path, tmp_path: Path, words: list[str], kind: str) -> None:
    status, out, _ = run("mesh", femur, "-o", tmp_path / "q.vtu", "--nodes", "5,6,9", *words)
    assert status == 0 and f"160 {kind}" in out


@pytest.mark.parametrize("axis", ["x", "y", "long"])
def test_other_axes(run: Command, femur: Path, tmp_path: Path, axis: str) -> None:
    status, out, _ = run("mesh", femur, "-o", tmp_path / "m.vtu", "--axis", axis, "--nodes", "9,9,9")
    assert status == 0 and "512 hex8" in out


def test_crop_by_slices_and_box(run: Command, femur: Path, tmp_path: Path) -> None:
    status, _, _ = run("mesh", femur, "-o", tmp_path / "m.vtu", "--slices", ":12", "--box", "-200,200,-200,200,9,500")
    points = meshio.read(tmp_path / "m.vtu").points
    assert status == 0 and points[:, 2].min() > 8.999 and points[:, 2].max() < 33.001


@pytest.mark.parametrize("slices", ["30:35", "-35:", "35:"])
def test_slices_that_there_are_not_are_not_cut_silently(run: Command, femur: Path, tmp_path: Path, slices: str) -> None:
    status, out, err = run("mesh", femur, "-o", tmp_path / "m.vtu", "--slices", slices)
    words = f"expected --slices within 0:34, which is all there are, got {slices}\n"
    assert (status, out) == (2, "") and err.endswith(words) and not (tmp_path / "m.vtu").exists()


def test_a_body_of_flesh_by_otsu_is_asked_about(run: Command, tmp_path: Path) -> None:
    """Of a scan of the trunk it parts the skin from the air; whoever wants the bone has to say so."""
    hu = np.full((20, 30, 30), -1000, np.int16)
    hu[2:-2, 4:-4, 4:-4], hu[5:-5, 12:18, 12:18] = 40, 700
    np.save(tmp_path / "trunk.npy", hu)
    words = ("mesh", tmp_path / "trunk.npy", "--spacing", "1,1,1", "--control", "5,5,5", "-o", tmp_path / "m.vtu")
    status, _, err = run(*words)
    assert status == 0 and "of what is meshed lies below 100 HU, where no bone is; --threshold 250" in err
    assert "where no bone is" not in run(*words, "--threshold", "-200")[2]  # who gives one has chosen


def test_own_law(run: Command, femur: Path, tmp_path: Path) -> None:
    law = tmp_path / "own.toml"
    law.write_text(
        '[own]\ntitle = "one power"\n[own.density]\nkind = "apparent"\nslope_g_cm3_per_hu = 0.001\n'
        "[[own.pieces]]\nhu = [-1000.0, 3000.0]\nfactor_mpa = 1000.0\nexponent = 2.0\n"
        "offset_mpa = 5.0\npoisson = 0.25\n"
    )
    assert run("mesh", femur, "-o", tmp_path / "m.vtu", "--law", law, *FEMUR)[0] == 0
    written = meshio.read(tmp_path / "m.vtu").point_data
    expected = 5 + 1000 * np.maximum(0.001 * written["HU"].astype(float), 0) ** 2
    assert np.allclose(written["E_MPa"], expected, rtol=1e-5) and np.allclose(written["nu"], 0.25)


def test_quality_of_a_file(run: Command, femur: Path, tmp_path: Path) -> None:
    summary = tmp_path / "q.json"
    run("mesh", femur, "-o", tmp_path / "m.vtu", *FEMUR)
    status, out, _ = run("quality", tmp_path / "m.vtu", "--summary", summary, "--histogram", tmp_path / "h.png")
    assert status == 0 and "5,610 hex8" in out and (tmp_path / "h.png").exists()
    figures = json.loads(summary.read_text())
    assert figures["scaled_jacobian"]["inverted"] == 0 and figures["certified_valid"] is True
    assert "every hex certified valid throughout" in out


def test_info_of_ct_and_mesh(run: Command, femur: Path, tmp_path: Path) -> None:
    status, out, _ = run("info", femur)
    assert status == 0 and "34" in out and "Otsu" in out
    run("mesh", femur, "-o", tmp_path / "m.vtu", *FEMUR)
    status, out, _ = run("info", tmp_path / "m.vtu")
    assert status == 0 and "5,610 hex8" in out and "E_MPa" in out


def test_lists(run: Command) -> None:
    status, out, _ = run("backends")
    assert status == 0 and "warp:cpu" in out and "opencl:0:0" in out and "*" in out
    status, out, _ = run("laws")
    assert status == 0 and "wirtz-2000 (default)" in out and "1904 rho^1.64" in out


def test_nothing_identifies_a_patient(run: Command, femur: Path, tmp_path: Path) -> None:
    folder = tmp_path / "named"
    shutil.copytree(femur, folder)
    for path in folder.iterdir():
        dataset = pydicom.dcmread(path)
        dataset.PatientName, dataset.PatientID, dataset.InstitutionName = (
            "Featherstone^Ophelia",
            "ID471147",
            "Saint Elsewhere",
        )
        dataset.save_as(path)
    out = tmp_path / "out"
    out.mkdir()
    files = ["-o", out / "m.inp", "--summary", out / "s.json", "--picture", out / "p.png"]
    _, said, warned = run("mesh", folder, *files, *FEMUR)
    run("fit", folder, "-o", out / "m.npz", "--control", "11,18,34")
    run("mesh", folder, "-o", out / "m.vtu", *FEMUR)
    _, told, _ = run("info", folder)
    written = b"".join(path.read_bytes() for path in out.iterdir()) + (said + warned + told).encode()
    assert not any(word in written for word in (b"Featherstone", b"Ophelia", b"ID471147", b"Elsewhere"))


# Bad input: each case makes its folder and gives the words of a command and what the message must say.


def no_dicom(folder: Path, femur: Path) -> list[Any]:
    (folder / "in").mkdir()
    (folder / "in" / "notes.txt").write_text("nothing here")
    return [folder / "in", "DICOM"]


def series_without_ct(folder: Path, femur: Path) -> list[Any]:
    shutil.copytree(femur, folder / "in")
    for number, path in enumerate(sorted((folder / "in").iterdir())):
        dataset = pydicom.dcmread(path)
        dataset.Modality = "MR"
        dataset.SeriesInstanceUID = f"1.2.3.{number % 2 + 1}"
        dataset.save_as(path)
    return [folder / "in", "CT.*MR"]


def truncated(folder: Path, femur: Path) -> list[Any]:
    shutil.copytree(femur, folder / "in")
    path = sorted((folder / "in").iterdir())[7]
    path.write_bytes(path.read_bytes()[:20000])
    return [folder / "in", path.name]


def missing_slice(folder: Path, femur: Path) -> list[Any]:
    shutil.copytree(femur, folder / "in")
    sorted((folder / "in").iterdir())[7].unlink()
    return [folder / "in", "missing.*allow-gaps"]


def differing_sizes(folder: Path, femur: Path) -> list[Any]:
    shutil.copytree(femur, folder / "in")
    path = sorted((folder / "in").iterdir())[3]
    dataset = pydicom.dcmread(path)
    dataset.PixelData = np.ascontiguousarray(dataset.pixel_array[:-8]).tobytes()
    dataset.Rows -= 8
    dataset.save_as(path)
    return [folder / "in", "size"]


def nothing_above(folder: Path, femur: Path) -> list[Any]:
    return [femur, "--threshold", "5000", "5000"]


def mask_on_another_grid(folder: Path, femur: Path) -> list[Any]:
    np.save(folder / "mask.npy", np.ones((5, 6, 7), dtype=np.uint8))
    return [femur, "--mask", folder / "mask.npy", "grid"]


def too_many_control_points(folder: Path, femur: Path) -> list[Any]:
    return [femur, "--control", "11,18,35", "control points"]


def degree_too_high(folder: Path, femur: Path) -> list[Any]:
    return [femur, "--control", "3,18,34", "degree below the number of control points"]


def unknown_law(folder: Path, femur: Path) -> list[Any]:
    return [femur, "--law", "stone", "expected a material law of.*wirtz-2000"]


def unknown_backend(folder: Path, femur: Path) -> list[Any]:
    return [femur, "--backend", "metal", "expected a backend of warp, opencl"]


def infinite_hu(folder: Path, femur: Path) -> list[Any]:
    samples = np.zeros((6, 8, 9), dtype=np.float32)
    samples[2, 3, 4] = np.nan
    np.save(folder / "ct.npy", samples)
    return [folder / "ct.npy", "--spacing", "1,1,1", "finite HU"]


def one_slice_as_solid(folder: Path, femur: Path) -> list[Any]:
    return [femur, "--slices", "5:6", "slice"]


def npy_without_spacing(folder: Path, femur: Path) -> list[Any]:
    np.save(folder / "ct.npy", np.zeros((6, 8, 9), dtype=np.int16))
    return [folder / "ct.npy", "spacing"]


def crop_of_nothing(folder: Path, femur: Path) -> list[Any]:
    return [femur, "--box", "900,950,900,950,900,950", "the volume spans"]


def unknown_field(folder: Path, femur: Path) -> list[Any]:
    return [femur, *FEMUR, "--field", "stress", "one of the fields HU, .*scaled_jacobian for --field"]


def nan_in_nifti(folder: Path, femur: Path) -> list[Any]:
    samples = np.zeros((6, 8, 9), dtype=np.float32)
    samples[2, 3, 4] = np.inf
    sitk.WriteImage(sitk.GetImageFromArray(samples), str(folder / "ct.nii.gz"))
    return [folder / "ct.nii.gz", "finite HU"]


def threshold_of_nan(folder: Path, femur: Path) -> list[Any]:
    return [femur, "--threshold", "nan", "finite threshold"]


def box_of_nan(folder: Path, femur: Path) -> list[Any]:
    return [femur, "--box", "nan,9,0,9,0,9", "6 numbers with commas for --box"]


def more_nodes_than_numbers(folder: Path, femur: Path) -> list[Any]:
    return [femur, "--nodes", "1300,1300,1300", "at most 2,147,483,647 samples"]


def one_file_twice(folder: Path, femur: Path) -> list[Any]:
    return [femur, "--histogram", folder / "out" / "p.png", "a file of its own for each output"]


def wrong_counts(folder: Path, femur: Path) -> list[Any]:
    return [femur, "--nodes", "10,ten,5", "integers with commas for --nodes"]


def unknown_option(folder: Path, femur: Path) -> list[Any]:
    return [femur, "--densty", "3", "--densty"]


CASES = [
    no_dicom,
    series_without_ct,
    truncated,
    missing_slice,
    differing_sizes,
    nothing_above,
    mask_on_another_grid,
    too_many_control_points,
    degree_too_high,
    unknown_law,
    unknown_backend,
    infinite_hu,
    one_slice_as_solid,
    npy_without_spacing,
    crop_of_nothing,
    unknown_field,
    nan_in_nifti,
    threshold_of_nan,
    box_of_nan,
    more_nodes_than_numbers,
    one_file_twice,
    wrong_counts,
    unknown_option,
]


def assert_one_line(status: int, err: str, pattern: str) -> None:
    import re

    lines = [line for line in err.splitlines() if "warning:" not in line]
    assert status == 2
    assert len(lines) == 1 and lines[0].startswith("gpubspline: error: "), err
    assert re.search(pattern, lines[0]), lines[0]


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.__name__)
def test_bad_input_gets_one_line(run: Command, femur: Path, tmp_path: Path, case: Any) -> None:
    *words, pattern = case(tmp_path, femur)
    out = tmp_path / "out"
    out.mkdir()
    status, said, err = run(
        "mesh", *words, "-o", out / "m.vtu", "--summary", out / "s.json", "--picture", out / "p.png"
    )
    assert_one_line(status, err, pattern)
    assert said == "" and list(out.iterdir()) == []


@pytest.mark.parametrize(
    ("output", "pattern"),
    [
        ("m.xyz", r"\.vtu"),
        ("nowhere/m.vtu", "does not exist"),
        ("/proc/m.vtu", "cannot write in /proc"),
        (".", "folder|vtu"),
    ],
)
def test_bad_output_is_named_before_any_work(run: Command, tmp_path: Path, output: str, pattern: str) -> None:
    status, _, err = run("mesh", tmp_path / "input-that-is-not-there", "-o", tmp_path / output)
    assert_one_line(status, err, pattern)
    assert list(tmp_path.iterdir()) == []


def test_no_input_is_overwritten(run: Command, femur: Path, tmp_path: Path) -> None:
    mesh = tmp_path / "m.vtu"
    assert run("mesh", femur, "-o", mesh, "--nodes", "5,6,7")[0] == 0
    before = mesh.read_bytes()
    assert_one_line(*run("quality", mesh, "--summary", mesh)[::2], "a file of its own")
    samples = np.zeros((6, 8, 9), dtype=np.int16)
    np.save(tmp_path / "ct.npy", samples)
    words = ["--spacing", "1,1,1", "--summary", tmp_path / "ct.npy"]
    assert_one_line(*run("mesh", tmp_path / "ct.npy", "-o", tmp_path / "n.vtu", *words)[::2], "a file of its own")
    (tmp_path / "law.toml").write_text("")
    np.save(tmp_path / "mask.npy", samples)
    for option, name in (("--mask", "mask.npy"), ("--labels", "mask.npy"), ("--law", "law.toml")):
        words = ["--spacing", "1,1,1", option, tmp_path / name, "--summary", tmp_path / name]
        assert_one_line(*run("mesh", tmp_path / "ct.npy", "-o", tmp_path / "n.vtu", *words)[::2], "a file of its own")
    assert mesh.read_bytes() == before and np.array_equal(np.load(tmp_path / "ct.npy"), samples)


def test_parts_of_a_mask_that_are_left_out_are_warned_of(run: Command, tmp_path: Path) -> None:
    """Two balls in one mask: the larger alone is meshed; a speck beside it is not spoken of."""
    k, j, i = np.mgrid[:16, :16, :32] - 7.5
    one, other = k**2 + j**2 + i**2 < 40, k**2 + j**2 + (i - 16) ** 2 < 30
    speck = np.zeros_like(one)
    speck[0, 0, 0] = True
    np.save(tmp_path / "ct.npy", np.where(one | other, 500, -1000).astype(np.int16))
    said = {}
    for name, mask in (("both", one | other), ("speck", one | speck)):
        np.save(tmp_path / "mask.npy", mask.astype(np.uint8))
        words = ["--spacing", "1,1,1", "--mask", tmp_path / "mask.npy", "-o", tmp_path / "m.npz"]
        status, _, said[name] = run("fit", tmp_path / "ct.npy", *words)
        assert status == 0
    assert "warning: 39% of the mask is left out" in said["both"] and said["speck"] == ""


def test_bad_demo_leaves_no_folder(run: Command, tmp_path: Path) -> None:
    assert_one_line(*run("demo", tmp_path / "d", "--backend", "metal")[::2], "expected a backend")
    (tmp_path / "file").write_text("")
    assert_one_line(*run("demo", tmp_path / "file")[::2], "expected a folder to make, got the file")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_bad_model_and_phantom(run: Command, tmp_path: Path) -> None:
    assert_one_line(*run("sample", tmp_path / "none.npz", "-o", tmp_path / "m.vtu")[::2], "does not exist")
    assert_one_line(*run("phantom", "skull", tmp_path / "p")[::2], "child-femur, adult-femur, head")
    assert_one_line(*run("phantom", "head", tmp_path / "no" / "p")[::2], "existing folder")
    assert_one_line(*run("quality", tmp_path / "none.vtu")[::2], "none.vtu")
    assert list(tmp_path.iterdir()) == []
