"""The same work on one core and on all of them, on CPUs.

Floors: none of its own; work that memory bounds stops scaling where one core's loads fill what the others share.
The peer ``one core`` is this program in a process that may use one core only.
"""

import os
import subprocess
import sys
from collections.abc import Callable, Iterator

import numpy as np

from gpubspline.bench.bench_evaluate import PAPER, random_patch
from gpubspline.bench.bench_quality import jittered
from gpubspline.bench.bench_resample import grid_and_points
from gpubspline.bench.measure import Place, Row, best_of
from gpubspline.bench.recorder import Recorder
from gpubspline.device import Device, open_device
from gpubspline.mesh.distance import sample_distance
from gpubspline.mesh.mesh import Mesh
from gpubspline.mesh.quality import scaled_jacobian

SIZES = {"full": 200, "quick": 200, "tiny": 8}  # nodes a direction
LIMIT = {"POCL_MAX_PTHREAD_COUNT": "1"}
ALONE = """
import os, sys
if hasattr(os, "sched_setaffinity"):
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
from gpubspline.bench import bench_scaling
bench_scaling.alone(*sys.argv[1:])
"""


def evaluated(device: Recorder, n: int) -> int:
    """Sample the paper's patch; how many nodes."""
    random_patch(PAPER, 3).evaluate_grid([np.linspace(0, 1, n)] * 3, device)
    return n**3


def judged(device: Recorder, n: int) -> int:
    """Judge structured hexes; how many."""
    return scaled_jacobian(jittered(n), device).size


def judged_by_numbers(device: Recorder, n: int) -> int:
    """Judge as many hexes by a table of their nodes."""
    grid = jittered(n)
    return scaled_jacobian(Mesh(grid.points, "hex8", connectivity=grid.cells), device).size


def resampled(device: Recorder, n: int) -> int:
    """Sample a scan at points in the order of a mesh; how many."""
    region, _, at = grid_and_points((n,) * 3, (n,) * 3)
    return sample_distance(region, at, device).size


WORKS: dict[str, Callable[[Recorder, int], int]] = {
    "evaluate": evaluated,
    "quality-structured": judged,
    "quality-explicit": judged_by_numbers,
    "resample": resampled,
}


def rows(place: Place) -> Iterator[Row]:
    """Time each work here, and all of them in a process of one core."""
    if not place.device.cores:
        return
    n = SIZES[place.scale]
    arguments = [sys.executable, "-c", ALONE, place.device.name, str(n)]
    told = subprocess.run(arguments, check=True, capture_output=True, text=True, env={**os.environ, **LIMIT}).stdout
    for work, seconds in zip(WORKS, told.split(), strict=True):
        mine, items = timed(work, place.device, n)
        yield Row("scaling", work, place.device.name, mine, items, None, {"one core": float(seconds)})


def timed(work: str, device: Device, n: int) -> tuple[float, int]:
    """Least seconds of a work's launches, and how many items they make."""
    recorder = Recorder(device)
    items = WORKS[work](recorder, n)
    return best_of(recorder.replay), items


def alone(device: str, n: str) -> None:
    """Print the seconds of each work in this process."""
    print(*(timed(work, open_device(device), int(n))[0] for work in WORKS))
