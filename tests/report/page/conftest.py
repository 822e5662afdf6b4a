"""A real browser without a window, and a small mesh and CT whose every value is known."""

import os
import shutil
import tempfile
import warnings
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from gpubspline.ct.volume import Volume
from gpubspline.mesh.mesh import Mesh

FLAGS = (
    *("--headless=new", "--no-sandbox", "--no-first-run", "--disable-quic", "--hide-scrollbars"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
    *("--use-angle=swiftshader", "--enable-unsafe-swiftshader"),  # WebGL without a graphics card
)


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    """Chromium at 1280 x 900; a skip where it is missing, and a failure in CI, which must have it."""
    programs = [shutil.which(name) for name in ("chromium", "chromedriver")]
    if None in programs:
        missing = "chromium and chromedriver (Debian's chromium and chromium-driver) are not installed"
        if os.environ.get("CI"):
            pytest.fail(missing)
        pytest.skip(missing)
    with warnings.catch_warnings(), tempfile.TemporaryDirectory() as profile:
        warnings.simplefilter("ignore")
        from selenium import webdriver

        options = webdriver.ChromeOptions()
        options.binary_location = str(programs[0])
        for flag in (*FLAGS, "--window-size=1280,900", f"--user-data-dir={profile}"):
            options.add_argument(flag)
        options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
        driver = webdriver.Chrome(options=options, service=webdriver.ChromeService(str(programs[1])))
        try:
            yield driver
        finally:
            driver.quit()


def made_box(counts: tuple[int, ...] = (7, 6, 5), spacing_mm: float = 2.0) -> Mesh:
    """Hexes whose HU, E and von Mises stress rise differently, and whose scaled Jacobian is that of no other."""
    grid = np.meshgrid(*(spacing_mm * np.arange(n) for n in counts), indexing="ij")
    points = np.stack([a.ravel(order="F") for a in grid], axis=1)
    x, y, z = points.T
    fields = {"HU": 100 + 40 * x + 7 * y + z, "E_MPa": 50 * 1.4**x, "von_mises_mpa": 1 + y * z}
    mesh = Mesh(points, "hex8", structure=counts, fields=fields)
    return mesh.with_cell_fields({"scaled_jacobian": np.linspace(0.2, 0.95, mesh.n_elements)})


@pytest.fixture(scope="session")
def box() -> Callable[..., Mesh]:
    """Makes a box of hexes."""
    return made_box


@pytest.fixture(scope="session")
def scan() -> Volume:
    """CT of 1 mm around the box, its i running from left to right, whose left anterior superior corner is bright."""
    hu = np.zeros((20, 20, 24), dtype=np.int16)
    hu[14:, :6, :6] = 1000  # superior: high k; anterior: low j; left: low i
    affine = np.array([[-1.0, 0, 0, 17], [0, 1, 0, -5], [0, 0, 1, -6], [0, 0, 0, 1]])
    return Volume(hu, affine)
