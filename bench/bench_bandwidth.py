"""The machine's own bandwidth, which every other figure is held against.

Floors. fill: 4 bytes written a value, no operation. triad: 8 bytes read and 4 written, 2 operations. What a cache reads
of a line before it is written is not counted: a kernel that writes only is held against ``fill``, one that also reads
against ``triad``.

Both are of buffers as the library's devices reserve them, in pages of 2 MB where Linux grants them. In pages of 4 kB a
core of Zen 5 in a virtual machine fills 30 GB/s rather than 44, and two 42 to 55 rather than 80 to 87: less than triad,
which waits for its reads meanwhile. 32 or 64 bytes a store make no difference.
"""

from collections.abc import Iterator

import numpy as np

from gpubspline.bench.measure import Place, Row, best_of, check
from gpubspline.device import Device

SIZES = {"full": 1 << 26, "quick": 1 << 26, "tiny": 1 << 12}  # 256 MB an array: far more than the caches hold
FAST_SIZE = 1 << 28
BYTES = {"fill": 4, "triad": 12}


def measure(device: Device, scale: str) -> Place:
    """Measure the bandwidth of a device by kernels of its own backend."""
    n = SIZES[scale]
    place = Place(device, *_bandwidths(device, n), scale)
    return Place(device, *_bandwidths(device, FAST_SIZE), scale) if place.fast and scale != "tiny" else place


def _bandwidths(device: Device, n: int) -> tuple[float, float]:
    rng = np.random.default_rng(1)
    a, b = (rng.random(n, dtype=np.float32) for _ in range(2))
    factor = float(np.float32(rng.random()))
    buffers, out = [device.put(values) for values in (a, b)], device.empty(n)

    def fill() -> None:
        device.launch("bandwidth.fill", n, out, factor, n)
        device.wait()

    def triad() -> None:
        device.launch("bandwidth.triad", n, *buffers, factor, n, out)
        device.wait()

    fill()
    check("fill", device.get(out), np.full(n, factor, np.float32), 0.0)
    triad()
    check("triad", device.get(out), a + np.float32(factor) * b, 1e-6)
    return BYTES["fill"] * n / best_of(fill), BYTES["triad"] * n / best_of(triad)


def rows(place: Place) -> Iterator[Row]:
    """Bandwidth as rows: seconds for a gigabyte."""
    for name, bandwidth in (("fill", place.fill), ("triad", place.triad)):
        yield Row(name, "1 GB", place.device.name, 1e9 / bandwidth, 10**9, 1.0)
