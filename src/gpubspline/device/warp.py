"""The Warp backend: CUDA devices, and the CPU through Warp's own compiler."""

import ctypes.util
import importlib
import os
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.device import Device, buffer_type, find_kernel, quietly
from gpubspline.device.pages import ask_for_large_pages
from gpubspline.errors import BackendUnavailable, InputError


def _import_warp() -> Any:
    try:
        import warp
    except ImportError as error:
        raise BackendUnavailable(f"Warp does not import ({error}); install it: pip install warp-lang") from None
    warp.config.log_level = warp.LOG_ERROR
    with nullcontext() if _cuda_driver() else _native_errors_hidden():
        warp.init()
    return warp


@contextmanager
def _native_errors_hidden() -> Iterator[None]:
    """Keep Warp's native code from writing to the terminal that there is no CUDA driver, which is known already."""
    sys.stderr.flush()
    kept = os.dup(2)
    try:
        with open(os.devnull, "wb") as nowhere:
            os.dup2(nowhere.fileno(), 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)


def _cuda_driver() -> bool:
    """Whether a CUDA driver is installed; asked before Warp is imported, which takes most of a second."""
    return ctypes.util.find_library("nvcuda" if os.name == "nt" else "cuda") is not None


CPU_LANES = (32, 8, 1)  # the most that a row holds
GPU_BLOCK = 256  # threads of a GPU that share a cache


@dataclass(frozen=True)
class _Found:
    """A kernel, whether it takes ``lanes``, how many a row may be cut into, and which arguments are lane arrays."""

    function: Any
    wide: bool
    counts: tuple[int, ...]
    positions: tuple[int, ...]


class WarpDevice:
    """One Warp device; on the CPU a launch would run on one thread, so its outermost dimension is split over a pool."""

    backend = "warp"

    def __init__(self, warp: Any, alias: str, real: "np.dtype[Any]") -> None:
        self._warp = warp
        self._device = warp.get_device(alias)
        self.name = f"warp:{alias}"
        self.label = self._device.name
        self.real = real
        self.on_build: Callable[[str], None] = quietly
        self._real = warp.float64 if real == np.float64 else warp.float32
        self._threads = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
        self._found: dict[str, _Found] = {}
        self._overloads: dict[Any, Any] = {}
        self.block = 1 if self._device.is_cpu else GPU_BLOCK
        self._pool = ThreadPoolExecutor(self._threads) if self._device.is_cpu else None
        self.cores = self._threads if self._device.is_cpu else 0

    def put(self, array: Any) -> Any:
        """Upload, the last index fastest; what is on a Warp device already comes back as it is."""
        if isinstance(array, self._warp.array):
            return array
        values = np.asarray(array)
        dtype = buffer_type(values, self.real)
        buffer = self.empty(values.size, dtype)
        if self._device.is_cpu:
            buffer.numpy().reshape(values.shape)[...] = values
        elif values.size:
            buffer.assign(np.ascontiguousarray(values, dtype=dtype).reshape(-1))
        return buffer

    def empty(self, shape: int | tuple[int, ...], dtype: Any = None) -> Any:
        """Reserve a buffer, on a CPU padded by the lanes that a kernel may read past its end; kernels see it flat."""
        kind = np.dtype(self.real if dtype is None else dtype)
        size = int(np.prod(shape, dtype=np.int64))
        padded = size + CPU_LANES[0] if size and self._device.is_cpu else size
        try:
            whole = self._warp.empty(padded, dtype=self._warp.dtype_from_numpy(kind), device=self._device)
        except (RuntimeError, ValueError) as error:
            raise MemoryError(f"{self.label} has no room for {padded * kind.itemsize:,} bytes: {error}") from None
        if self._device.is_cpu:
            ask_for_large_pages(whole.ptr or 0, padded * kind.itemsize)
        return whole[:size].reshape(shape) if size else whole.reshape(shape)

    def get(self, buffer: Any) -> NDArray[Any]:
        """Download."""
        return np.asarray(buffer.numpy())

    def copy(self, source: Any, target: Any) -> None:
        """Copy a buffer to one of the same shape and type."""
        self._warp.copy(target, source)

    def launch(self, kernel: str, dim: int | tuple[int, ...], *args: Any) -> None:
        """Run a kernel, in vectors of lanes where it is written so; see ``kernels/lanes.py``."""
        found = self._found.get(kernel) or self._find(kernel)
        shape = (dim,) if isinstance(dim, int) else tuple(map(int, dim))
        if 0 in shape:
            return
        lanes, last = 1, []
        if found.wide:
            lanes = next(count for count in found.counts if shape[-1] >= count)
            shape, last = (*shape[:-1], -(-shape[-1] // lanes)), [lanes]
        inputs = [self._argument(value) for value in args]
        for position in found.positions:
            inputs[position] = self._in_lanes(inputs[position], lanes)
        self._launch_shares(kernel, found.function, shape, inputs, last)

    def _find(self, kernel: str) -> _Found:
        """Look a kernel up, once; by ``REGISTER`` a module of kernels wants vectors of so many bytes on a CPU."""
        module, name = find_kernel(kernel)
        home = importlib.import_module(module)
        function, lanes = getattr(home, name), importlib.import_module("gpubspline.kernels.lanes")
        register, kinds = getattr(home, "REGISTER", None), (lanes.LaneArray, lanes.IntLaneArray)
        counts = (register // self.real.itemsize, 8, 1) if register else CPU_LANES
        arguments = function.adj.args
        positions = tuple(n for n, each in enumerate(arguments) if any(each.type is kind for kind in kinds))
        wide = arguments[-1].label == "lanes"
        found = _Found(function, wide, counts if self._device.is_cpu else (1,), positions)
        self._found[kernel] = found
        return found

    def _launch_shares(
        self, kernel: str, function: Any, shape: tuple[int, ...], inputs: list[Any], last: list[int]
    ) -> None:
        """Launch once for each thread, this one too; its share of the outermost dimension begins at ``first``."""
        shares = min(self._threads, shape[0]) if self._pool else 1

        def run(share: int) -> None:
            start, stop = shape[0] * share // shares, shape[0] * (share + 1) // shares
            part = (stop - start, *shape[1:])
            every = [*inputs, start, *last]
            self._warp.launch(self._overloads[kinds], part, every, device=self._device, block_dim=self.block)

        started = 0
        kinds = (function, *(getattr(value, "dtype", type(value)) for value in inputs))
        if kinds not in self._overloads:  # the first launch compiles, which two threads must not do at once
            self._overloads[kinds] = self._overload(function, [*inputs, 0, *last])
            self.on_build(kernel)
            run(0)
            self.on_build("")
            started = 1
        others = self._pool.map(run, range(started, shares - 1)) if self._pool else ()
        if started < shares:
            run(shares - 1)
        list(others)

    def _overload(self, function: Any, inputs: list[Any]) -> Any:
        """Find the kernel for inputs of these types, which takes Warp longer than many a launch."""
        types = [value if isinstance(value, self._warp.array) else type(value) for value in inputs]
        return self._warp.overload(function, types) if function.is_generic else function

    def _in_lanes(self, flat: Any, lanes: int) -> Any:
        """See an array as overlapping vectors, one from every element on."""
        return self._warp.array(
            ptr=flat.ptr,
            dtype=self._warp.types.vector(lanes, flat.dtype),
            shape=(flat.size,),
            strides=flat.strides,
            device=self._device,
            capacity=flat.capacity,
        )

    def _argument(self, value: Any) -> Any:
        if isinstance(value, self._warp.array):
            return value if value.ndim == 1 else value.flatten()
        if isinstance(value, float | np.floating):
            return self._real(value)
        return int(value)

    def wait(self) -> None:
        """Return when everything launched has finished."""
        self._warp.synchronize_device(self._device)


def open_device(rest: str, real: "np.dtype[Any]") -> Device:
    """``rest``: ``""`` (CUDA where there is one, else the CPU), ``"cpu"``, ``"cuda"`` or ``"cuda:N"``."""
    kind, _, number = rest.partition(":")
    if kind not in ("", "cpu", "cuda") or (number and not number.isdigit()):
        raise InputError(f"expected a Warp device like warp:cpu or warp:cuda:0, got warp:{rest}")
    if kind == "cuda" and not _cuda_driver():
        raise BackendUnavailable("no CUDA driver is installed on this machine")
    warp = _import_warp()
    count = warp.get_cuda_device_count()
    if kind == "cuda" and int(number or 0) >= count:
        raise BackendUnavailable(f"expected a CUDA device number below {count}, got {number or 0}")
    if kind == "":
        kind = "cuda" if count else "cpu"
    return WarpDevice(warp, "cpu" if kind == "cpu" else f"cuda:{number or 0}", real)


def list_devices() -> list[tuple[str, str]]:
    """Name and description of each device."""
    warp = _import_warp()
    return [(f"warp:{device.alias}", device.name) for device in warp.get_devices()]
