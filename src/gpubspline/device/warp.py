"""The Warp backend: CUDA devices, and the CPU through Warp's own compiler."""

import ctypes.util
import importlib
import os
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from math import prod
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.device import Device, Named, buffer_type, find_kernel, quietly
from gpubspline.device.pages import ask_for_large_pages
from gpubspline.errors import BackendUnavailable, InputError


def _import_warp() -> Any:
    try:
        import warp
    except ImportError as error:
        raise BackendUnavailable(f"Warp does not import ({error}); install it: pip install warp-lang") from None
    warp.config.log_level = warp.LOG_ERROR
    try:
        with nullcontext() if _cuda_driver() else _native_errors_hidden():
            warp.init()
    except OSError as error:  # no home, a full or a read-only one
        raise BackendUnavailable(
            f"Warp cannot keep what it compiles in {error.filename}: {error.strerror} (WARP_CACHE_PATH names another "
            "folder)"
        ) from None
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
_BUILDING = Lock()  # which all devices share, as Warp's modules: two threads that compile at once break them


@dataclass(frozen=True, eq=False)
class WarpBuffer:
    """Device memory with the shape it was made with; kernels see it flat.

    Attributes
    ----------
    flat: the Warp array.
    packed: what a kernel is passed of it.
    """

    flat: Any
    shape: tuple[int, ...]
    dtype: "np.dtype[Any]"
    packed: Any

    @property
    def size(self) -> int:
        """Elements, padding left out."""
        return int(self.flat.size)


@dataclass(frozen=True)
class _Found:
    """A kernel, whether it takes ``lanes``, and how many a row may be cut into."""

    function: Any
    wide: bool
    counts: tuple[int, ...]


@dataclass(frozen=True)
class _Commands:
    """A kernel for arguments of some types, and launches of it that wait to be used again.

    To set the arguments of one takes a fifth of the time that Warp needs to check and pack those of a new one.
    """

    function: Any
    idle: list[Any]


class WarpDevice(Named):
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
        self._commands: dict[Any, _Commands] = {}
        self._lanes = CPU_LANES if self._device.is_cpu else (1,)
        self._padding = CPU_LANES[0] if self._device.is_cpu else 0
        self.block = 1 if self._device.is_cpu else GPU_BLOCK
        self._pool = ThreadPoolExecutor(self._threads) if self._device.is_cpu else None
        self.cores = self._threads if self._device.is_cpu else 0

    def put(self, array: Any) -> WarpBuffer:
        """Upload, the last index fastest; what is on a Warp device already stays there."""
        if isinstance(array, WarpBuffer):
            return array
        if isinstance(array, self._warp.array):
            return self._buffer(array.flatten(), array.shape, self._warp.dtype_to_numpy(array.dtype))
        values = np.asarray(array)
        dtype = buffer_type(values, self.real)
        buffer = self.empty(values.size, dtype)
        if self._device.is_cpu:
            buffer.flat.numpy().reshape(values.shape)[...] = values
        elif values.size:
            buffer.flat.assign(np.ascontiguousarray(values, dtype=dtype).reshape(-1))
        return buffer

    def empty(self, shape: int | tuple[int, ...], dtype: Any = None) -> WarpBuffer:
        """Reserve a buffer, on a CPU padded by the lanes that a kernel may read past its end."""
        shape = (shape,) if isinstance(shape, int) else tuple(map(int, shape))
        kind = np.dtype(self.real if dtype is None else dtype)
        size = prod(shape)
        padded = size + self._padding if size else 0
        try:
            whole = self._warp.empty(padded, dtype=self._warp.dtype_from_numpy(kind), device=self._device)
        except (RuntimeError, ValueError) as error:
            raise MemoryError(f"{self.label} has no room for {padded * kind.itemsize:,} bytes: {error}") from None
        if self._device.is_cpu:
            ask_for_large_pages(whole.ptr or 0, padded * kind.itemsize)
        return self._buffer(whole if padded == size else whole[:size], shape, kind)

    def _buffer(self, flat: Any, shape: tuple[int, ...], dtype: "np.dtype[Any]") -> WarpBuffer:
        return WarpBuffer(flat, shape, dtype, flat.__ctype__())

    def get(self, buffer: WarpBuffer) -> NDArray[Any]:
        """Download; on a CPU the array is the buffer's own memory."""
        return np.asarray(buffer.flat.numpy()).reshape(buffer.shape)

    def copy(self, source: WarpBuffer, target: WarpBuffer) -> None:
        """Copy a buffer to one of the same shape and type."""
        self._warp.copy(target.flat, source.flat)

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
        kinds = (kernel, lanes, *(getattr(value, "dtype", type(value)) for value in args))
        values = [value.packed if isinstance(value, WarpBuffer) else value for value in args]
        commands = self._commands.get(kinds)
        if commands is None:
            with _BUILDING:
                commands = self._commands.get(kinds) or self._build(found, kinds, args, shape, [*values, 0, *last])
        self._launch_shares(commands, shape, values, last)

    def _build(
        self, found: _Found, kinds: tuple[Any, ...], args: tuple[Any, ...], shape: tuple[int, ...], values: list[Any]
    ) -> _Commands:
        """Make the first launch of a kernel for arguments of some types, which compiles it."""
        kernel, lanes = kinds[:2]
        self.on_build(kernel)
        commands = _Commands(self._overload(found.function, lanes, args), [])
        commands.idle.append(self._command(commands.function, shape, values))
        self.on_build("")
        self._commands[kinds] = commands
        return commands

    def _find(self, kernel: str) -> _Found:
        """Look a kernel up, once; by ``REGISTER`` a module of kernels wants vectors of so many bytes on a CPU."""
        module, name = find_kernel(kernel)
        home = importlib.import_module(module)
        function, register = getattr(home, name), getattr(home, "REGISTER", None)
        counts = (register // self.real.itemsize, 8, 1) if register else self._lanes
        wide = function.adj.args[-1].label == "lanes"
        found = _Found(function, wide, counts if len(self._lanes) > 1 else (1,))
        self._found[kernel] = found
        return found

    def _overload(self, function: Any, lanes: int, args: tuple[Any, ...]) -> Any:
        """Find the kernel for arguments of these types; lane arrays hold vectors, one from every element on."""
        if not function.is_generic:
            return function
        in_lanes = importlib.import_module("gpubspline.kernels.lanes")
        types = [int] * len(function.adj.args)
        for position, value in enumerate(args):
            if isinstance(value, WarpBuffer):
                element, asked = value.flat.dtype, function.adj.args[position].type
                if asked is in_lanes.LaneArray or asked is in_lanes.IntLaneArray:
                    element = self._warp.types.vector(lanes, element)
                types[position] = self._warp.array(dtype=element)
            elif isinstance(value, float | np.floating):
                types[position] = self._real
        return self._warp.overload(function, types)

    def _command(self, function: Any, shape: tuple[int, ...], values: list[Any]) -> Any:
        return self._warp.launch(function, shape, values, device=self._device, block_dim=self.block, record_cmd=True)

    def _launch_shares(self, commands: _Commands, shape: tuple[int, ...], values: list[Any], last: list[int]) -> None:
        """Launch once for each thread, this one too; its share of the outermost dimension begins at ``first``."""
        shares = min(self._threads, shape[0]) if self._pool else 1

        def run(share: int) -> None:
            start, stop = shape[0] * share // shares, shape[0] * (share + 1) // shares
            part, every = (stop - start, *shape[1:]), [*values, start, *last]
            try:
                command = commands.idle.pop()
            except IndexError:  # in use by other threads
                command = self._command(commands.function, part, every)
            else:
                command.set_dim(part)
                command.set_params_from_ctypes(every)
            command.launch()
            commands.idle.append(command)

        others = self._pool.map(run, range(shares - 1)) if self._pool else ()
        run(shares - 1)
        list(others)

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
