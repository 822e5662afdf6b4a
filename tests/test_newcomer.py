"""What somebody new meets: bodies that fill a scan or are one voxel, odd names, a full disk, other questions."""

import shutil
import sys
import warnings
from collections import namedtuple
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gpubspline.cautions import warn_of_hu
from gpubspline.ct.volume import Volume

ONE_MM = ("--spacing", "1,1,1")


@pytest.fixture
def ball(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.chdir(tmp_path)
    k, j, i = np.mgrid[:12, :12, :12] - 5.5
    np.save("-ball.npy", np.where(k**2 + j**2 + i**2 < 20, 500, -1000).astype(np.int16))
    return "./-ball.npy"


def test_version(run: Any) -> None:
    status, said, err = run("--version")
    assert (status, err) == (0, "") and said.splitlines()[0] == f"gpubspline {version('gpubspline')}"
    assert {f"warp-lang {version('warp-lang')}", f"pyopencl {version('pyopencl')}"} < set(said.splitlines())


def test_a_name_that_begins_with_a_hyphen(run: Any, ball: str) -> None:
    status, said, err = run("mesh", "-ball.npy", *ONE_MM, "-o", "m.vtu")
    assert (status, said) == (2, "") and "The file -ball.npy can be given as ./-ball.npy" in err
    assert run("info", ball, *ONE_MM)[0] == 0


@pytest.mark.parametrize(
    ("hu", "options", "words"),
    [
        (np.zeros((6, 6, 6)), (), "expected HU that differ, to find a body in them, got 0 everywhere"),
        (np.pad(np.full((2, 1, 1), 900), 3), ("--threshold", "0.5"), "a body of 2 voxels or more each way, got 1,1,2"),
        (np.ones((6, 6, 6)), ("--degree", "9"), "expected --degree of 1 to 5, got 9"),
    ],
)
def test_bodies_that_are_none_are_one_line(run: Any, ball: str, hu: Any, options: tuple[str, ...], words: str) -> None:
    np.save("a.npy", hu.astype(np.int16))
    status, said, err = run("mesh", "a.npy", *ONE_MM, *options, "--method", "tensor", "-o", "m.vtu")
    assert (status, said) == (2, "") and words in err and err.count("\n") == 1 and not Path("m.vtu").exists()


def test_a_crop_inside_a_body_is_a_box(run: Any, ball: str) -> None:
    """It has no surface in the scan, from which nothing can be off."""
    np.save("a.npy", np.full((6, 5, 4), 700, np.int16))
    status, said, _ = run("mesh", "a.npy", *ONE_MM, "--threshold", "300", "-o", "m.vtu")
    assert status == 0 and "the region's 0.00 mm from it on average" in said
    assert run("info", "a.npy", *ONE_MM)[1].endswith("HU         700 everywhere\n")


def test_a_surface_is_told_of(run: Any, ball: str) -> None:
    points = np.array([[0, 0, 0], [30, 0, 0], [0, 30, 0], [0, 0, 30]])
    faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
    lines = [f"v {x} {y} {z}" for x, y, z in points] + ["f " + " ".join(str(n + 1) for n in face) for face in faces]
    Path("m.obj").write_text("\n".join(lines))
    status, said, _ = run("info", "m.obj")
    assert status == 0 and "surface    closed, 4 triangles, 4 points" in said and "volume     4,500 mm3" in said


def test_a_disk_without_room_is_refused_before_the_file(run: Any, ball: str, monkeypatch: pytest.MonkeyPatch) -> None:
    usage = namedtuple("usage", "total used free")(10**9, 10**9, 1000)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage)
    for name in ("m.vts", "m.vtu"):
        status, _, err = run("mesh", ball, *ONE_MM, "--control", "5,5,5", "-o", name)
        assert status == 2 and f"of space for {name}, got 1 kB in" in err
    assert [path.name for path in Path().iterdir()] == ["-ball.npy"]


def test_a_format_that_holds_no_such_element_is_not_praised_for_it(run: Any, ball: str) -> None:
    assert "got tet4\n" in run("mesh", ball, *ONE_MM, "--element", "tet4", "-o", "m.vtu")[2]
    assert "got hex27; .vtu holds them\n" in run("mesh", ball, *ONE_MM, "--element", "hex27", "-o", "m.inp")[2]


def test_an_empty_mesh_file_is_called_so(run: Any, ball: str) -> None:
    Path("m.vtu").touch()
    assert run("quality", "m.vtu")[::2] == (
        2,
        "gpubspline: error: expected a mesh that meshio can read, got m.vtu: an empty file\n",
    )


def test_a_package_that_is_not_there_is_one_line(run: Any, ball: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of an installation that was made by halves."""
    monkeypatch.setitem(sys.modules, "polars", None)
    status, said, err = run("mesh", ball, *ONE_MM, "--nodes", "4,4,4", "--method", "tensor", "-o", "m.inp", "-q")
    words = "expected the package polars to be installed: pip install gpubspline brings what it needs"
    assert (status, said) == (2, "") and err.endswith(f"gpubspline: error: {words}\n") and "Traceback" not in err
    assert not Path("m.inp").exists()


def test_a_segmentation_is_told_of_label_by_label(run: Any, ball: str) -> None:
    """Whoever gets one has to know its numbers before ``--label``."""
    labels = np.zeros((4, 5, 6), np.int16)
    labels[1], labels[2, 0, :2] = 7, 22
    np.save("labels.npy", labels)
    said = run("info", "labels.npy", "--spacing", "2,1,0.5")[1]
    assert [line.split() for line in said.splitlines()[-2:]] == [
        ["7", "30", "voxels,", "30", "mm3"],
        ["22", "2", "voxels,", "2", "mm3"],
    ]
    assert "labels" not in run("info", ball, *ONE_MM)[1]
    size = ("--method", "tensor", "--threshold", "5", "--nodes", "3,3,3", "--control", "3,3,2", "-o", "m.vtu")
    err = run("mesh", "labels.npy", *ONE_MM, *size)[2]
    assert "nothing but whole numbers from 0 to 22, as a segmentation has: they are taken for HU; give the CT" in err


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda hu: hu + 1024, "no value is below 0, as where HU + 1024 is stored"),
        (lambda hu: hu - 1024, "lie below -1100 and above -2034, as where 1024 is taken off twice"),
        (lambda hu: np.where(hu < 0, hu + 65536.0, hu), "values go up to 64,"),
        (lambda hu: (hu + 1024) / 4096, "all values are from 0.00"),
        (lambda hu: hu, None),
        (lambda hu: np.where(np.hypot(*np.indices(hu.shape)[1:]) < 3, -3024, hu), None),
    ],
)
def test_values_that_are_hardly_hu_are_asked_about(change: Any, words: str | None) -> None:
    noise = np.random.default_rng(2).integers(-10, 10, (9, 9, 9))
    hu = np.where(np.indices((9, 9, 9))[2] < 5, -1000, 300) + noise
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        warn_of_hu(Volume(np.asarray(change(hu), np.float32), np.eye(4)))
    assert [words in str(one.message) for one in told] == ([True] if words else [])


def test_a_ct_is_no_mask(run: Any, ball: str) -> None:
    np.save("ct.npy", np.arange(-500, 1228, dtype=np.int16).reshape(12, 12, 12))
    status, said, err = run("mesh", ball, *ONE_MM, "--mask", "ct.npy", "-o", "m.vtu")
    assert (status, said) == (2, "") and "got 1727 values from -500 to 1227, as a CT has" in err


@pytest.mark.parametrize(
    ("spacing", "threshold", "words"),
    [
        ("0.001,0.001,0.001", "0", "the scan is 0.012 x 0.012 x 0.012 mm in all: are its spacing and origin in mm?"),
        ("1,1,1", "-2000", "all voxels are body, of -1000 to 500 HU with the threshold -2000"),
    ],
)
def test_metres_and_thresholds_below_all_are_asked_about(
    run: Any, ball: str, spacing: str, threshold: str, words: str
) -> None:
    size = ("--method", "tensor", "--nodes", "3,3,3", "--control", "4,4,4")
    status, _, err = run("mesh", ball, "--spacing", spacing, "--threshold", threshold, *size, "-o", "m.vtu")
    assert status == 0 and words in err


@pytest.mark.parametrize("method", ["auto", "blocks", "butterfly", "tensor"])
def test_one_slice_is_no_solid(run: Any, ball: str, method: str) -> None:
    status, _, err = run("mesh", ball, *ONE_MM, "--slices", "5:6", "--method", method, "-o", "m.vtu")
    assert status == 2 and "several slices for a solid, got one along k: --slice makes quads of it" in err


def test_a_picture_by_label_and_by_the_beginning_of_a_name(run: Any, ball: str) -> None:
    np.save("labels.npy", np.where(np.load("-ball.npy") > 0, np.arange(12)[:, None, None] // 6 + 1, 0).astype(np.int16))
    size = ("--method", "blocks", "--size", "2", "--no-conforming", "-o", "m.vtu", "--picture", "m.png")
    for field in ("label", "e"):
        status, _, err = run("mesh", ball, *ONE_MM, "--labels", "labels.npy", *size, "--field", field)
        assert status == 0 and Path("m.png").stat().st_size > 10_000, err


def test_what_is_written_and_not_read_is_told_so(run: Any, ball: str) -> None:
    """Whatever somebody finds in a folder of results can be asked about."""
    size = ("--method", "tensor", "--control", "5,5,5", "--threshold", "0")
    assert run("mesh", ball, *ONE_MM, *size, "-o", "m.vtu", "--summary", "m.json", "--report", "m.html")[0] == 0
    for name in ("m.feb", "m.k", "m.cdb"):
        assert run("export", "m.vtu", "-o", name)[0] == 0
    for name, words in (
        ("m.feb", "a deck, which is written only"),
        ("m.json", "figures of a run"),
        ("m.html", "a rep"),
    ):
        status, said, err = run("info", name)
        assert (status, said) == (2, "") and f"got {name}: {words}" in err and err.count("\n") == 1
    assert run("info", "m.vtu")[0] == 0
    for more in (("m.vtu",), ("--series", "1.2"), ONE_MM):
        assert "expected one file, without options that read a CT, with m.vtu" in run("info", "m.vtu", *more)[2]


@pytest.mark.parametrize(
    ("thickness", "words"), [("-1", "above 0 mm, got -1"), ("2", "expected quads"), ("nan", "nan")]
)
def test_a_thickness_is_of_quads(run: Any, ball: str, thickness: str, words: str) -> None:
    size = ("--method", "tensor", "--control", "5,5,5", "--threshold", "0")
    assert run("mesh", ball, *ONE_MM, *size, "-o", "m.vtu")[0] == 0
    status, said, err = run("export", "m.vtu", "-o", "m.inp", "--thickness", thickness)
    assert (status, said) == (2, "") and words in err and not Path("m.inp").exists()
