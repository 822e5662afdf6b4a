"""What each row of the bench should reach on a machine of two cores, and whether it does.

Kernels are held to figures of their own by OpenCL on a CPU, to a fifth of its speed by Warp on a CPU, and to a share of
the bandwidth on a GPU, whatever the backend. A peer that is absent is no aim.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from gpubspline.bench.measure import Row

TIMES: dict[str, dict[str, float]] = {  # as fast as a peer
    # scipy float64: sparse design matrices as they come, 16 to 24 million nodes a second where the aim was set, 40 to
    # 50 on a core of Zen 5. The fast form of our own, 140 to 230 million, has no aim: ten times is all that memory
    # allows. splinepy: at 200^3 nodes and more
    "evaluate": {"scipy float64": 20, "splinepy": 1000},
    "quality-structured": {"VTK": 25},
    "quality-explicit": {"VTK": 10},
    "fused": {"slowest part": 0.8},
    "resample": {"scipy.ndimage": 10},
    "mapping": {"published, Python": 100},
    "scaling": {"one core": 1.5},
    "elasticity-solve": {"CalculiX SPOOLES": 10, "CalculiX Cholesky": 4, "CalculiX scaling": 4},
}
SHARES = {  # of bandwidth
    "evaluate": 0.55,
    "elasticity-operator": 0.25,
    "write-vtu": 0.5,
    "write-vts": 0.5,
    "write-vtkhdf": 0.5,
}
GPU_SHARES = {  # of the driver's copy, or of gathers
    "evaluate": 0.7,
    "resample": 0.7,
    "quality-structured": 0.5,
}
ENOUGH = 1e8  # nodes, elements or points, from which on a GPU is busy for long enough
SECONDS = {"lattice": 2.0, "read-dicom": 3.0}
START_UP = {"gpubspline --help": 0.5, "first patch": 2.0}
SECONDS_A_HEX = {"write-inp": 1 / 1.33e6, "elasticity-growth": 240 / 1e6, "blocks": 360 / 1e6}
LINEAR = 1.05  # exponent of processor seconds in hexes of blocks
SECONDS_A_NODE = 90 / 104e6  # of a hundred million nodes, from scan to file
PEAK_BYTES = {"scale": 6e9, "elasticity-growth": 4e9}
SLOWEST = 5.0  # Warp beside OpenCL, both on the CPU
STEEPEST = 1.6  # evaluation of any control points beside those of the paper
ON_BOTH = ("evaluate", "quality-structured", "quality-explicit", "fused", "resample")
LARGE = 9.9e5  # from so many hexes on what does not grow with them no longer counts
LARGE_SCAN = 1e8  # nodes


@dataclass(frozen=True)
class Aim:
    """What a row should reach, in words, and whether it does."""

    words: str
    reached: bool

    def __str__(self) -> str:
        return f"{self.words} {'reached' if self.reached else 'missed'}"


def aims(row: Row, before: Sequence[Row] = ()) -> list[Aim]:
    """Aims of a row; those beside another row where that is one of ``before``."""
    if row.device == "warp:cpu" and row.name in ON_BOTH:
        return list(_beside_opencl(row, before))
    if row.gpu:  # neighbours in the order of a mesh share what they read: what that may take at least is not known
        held = row.items >= ENOUGH and "mesh order" not in row.size
        return list(_share(row, GPU_SHARES.get(row.name))) if held else []
    if row.name == "scaling" and not row.device.startswith("warp"):
        return []
    beside_paper = list(_beside_paper(row))  # other control points have no aim but this
    return beside_paper or [*_share(row, SHARES.get(row.name)), *_times(row), *_seconds(row), *_linear(row)]


def _share(row: Row, least: float | None) -> Iterator[Aim]:
    if least is not None and row.bandwidth_fraction is not None:
        yield Aim(f"{100 * least:.0f} % of bandwidth", row.bandwidth_fraction >= least)


def _times(row: Row) -> Iterator[Aim]:
    for name, least in TIMES.get(row.name, {}).items():
        ratio = row.ratio.get(name)
        if ratio is not None:
            yield Aim(f"{least:g} x {name}", ratio >= least)


def _seconds(row: Row) -> Iterator[Aim]:
    most = START_UP.get(row.size) if row.name == "start-up" else SECONDS.get(row.name)
    found = re.match(r"([\d,]+) ", row.size)
    count = int(found[1].replace(",", "")) if found else 0
    if row.name in SECONDS_A_HEX and count >= LARGE:
        most = SECONDS_A_HEX[row.name] * count
    if row.name == "scale" and count >= LARGE_SCAN:
        most = SECONDS_A_NODE * count
    if most is not None:
        yield Aim(f"{most:.2g} s", row.seconds <= most)
    enough = count >= (LARGE_SCAN if row.name == "scale" else LARGE)
    if row.peak_bytes is not None and row.name in PEAK_BYTES and enough:
        yield Aim(f"{PEAK_BYTES[row.name] / 1e9:g} GB", row.peak_bytes <= PEAK_BYTES[row.name])


def _linear(row: Row) -> Iterator[Aim]:
    found = re.fullmatch(r"[\d,]+ to [\d,]+ hex8, exponent (\S+)", row.size)  # stages have none
    if row.name == "blocks-growth" and found:
        yield Aim(f"linear, {LINEAR:g}", float(found[1]) <= LINEAR)


def _beside_opencl(row: Row, before: Sequence[Row]) -> Iterator[Aim]:
    for other in before:
        if other.device.startswith("opencl") and (other.name, other.size) == (row.name, row.size):
            yield Aim(f"{SLOWEST:g} x the time of OpenCL", row.seconds <= SLOWEST * other.seconds)


def _beside_paper(row: Row) -> Iterator[Aim]:
    """Time a node of other control points, beside the paper's patch of the same device and nodes."""
    ratio = row.ratio.get("cubic 20x24x46")
    if ratio is not None:
        yield Aim(f"{STEEPEST:g} x the time of cubic 20x24x46", ratio >= 1 / STEEPEST)
