"""An interrupt is one line and the exit status that shells give it, and leaves no file."""

import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gpubspline import pipeline, streaming


@pytest.fixture
def ct(tmp_path: Path) -> Path:
    k, j, i = np.mgrid[:12, :12, :12] - 5.5
    np.save(tmp_path / "ball.npy", np.where(k**2 + j**2 + i**2 < 20, 500, -1000).astype(np.int16))
    return tmp_path / "ball.npy"


def press(*_: Any, **__: Any) -> None:
    signal.raise_signal(signal.SIGINT)


def load(*_: Any, **__: Any) -> None:
    """Load a compiled module meanwhile, which says it in its own way."""
    raise ImportError("initialization failed") from KeyboardInterrupt()


@pytest.mark.parametrize("interrupt", [press, load])
def test_an_interrupt_is_one_line(run: Any, ct: Path, monkeypatch: pytest.MonkeyPatch, interrupt: Any) -> None:
    monkeypatch.setattr(pipeline, "fit", interrupt)
    told = run("mesh", ct, "--spacing", "1,1,1", "--method", "tensor", "-o", ct.parent / "m.vtu")
    assert told == (130, "", "gpubspline: error: interrupted\n")
    assert [path.name for path in ct.parent.iterdir()] == ["ball.npy"]


WHILE_LOADING = """
import sys

class Press:
    def find_spec(self, name, *_):
        if name == "typer":
            raise KeyboardInterrupt

sys.meta_path.insert(0, Press())
from gpubspline.cli import main
main()
"""


def test_an_interrupt_while_the_command_line_loads_is_one_line_too() -> None:
    ended = subprocess.run([sys.executable, "-c", WHILE_LOADING], capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stdout, ended.stderr) == (130, "", "gpubspline: error: interrupted\n")


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_what_ends_a_process_leaves_no_half_of_a_file(
    run: Any, ct: Path, monkeypatch: pytest.MonkeyPatch, number: signal.Signals
) -> None:
    def end(*_: Any, **__: Any) -> None:
        assert any(path.name.startswith(".m.") for path in ct.parent.iterdir())
        signal.raise_signal(number)

    before = signal.signal(number, signal.SIG_DFL)  # nohup has it ignored

    monkeypatch.setattr(streaming, "write_slab", end)
    try:
        status, said, err = run("mesh", ct, "--spacing", "1,1,1", "--control", "5,5,5", "-o", ct.parent / "m.vts")
    finally:
        signal.signal(number, before)
    assert (status, said, err) == (128 + number, "", "gpubspline: error: terminated\n")
    assert [path.name for path in ct.parent.iterdir()] == ["ball.npy"]


def test_other_errors_of_loading_are_not_hidden(run: Any, ct: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: Any, **__: Any) -> None:
        raise ImportError("no such module")

    monkeypatch.setattr(pipeline, "fit", broken)
    with pytest.raises(ImportError, match="no such module"):
        run("mesh", ct, "--spacing", "1,1,1", "--method", "tensor", "-o", ct.parent / "m.vtu")
