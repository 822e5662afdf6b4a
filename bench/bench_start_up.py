"""What a fresh process costs: the help page, and the first kernels with compiled ones in their caches.

Floors: none of bytes; Python itself starts in some 0.02 s, NumPy in 0.1 s.
"""

import subprocess
import sys
from collections.abc import Iterator

from gpubspline.bench.measure import Host, Place, Row, best_of

FIRST_KERNELS = """
import sys
import numpy as np
import gpubspline as gb
device = gb.open_device(sys.argv[1])
patch = gb.hyperpatch(np.random.default_rng(0).random((4, 4, 4, 4)), 3)
patch.evaluate_grid([np.linspace(0, 1, 4)] * 3, device)
"""


def without_kernels(host: Host) -> Iterator[Row]:
    """Time the interpreter alone, ``import gpubspline`` and ``gpubspline --help``."""
    yield Row("start-up", "python", "host", _seconds("-c", ""), 1)
    yield Row("start-up", "import gpubspline", "host", _seconds("-c", "import gpubspline"), 1)
    yield Row("start-up", "gpubspline --help", "host", _seconds("-m", "gpubspline", "--help"), 1)


def first_kernels(place: Place) -> Iterator[Row]:
    """Time a process that evaluates one small patch and ends; the warm-up fills the caches."""
    yield Row("start-up", "first patch", place.device.name, _seconds("-c", FIRST_KERNELS, place.device.name), 1)


def _seconds(*arguments: str) -> float:
    def run() -> None:
        subprocess.run([sys.executable, *arguments], check=True, stdout=subprocess.DEVNULL)

    return best_of(run)
