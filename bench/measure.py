"""What every bench shares: rows, the least time of several runs, and peers, whose results are compared first."""

import importlib
import os
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.device import Device
from gpubspline.errors import GpubsplineError

SCALES = ("full", "quick", "tiny")
"""``quick`` takes minutes, ``tiny`` is for tests: its figures mean nothing."""

LONG = 5.0  # seconds: what takes longer is repeated once, not more
MOST = 1000  # runs

Run = Callable[[], Any]
Peer = Callable[[], tuple[Run, Callable[[Any], Any]]]
"""Prepares the peer's own form of the input and gives what is timed, and how to see its result as ours is shaped.

Raises ImportError where the peer is not installed.
"""


class WrongResult(GpubsplineError):
    """What was to be timed computes something else than its peer."""


@dataclass(frozen=True)
class Place:
    """Where a bench runs.

    Attributes
    ----------
    device: of float32.
    fill, triad: bandwidth measured there by kernels, bytes a second.
    scale: one of ``SCALES``.
    copy: of a GPU, bandwidth of its driver's copy, bytes read and written a second; 0 on a CPU.
    gathers: of a GPU, numbers a second that are read from anywhere in a CT; 0 on a CPU.
    """

    device: Device
    fill: float
    triad: float
    scale: str
    copy: float = 0.0
    gathers: float = 0.0

    @property
    def writing(self) -> float:
        """What kernels that only write are held against: ``fill``, on a GPU ``copy``."""
        return self.copy or self.fill

    @property
    def moving(self) -> float:
        """What kernels that also read are held against: ``triad``, on a GPU ``copy``."""
        return self.copy or self.triad

    @property
    def fast(self) -> bool:
        """Whether the memory is a GPU's, so that larger inputs are wanted for a run to last."""
        return self.fill > 2e11


@dataclass(frozen=True)
class Host:
    """Where a bench runs that has no device of its own.

    Attributes
    ----------
    folder: for its files; emptied between benches.
    scale: one of ``SCALES``.
    """

    folder: Path
    scale: str


@dataclass(frozen=True)
class Row:
    """One measurement.

    Attributes
    ----------
    name: of the work.
    size: of the input, in words.
    device: name of the device, or ``"host"``.
    seconds: least of several runs.
    items: how many nodes, elements, points or bytes were made, so that items / seconds is the rate.
    bandwidth_fraction: the least time in which the machine could move the bytes that must be moved, over ``seconds``;
        None where no bytes bound the work.
    peers: seconds of others for the same work, None for one that is not installed.
    peak_bytes: most memory of the process, where it was watched.
    gpu: whether the device is one.
    """

    name: str
    size: str
    device: str
    seconds: float
    items: int
    bandwidth_fraction: float | None = None
    peers: dict[str, float | None] = field(default_factory=dict)
    peak_bytes: int | None = None
    gpu: bool = False

    @property
    def ratio(self) -> dict[str, float | None]:
        """How many times faster than each peer; None for one that is not installed."""
        return {name: None if seconds is None else seconds / self.seconds for name, seconds in self.peers.items()}

    def to_dict(self) -> dict[str, Any]:
        """Plain values, for JSON."""
        return {**vars(self), "ratio": self.ratio}


def best_of(run: Run, *, warm_up: bool = True, budget: float = 1.0, at_least: int = 3) -> float:
    """Least seconds of some runs, and of more while they fit in ``budget`` seconds; of one that is long."""
    if warm_up:
        run()
    least, spent, runs = float("inf"), 0.0, 0
    while runs < at_least or (spent < budget and runs < MOST):
        start = perf_counter()
        run()
        seconds = perf_counter() - start
        least, spent, runs = min(least, seconds), spent + seconds, runs + 1
        if seconds > LONG:
            break
    return least


def best_in_turn(*runs: Run, rounds: int = 5) -> list[float]:
    """Least seconds of each of several runs, taken in turn, so that what disturbs one disturbs the others too.

    Of long ones there are fewer rounds, two at least after the first, which warms up.
    """
    seconds, start = list[list[float]](), perf_counter()
    while len(seconds) <= rounds and (len(seconds) < 3 or perf_counter() - start < 2 * LONG):
        seconds.append([best_of(run, warm_up=False, budget=0.0, at_least=1) for run in runs])
    return [min(found) for found in zip(*seconds[1:], strict=True)]


def check(what: str, ours: Any, theirs: Any, tolerance: float) -> None:
    """Raise ``WrongResult`` unless two arrays (planes, n) agree within ``tolerance`` of each plane's largest value."""
    ours, theirs = np.atleast_2d(ours), np.atleast_2d(theirs)
    if ours.shape != theirs.shape:
        raise WrongResult(f"expected {what} of shape {theirs.shape}, got {ours.shape}")
    for plane, other in zip(ours, theirs, strict=True):
        difference, size = _largest(plane - other), _largest(other)
        if not difference <= tolerance * size:
            raise WrongResult(f"expected {what} within {tolerance * size:.2g}, got a difference of {difference:.2g}")


def _largest(values: NDArray[Any]) -> float:
    return float(max(np.max(values), -np.min(values)))


def time_peers(what: str, ours: Any, tolerance: float, peers: dict[str, Peer]) -> dict[str, float | None]:
    """Compare each peer's result with ours, then time it; seconds by name, None for a peer that is not installed."""
    seconds: dict[str, float | None] = {}
    for name, prepare in peers.items():
        try:
            run, view = prepare()
        except ImportError:
            seconds[name] = None
            continue
        if ours is not None:
            check(f"{what} as {name} has it", ours, view(run()), tolerance)
        seconds[name] = best_of(run, warm_up=ours is None)
    return seconds


def time_beside(
    what: str, run: Run, ours: Any, tolerance: float, peers: dict[str, Peer]
) -> tuple[float, dict[str, float | None]]:
    """Compare each peer's result with ours, then time both in turn: least seconds of ``run``, and of each peer."""
    seconds, others = best_of(run), dict[str, float | None]()
    for name, prepare in peers.items():
        try:
            theirs, view = prepare()
        except ImportError:
            others[name] = None
            continue
        check(f"{what} as {name} has it", ours, view(theirs()), tolerance)
        mine, others[name] = best_in_turn(run, theirs)
        seconds = min(seconds, mine)
    return seconds, others


def peer(module: str) -> Any:
    """Import a peer; raises ImportError where it is not installed."""
    return importlib.import_module(module)


def cores() -> int:
    """Cores that this process may use, for peers that ask."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
