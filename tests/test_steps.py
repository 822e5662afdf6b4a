"""Ten lines of Python, in a script and in a notebook: what they make, what they show, and when they are silent."""

import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

import gpubspline as gb
from gpubspline import progress
from gpubspline.clock import Clock
from gpubspline.errors import InputError
from gpubspline.pipeline import fit_patch
from gpubspline.progress import LoggedClock, ShownClock, is_watched
from gpubspline.recipe import Shaping, Source

TEN_LINES = """\
import gpubspline as gb
volume = gb.read(SERIES)
region = gb.region(volume, threshold_hu=300)
patch = gb.patch(volume, region, (9, 10, 14))
mesh = gb.sample(patch, (9, 10, 14))
mesh, material = gb.apply_material(mesh)
mesh, quality = gb.assess(mesh)
gb.write(mesh, OUTPUT)
print(quality.n_elements, quality.inverted)
picture = mesh.plot("E", clip="y")
"""


@pytest.fixture(scope="module")
def series(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("steps") / "femur"
    gb.write_phantom("child-femur", folder)
    return folder


def ten_lines(series: Path, output: Path) -> str:
    return TEN_LINES.replace("SERIES", repr(str(series))).replace("OUTPUT", repr(str(output)))


def test_ten_lines_do_the_job_and_are_silent_when_piped(series: Path, tmp_path: Path) -> None:
    assert TEN_LINES.count("\n") == 10
    finished = subprocess.run(
        [sys.executable, "-c", ten_lines(series, tmp_path / "m.vtu")], capture_output=True, text=True, check=True
    )
    assert (finished.stdout, finished.stderr) == ("936 0\n", "")
    assert {"HU", "E_MPa", "nu"} <= gb.read_mesh(tmp_path / "m.vtu").fields.keys()


def test_steps_are_those_of_the_pipeline(series: Path) -> None:
    device = gb.open_device()
    fitted = fit_patch(Source(series, threshold_hu=300), Shaping((9, 10, 14)), device, Clock())
    volume = gb.read(series)
    region = gb.region(volume, 300)
    np.testing.assert_array_equal(gb.patch(volume, region, (9, 10, 14)).control, fitted.fit.patch.control)
    np.testing.assert_array_equal(gb.region(volume, mask=region.mask).mask, region.mask)
    otsu = gb.region(volume)
    np.testing.assert_array_equal(otsu.mask, gb.region(volume, gb.otsu_threshold(volume)).mask)
    assert gb.patch(volume, region).shape == fit_patch(Source(series, 300), Shaping(), device, Clock()).fit.patch.shape


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"threshold_hu": 3.0, "mask": "m.nii"}, "a threshold or a mask, got both"),
        ({"label": 3}, "a label together with a mask file"),
        ({"threshold_hu": 1e5}, "lower it"),
    ],
)
def test_bad_steps_are_named(series: Path, options: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        gb.region(gb.read(series), **options)  # type: ignore[arg-type]


def test_progress_is_silent_in_a_pipe_and_shown_on_a_terminal(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert not is_watched()
    monkeypatch.setattr("sys.stderr.isatty", lambda: True, raising=False)
    assert is_watched()
    with ShownClock(is_watched()) as clock, clock.stage("read"):
        clock.advance(1, 2)
    assert "read" in capsys.readouterr().err


def test_a_log_is_told_now_and_then_what_is_done(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(progress, "EVERY_S", 0.01)
    said = ""
    with LoggedClock() as clock, clock.stage("blocks"):
        clock.tell("900 hexes")
        clock.advance(3, 7)
        while "\n" not in said:
            said += capsys.readouterr().err
    assert "gpubspline: blocks, 900 hexes, 3 of 7: 0 s\n" in said and clock.seconds.keys() == {"blocks"}


def test_a_notebook_shows_volume_mesh_and_quality(series: Path, tmp_path: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import nbformat
        from nbclient import NotebookClient
    make = ten_lines(series, tmp_path / "m.vtu")
    cells = [make, "volume", "mesh", "quality", "picture", "gb.from_pyvista(mesh.to_pyvista()).n_elements"]
    book = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(cell) for cell in cells])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the client's event loop and sockets
        NotebookClient(
            book, timeout=180, kernel_name="python3", resources={"metadata": {"path": str(tmp_path)}}
        ).execute()
    first, *shown = (cell.outputs for cell in book.cells)
    said = "".join(output.get("text", "") for output in first if output.output_type == "stream")
    assert said == "936 0\n"  # and no warning
    bars = [output for output in first if "application/vnd.jupyter.widget-view+json" in output.get("data", {})]
    assert len(bars) >= 3  # read, region and patch
    volume, mesh, quality, picture, count = (outputs[0]["data"] for outputs in shown)
    assert volume["text/html"].count("<img") == 3 and "data:image/png;base64," in volume["text/html"]
    assert "936 hex8" in mesh["text/html"] and "E_MPa" in mesh["text/html"]
    assert "histogram" in quality["text/html"] and "image/png" in picture
    assert count["text/plain"] == "936"
    assert "http" not in volume["text/html"] + mesh["text/html"] + quality["text/html"]
