"""Time and peak memory of ``gpubspline mesh`` from scan to file, against nodes.

Floors, a node of a structured file: x, y, z, HU, density, E and nu, and a scaled Jacobian and a material number of an
element, 36 bytes written to the file; everything before the slabs does not grow with the nodes, so that time is linear
and memory flat.
"""

import re
import subprocess
import sys
from collections.abc import Iterator, Sequence
from math import floor, log10
from pathlib import Path
from time import perf_counter, sleep

from gpubspline.bench.measure import Host, Row, WrongResult
from gpubspline.ct.phantom_dicom import write_phantom
from gpubspline.device import open_device
from gpubspline.files import whole_file

NODES = {"full": [1e5, 1e6, 1e7, 1e8], "quick": [1e5, 1e6, 1e7, 1e8], "tiny": [1e3]}
SHAPE = (480, 480, 450)
PHANTOM = {"full": "head", "quick": "head", "tiny": "child-femur"}
CONTROL = {"full": "20,80,26", "quick": "20,80,26", "tiny": "6,7,8"}


def rows(host: Host) -> Iterator[Row]:
    """Run the command in a process of its own for each count of nodes."""
    series = host.folder / "ct"
    write_phantom(PHANTOM[host.scale], series)
    output = host.folder / "big.vts"
    for wanted in NODES[host.scale]:
        share = (wanted / (SHAPE[0] * SHAPE[1] * SHAPE[2])) ** (1 / 3)
        counts = [round(n * share) for n in SHAPE]
        nodes = counts[0] * counts[1] * counts[2]
        options = ["--control", CONTROL[host.scale], "--nodes", ",".join(map(str, counts)), "--quiet"]
        command = [sys.executable, "-m", "gpubspline", "mesh", str(series), *options, "-o", str(output)]
        seconds, peak = watched(command)
        if not output.stat().st_size > 28 * nodes:
            raise WrongResult(f"expected {output.name} to hold seven values of {nodes} nodes, got a smaller file")
        output.unlink()
        yield Row("scale", f"{nodes:,} nodes to .vts", open_device().name, seconds, nodes, peak_bytes=peak)


def watched(command: Sequence[str]) -> tuple[float, int | None]:
    """Seconds and peak memory (None where there is no /proc) of a process.

    What the system tells of one that has ended includes its parent's memory from before it became another program.
    """
    start, peak = perf_counter(), None
    process = subprocess.Popen(command)
    while process.poll() is None:
        peak = _peak_bytes(process.pid) or peak
        sleep(0.01)
    if process.returncode:
        raise WrongResult(f"expected {' '.join(command[2:4])} to end well, got status {process.returncode}")
    return perf_counter() - start, peak


def _peak_bytes(pid: int) -> int | None:
    try:
        status = Path(f"/proc/{pid}/status").read_text()
    except OSError:  # it has just ended, or there is no /proc
        return None
    found = re.search(r"VmHWM:\s+(\d+) kB", status)
    return 1024 * int(found[1]) if found else None


def draw(found: Sequence[Row], path: Path) -> None:
    """Draw seconds and peak memory against nodes, .png."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 3.2), layout="constrained")
    panels = figure.subplots(1, 2)
    nodes = [row.items for row in found]
    values = [[row.seconds for row in found], [(row.peak_bytes or 0) / 1e9 for row in found]]
    for axes, name, heights in zip(panels, ("time, s", "peak memory, GB"), values, strict=True):
        axes.loglog(nodes, heights, "o-", color="#1f5fa8")
        axes.set(xlabel="nodes", title=name)
        low, high = (max(end, 1e-3) for end in (min(heights), max(heights)))  # no memory is known without /proc
        axes.set_ylim(10.0 ** floor(log10(low)), 10.0 ** (floor(log10(high)) + 1))
        axes.yaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_minor_formatter("")
        axes.grid(alpha=0.3, which="both")
    with whole_file(path) as temporary:
        figure.savefig(temporary, dpi=150)
