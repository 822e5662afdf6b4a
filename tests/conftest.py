"""Fixtures of the whole suite: where the real CT lies, and a device of each backend."""

import os
from pathlib import Path

import pytest

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
        return open_device(name, precision)
    except BackendUnavailable as error:
        if os.environ.get("CI"):
            raise
        pytest.skip(str(error))


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
