"""The machine's own bandwidth, which every other figure is held against.

Floors. fill: 4 bytes written a value, no operation. triad: 8 bytes read and 4 written, 2 operations. What a cache reads
of a line before it is written is not counted: on a CPU a kernel that only writes is held against ``fill``, one that
reads too against ``triad``. A GPU's kernels are all held against its driver's copy, bytes read and written, and what
they read from anywhere in a CT against ``gather``: a number read in no order costs a whole sector of memory.

Both are of buffers as the library's devices reserve them, in pages of 2 MB where Linux grants them. In pages of 4 kB a
core of Zen 5 in a virtual machine fills 30 GB/s rather than 44, and two 42 to 55 rather than 80 to 87: less than triad,
which waits for its reads meanwhile. 32 or 64 bytes a store make no difference.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.bench.measure import Place, Row, Run, best_of, check
from gpubspline.device import Buffer, Device

SIZES = {"full": 1 << 26, "quick": 1 << 26, "tiny": 1 << 12}  # 256 MB an array: far more than the caches hold
FAST_SIZE = 1 << 28
BYTES = {"fill": 4, "triad": 12, "copy": 8}
NUMBERS = 4  # that a work item of a GPU takes
CT = 200 * 512 * 512  # samples that are gathered from


def measure(device: Device, scale: str) -> Place:
    """Measure the bandwidth of a device by kernels of its own backend."""
    n = FAST_SIZE if not device.cores and scale != "tiny" else SIZES[scale]
    rng = np.random.default_rng(1)
    a, b = (rng.random(n, dtype=np.float32) for _ in range(2))
    factor = float(np.float32(rng.random()))
    buffers, out = [device.put(values) for values in (a, b)], device.empty(n)

    def timed(name: str, run: Run, wanted: NDArray[Any], tolerance: float) -> float:
        run()
        check(name, device.get(out), wanted, tolerance)
        return BYTES[name] * n / best_of(run)

    def wrote() -> None:
        fill(device, out, factor, n)
        device.wait()

    def added() -> None:
        device.launch("bandwidth.triad", items(device, n), *buffers, factor, n, items(device, n), out)
        device.wait()

    def copied() -> None:
        device.copy(buffers[0], out)
        device.wait()

    filled = timed("fill", wrote, np.full(n, factor, np.float32), 0.0)
    place = Place(device, filled, timed("triad", added, a + np.float32(factor) * b, 1e-6), scale)
    if device.cores:
        return place
    return replace(place, copy=timed("copy", copied, a, 0.0), gathers=_gathers(device, scale))


def fill(device: Device, out: Buffer, value: float, n: int) -> None:
    """Launch the writing of a number to ``n`` places."""
    device.launch("bandwidth.fill", items(device, n), out, value, n, items(device, n))


def items(device: Device, n: int) -> int:
    """Work items for ``n`` numbers."""
    return n if device.cores else -(-n // NUMBERS)


def _gathers(device: Device, scale: str) -> float:
    """Numbers a second that are read from a CT in no order, each at a place that is read first."""
    rng, n = np.random.default_rng(8), SIZES[scale]
    samples = rng.random(CT if scale != "tiny" else 1000, dtype=np.float32)
    index = rng.integers(0, len(samples), n, dtype=np.int32)
    arguments = (device.put(samples), device.put(index), n, items(device, n))
    out = device.empty(n)

    def run() -> None:
        device.launch("bandwidth.gather", items(device, n), *arguments, out)
        device.wait()

    run()
    check("gather", device.get(out), samples[index], 0.0)
    return n / best_of(run)


def rows(place: Place) -> Iterator[Row]:
    """Bandwidth as rows: seconds for a gigabyte, and for a thousand million numbers from anywhere."""
    for name, bandwidth in (("fill", place.fill), ("triad", place.triad), ("copy", place.copy)):
        if bandwidth:
            yield Row(name, "1 GB", place.device.name, 1e9 / bandwidth, 10**9, 1.0)
    if place.gathers:
        yield Row("gather", "1,000,000,000 numbers", place.device.name, 1e9 / place.gathers, 10**9)
