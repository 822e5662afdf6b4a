"""What somebody new meets: bodies that fill a scan or are one voxel, odd names, a full disk, other questions."""

import shutil
import sys
from collections import namedtuple
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pytest

ONE_MM = ("--spacing", "1,1,1")


@pytest.fixture
def ball(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.chdir(tmp_path)
    k, j, i = np.mgrid[:12, :12, :12] - 5.5
    np.save("-ball.npy", np.where(k**2 + j**2 + i**2 < 20, 500, -1000).astype(np.int16))
    return "./-ball.npy"


def test_version(run: Any) -> None:
    assert run("--version") == (0, f"gpubspline {version('gpubspline')}\n", "")


def test_a_name_that_begins_with_a_hyphen(run: Any, ball: str) -> None:
    status, said, err = run("mesh", "-ball.npy", *ONE_MM, "-o", "m.vtu")
    assert (status, said) == (2, "") and "The file -ball.npy can be given as ./-ball.npy" in err
    assert run("info", ball, *ONE_MM)[0] == 0


@pytest.mark.parametrize(
    ("hu", "options", "words"),
    [
        (np.zeros((6, 6, 6)), (), "expected HU that differ, to find a body in them, got 0 everywhere"),
        (np.pad(np.ones((2, 1, 1)), 3), ("--threshold", "0.5"), "a body of 2 voxels or more each way, got 1,1,2"),
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
