"""Fixtures of the whole suite: where the real CT lies, and a device of each backend."""

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gpubspline.cli import main
from gpubspline.device import BACKENDS, Device, open_device
from gpubspline.errors import BackendUnavailable

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"


@pytest.fixture(scope="session")
def data() -> Path:
    """Folder of the real CT data sets; tests that ask for it skip where it is absent."""
    if not DATA.is_dir():
        pytest.skip(f"no real CT data at {DATA}")
    return DATA


def opened(name: str, precision: str) -> Device:
    """A device, or a skip where its backend is missing (a failure in CI, which must have both)."""
    try:
        device = open_device(name, precision)
    except BackendUnavailable as error:
        if os.environ.get("CI"):
            raise
        pytest.skip(str(error))
    _poison(device)
    return device


UNWRITTEN = -1431655766
"""What integers hold before anything wrote them: as an index far out of range, as a count none."""


def _poison(device: Any) -> None:
    """Fill what ``empty`` reserves, and the padding behind, with what new memory seldom holds.

    Whoever reads before writing, or lets what it reads past the end count, is found: NaN goes on through sums.
    """
    if hasattr(device, "unpoisoned"):  # the same device is opened again
        return
    empty = device.unpoisoned = device.empty

    def poisoned(shape: int | tuple[int, ...], dtype: Any = None) -> Any:
        buffer = empty(shape, dtype)
        kind = np.dtype(device.real if dtype is None else dtype)
        value = np.array(np.nan if kind.kind == "f" else UNWRITTEN).astype(kind)
        if device.backend == "warp" and buffer.size:
            buffer.flat.fill_(value.item())
        elif device.backend == "opencl":
            filled = pyopencl.enqueue_fill_buffer(device._queue, buffer.memory, value, 0, buffer.memory.size)
            filled.wait()  # large buffers are mapped already: the host writes to them at once
        return buffer

    if device.backend == "opencl":
        import pyopencl
    device.empty = poisoned


@pytest.fixture(scope="session", params=BACKENDS)
def device(request: pytest.FixtureRequest) -> Device:
    """Each backend, float32."""
    return opened(request.param, "float32")


@pytest.fixture(scope="session", params=BACKENDS)
def device64(request: pytest.FixtureRequest) -> Device:
    """Each backend, float64."""
    return opened(request.param, "float64")


@pytest.fixture(scope="session", params=[(backend, real) for backend in BACKENDS for real in ("float32", "float64")])
def any_device(request: pytest.FixtureRequest) -> Device:
    """Each backend in each precision."""
    return opened(*request.param)


@pytest.fixture(scope="session")
def both_devices() -> tuple[Device, ...]:
    """Both backends at once, float32, to be compared."""
    return tuple(opened(backend, "float32") for backend in BACKENDS)


class Run:
    """Status and texts of one command of ``gpubspline``."""

    def __init__(self, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
        self._capsys, self._monkeypatch = capsys, monkeypatch

    def __call__(self, *words: object) -> tuple[int, str, str]:
        self._monkeypatch.setattr("sys.argv", ["gpubspline", *map(str, words)])
        with pytest.raises(SystemExit) as end:
            main()
        out, err = self._capsys.readouterr()
        return int(end.value.code or 0), out, err


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Run:
    """The command line, called in this process."""
    return Run(capsys, monkeypatch)
