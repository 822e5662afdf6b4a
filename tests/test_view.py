"""``gpubspline view``: a PNG without a screen, a window with one, and fields by the beginning of their names."""

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from gpubspline.errors import InputError
from gpubspline.export import write
from gpubspline.mesh.mesh import Mesh
from gpubspline.report.quantity import find_field, quantity

Command = Callable[..., tuple[int, str, str]]


@pytest.fixture
def cube(tmp_path: Path) -> Path:
    grid = np.meshgrid(*(np.arange(5.0),) * 3, indexing="ij")
    points = np.stack([a.ravel(order="F") for a in grid], axis=1)
    fields = {"HU": np.full(125, 300.0), "E_MPa": 10 * 4 ** points[:, 2]}
    write(Mesh(points, "hex8", structure=(5, 5, 5), fields=fields), tmp_path / "cube.vtu")
    return tmp_path / "cube.vtu"


@pytest.fixture
def no_screen(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)


def test_without_a_screen_a_picture_is_written(
    run: Command, cube: Path, tmp_path: Path, no_screen: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run("view", cube) == (0, "wrote cube.png, coloured by HU\n", "")
    drawn = (tmp_path / "cube.png").read_bytes()
    status, said, err = run("view", cube, "--field", "E")  # nobody named what it would replace
    assert (status, said) == (2, "") and err.endswith("got one: -o cube.png replaces it\n")
    assert (tmp_path / "cube.png").read_bytes() == drawn
    pixels = imread(tmp_path / "cube.png")[..., :3]
    colour = np.array(quantity("HU").scale(np.array([300.0]))[0].to_rgba(300.0)[:3])
    direction = pixels / np.maximum(np.linalg.norm(pixels, axis=2, keepdims=True), 1e-9)
    assert np.mean(direction @ (colour / np.linalg.norm(colour)) > 0.999) > 0.2  # lit and outlined, but of its colour


def test_field_cut_and_edges_change_the_picture(run: Command, cube: Path, tmp_path: Path) -> None:
    made = []
    for number, words in enumerate(
        [[], ["--field", "E"], ["--clip", "x"], ["--clip", "z", "--field", "e-mpa"], ["--from", "pi"]]
    ):
        path = tmp_path / f"{number}.png"
        status, out, _ = run("view", cube, *words, "-o", path)
        assert status == 0 and ("E_MPa" in out) == ("--field" in words)
        made.append(path.read_bytes())
    assert len(set(made)) == len(made)


def test_edges_too_small_to_be_seen_are_drawn_where_asked_for(run: Command, tmp_path: Path) -> None:
    x, y = np.meshgrid(np.arange(360.0), np.arange(270.0), indexing="ij")
    points = np.stack([x.ravel(order="F"), y.ravel(order="F"), np.zeros(x.size)], axis=1)
    write(Mesh(points, "quad4", structure=x.shape, fields={"HU": np.full(x.size, 500.0)}), tmp_path / "fine.vtu")
    for words in ([], ["--edges"]):
        assert run("view", tmp_path / "fine.vtu", "-o", tmp_path / f"{len(words)}.png", *words)[0] == 0
    plain, edged = (imread(tmp_path / f"{n}.png")[200:400, 200:400, :3].mean() for n in (0, 1))
    assert edged < plain - 0.05  # dark lines on a light face


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--field", "stress"], "expected a field of the mesh (HU, E_MPa), got 'stress'"),
        (["--clip", "w"], "across x, y or z, got 'w'"),
        (["--from", "X"], "letters of L, R, A, P, S, I to see a body from, such as A or ALS, got 'X'"),
        (["--from", "LR"], "got 'LR'"),
        (["-o", "none/a.png"], "does not exist"),
        (["-o", "a.pdf"], "ends in .png"),
    ],
)
def test_bad_input_is_one_line(run: Command, cube: Path, tmp_path: Path, words: list[str], message: str) -> None:
    output = [] if "-o" in words else ["-o", tmp_path / "a.png"]
    status, out, err = run("view", cube, *words, *output)
    assert (status, out) == (2, "") and message in err and err.count("\n") == 1
    assert list(tmp_path.iterdir()) == [cube]


def test_a_mesh_without_fields_is_judged(run: Command, tmp_path: Path) -> None:
    points = np.array([[x, y, z] for z in (0.0, 1.0) for y in (0.0, 1.0) for x in (0.0, 1.0)])
    write(Mesh(points, "hex8", structure=(2, 2, 2)), tmp_path / "bare.vtu")
    assert "coloured by scaled_jacobian" in run("view", tmp_path / "bare.vtu", "-o", tmp_path / "a.png")[1]


def test_fields_by_the_beginning_of_their_names() -> None:
    names = ["HU", "E_MPa", "scaled_jacobian", "von_mises_mpa", "displacement_mm_x", "displacement_mm_y", "energy"]
    for wanted, found in (
        ("E", "E_MPa"),
        ("hu", "HU"),
        ("von-mises", "von_mises_mpa"),
        (None, "von_mises_mpa"),
        ("energy", "energy"),
    ):
        assert find_field(names, wanted) == found
    with pytest.raises(InputError, match="begins displacement_mm_x, displacement_mm_y"):
        find_field(names, "disp")
    assert find_field(["weight"]) == "weight"
    with pytest.raises(InputError, match="without fields"):
        find_field([])


def test_with_a_screen_a_window_opens(cube: Path, tmp_path: Path) -> None:
    pytest.importorskip("pyvista")
    xvfb = shutil.which("Xvfb")
    if xvfb is None:
        if os.environ.get("CI"):
            pytest.fail("Xvfb (Debian's xvfb) is not installed")
        pytest.skip("Xvfb is not installed")
    program = (
        "import sys; from gpubspline.export import read_mesh; from gpubspline.report import window\n"
        "assert window.has_screen()\n"
        "for clip in (None, 'x'):\n"
        "    plotter = window.open_window(read_mesh(sys.argv[1]), 'E_MPa', clip=clip, edges=True)\n"
        "    plotter.show(interactive=False, auto_close=False)\n"
        "    plotter.screenshot(f'{sys.argv[2]}/{clip}.png'); plotter.close()\n"
    )
    reads, writes = os.pipe()
    with subprocess.Popen(
        [xvfb, "-displayfd", str(writes), "-screen", "0", "1280x1024x24", "-nolisten", "tcp"],
        pass_fds=[writes],
        stderr=subprocess.DEVNULL,
    ) as server:
        try:
            os.close(writes)
            with os.fdopen(reads) as said:
                display = said.readline().strip()
            words = [sys.executable, "-c", program, str(cube), str(tmp_path)]
            subprocess.run(words, env={**os.environ, "DISPLAY": f":{display}"}, check=True, timeout=120)
        finally:
            server.terminate()
    whole, cut = (imread(tmp_path / f"{name}.png")[..., :3] for name in (None, "x"))
    assert np.mean(np.any(whole < 0.95, axis=2)) > 0.05 and not np.array_equal(whole, cut)
