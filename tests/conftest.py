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
    _leave_nan(device)
    return device


def _leave_nan(device: Any) -> None:
    """Fill what ``empty`` reserves with NaN, which new memory seldom holds: whoever reads before writing is found."""
    empty = device.empty

    def of_nan(shape: int | tuple[int, ...], dtype: Any = None) -> Any:
        buffer = empty(shape, dtype)
        if np.dtype(device.real if dtype is None else dtype).kind == "f" and buffer.size:
            if device.backend == "warp":
                buffer.fill_(np.nan)
            else:
                nothing, count = np.array(np.nan, buffer.dtype), buffer.size * buffer.dtype.itemsize
                pyopencl.enqueue_fill_buffer(device._queue, buffer.memory, nothing, 0, count)
        return buffer

    if device.backend == "opencl":
        import pyopencl
    device.empty = of_nan


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
