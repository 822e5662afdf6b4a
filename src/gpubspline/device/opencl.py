"""The OpenCL backend: GPUs, and CPUs through PoCL."""

import math
import re
import weakref
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from importlib import resources
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.device import KERNELS, Device, Named, buffer_type, find_kernel, quietly
from gpubspline.device.pages import LARGE_BYTES, ask_for_large_pages
from gpubspline.device.pocl import check_room, has_wide_vectors, name_processor, no_folder
from gpubspline.errors import BackendUnavailable

CPU_LANES = 8  # 16 crashes the compiler of PoCL 3.0 in some files
WIDE_LANES = 16  # in files that say so: as many floats as a vector of AVX-512 holds
WIDE = "// WIDE\n"
CPU_RUN = 128  # vectors of the fastest dimension that a work item takes on a CPU
GPU_GROUP = 256  # work items of a GPU that share a cache
GPU_ROW = 32  # that go along together, whether or not there is work for all of them
INCLUDE = re.compile(r'^#include "(\w+)\.h"$', re.MULTILINE)  # of gpubspline.kernels, wherever that is installed
SIGNATURE = re.compile(r"__kernel\s+(__attribute__\(\(vec_type_hint\(realv\)\)\)\s+)?void\s+(\w+)\s*\(([^)]*)\)")


def _import_opencl() -> Any:
    try:
        import pyopencl
    except ImportError as error:
        raise BackendUnavailable(
            f"PyOpenCL does not import ({error}); install it: pip install pyopencl[pocl]"
        ) from None
    return pyopencl


@dataclass(eq=False)
class OpenCLBuffer:
    """Device memory with the shape and type it was made with, and as the host of a CPU sees it once it has asked."""

    memory: Any
    shape: tuple[int, ...]
    dtype: "np.dtype[Any]"
    mapped: NDArray[Any] | None = None

    @property
    def size(self) -> int:
        """Elements, padding left out."""
        return math.prod(self.shape)


@dataclass(frozen=True)
class _Found:
    """A kernel, the lanes that it is written in, else 0, the group it asks for, and the most work items of one."""

    function: Any
    lanes: int
    group: tuple[int, ...] | None
    most: int


class OpenCLDevice(Named):
    """One OpenCL device. On a CPU, buffers are mapped into host memory and nothing is copied on the way back."""

    backend = "opencl"

    def __init__(self, opencl: Any, device: Any, name: str, real: "np.dtype[Any]") -> None:
        if real == np.float64 and not device.double_fp_config:
            raise BackendUnavailable(f"expected a device with float64, got {device.name}, which has none")
        self._opencl = opencl
        self.name = name
        self.label = device.name.strip()
        self.real = real
        self.on_build: Callable[[str], None] = quietly
        self._is_cpu = bool(device.type & opencl.device_type.CPU)
        self._lanes = CPU_LANES if self._is_cpu else 1
        self._wide_lanes = WIDE_LANES if self._is_cpu and real == np.float32 and has_wide_vectors() else self._lanes
        self._fused = [] if self._is_cpu else ["-DFUSED", "-cl-mad-enable"]
        self.cores = device.max_compute_units if self._is_cpu else 0
        self._most_bytes = device.global_mem_size
        self._is_pocl = self._is_cpu and device.platform.name == "Portable Computing Language"
        if self._is_pocl:
            name_processor(device)
        self._context = opencl.Context([device])
        self._queue = opencl.CommandQueue(self._context)
        # a process that ends, interrupted perhaps, while PoCL's threads still run a kernel crashes in them
        weakref.finalize(self, self._queue.finish)
        self._kernels: dict[str, _Found] = {}
        self._one_at_a_time = Lock()

    def put(self, array: Any) -> OpenCLBuffer:
        """Upload, the last index fastest; what is on an OpenCL device already comes back as it is."""
        if isinstance(array, OpenCLBuffer):
            return array
        values = np.asarray(array)
        buffer = self.empty(values.size, buffer_type(values, self.real))
        if self._is_cpu:
            self._map(buffer).reshape(values.shape)[...] = values
        elif values.size:
            self._enqueue(self._opencl.enqueue_copy, buffer.memory, np.ascontiguousarray(values, dtype=buffer.dtype))
        return buffer

    def empty(self, shape: int | tuple[int, ...], dtype: Any = None) -> OpenCLBuffer:
        """Reserve a buffer, padded by the lanes that a kernel may read past its end."""
        shape = (shape,) if isinstance(shape, int) else tuple(int(n) for n in shape)
        kind = np.dtype(self.real if dtype is None else dtype)
        padded = math.prod(shape) + self._wide_lanes
        flags = self._opencl.mem_flags.READ_WRITE
        if self._is_cpu:
            flags |= self._opencl.mem_flags.ALLOC_HOST_PTR
        if padded * kind.itemsize > self._most_bytes:  # which a GPU's driver only finds out when the buffer is used
            raise MemoryError(f"{self.label} has no room for {padded * kind.itemsize:,} bytes")
        try:
            memory = self._opencl.Buffer(self._context, flags, padded * kind.itemsize)
        except (self._opencl.MemoryError, self._opencl.LogicError) as error:
            raise MemoryError(f"{self.label} has no room for {padded * kind.itemsize:,} bytes: {error}") from None
        buffer = OpenCLBuffer(memory, shape, kind)
        if self._is_cpu and padded * kind.itemsize >= LARGE_BYTES:
            ask_for_large_pages(self._map(buffer).ctypes.data, padded * kind.itemsize)
        return buffer

    def get(self, buffer: OpenCLBuffer) -> NDArray[Any]:
        """Download; on a CPU the array is the buffer's own memory."""
        self.wait()
        if self._is_cpu:
            return self._map(buffer).reshape(buffer.shape)
        values = np.empty(buffer.shape, buffer.dtype)
        if values.size:
            self._enqueue(self._opencl.enqueue_copy, values, buffer.memory)
        return values

    def copy(self, source: OpenCLBuffer, target: OpenCLBuffer) -> None:
        """Copy a buffer to one of the same shape and type."""
        count = source.size * source.dtype.itemsize
        self._enqueue(partial(self._opencl.enqueue_copy, byte_count=count), target.memory, source.memory)

    def _map(self, buffer: OpenCLBuffer) -> NDArray[Any]:
        """Map a buffer for as long as it lives: each time anew takes as long as a kernel."""
        if not buffer.size:
            return np.empty(0, buffer.dtype)
        if buffer.mapped is None:
            flags, span = self._opencl.map_flags, (0, (buffer.size,), buffer.dtype)
            both = flags.READ | flags.WRITE
            buffer.mapped = self._opencl.enqueue_map_buffer(self._queue, buffer.memory, both, *span)[0]
        return np.asarray(buffer.mapped)

    def launch(self, kernel: str, dim: int | tuple[int, ...], *args: Any) -> None:
        """Run a kernel; OpenCL counts dimensions from the fastest."""
        found = self._kernels.get(kernel) or self._find(kernel)
        shape = [dim] if isinstance(dim, int) else [int(n) for n in reversed(dim)]
        if 0 in shape:
            return
        if found.lanes and self._is_cpu:
            shape[0] = -(-shape[0] // (found.lanes * CPU_RUN))
        group = found.group and found.group[: len(shape)]
        if not self._is_cpu:
            group = group or (min(found.most, -(-shape[0] // GPU_ROW) * GPU_ROW), *[1] * (len(shape) - 1))
            shape[0] = -(-shape[0] // group[0]) * group[0]
        inputs = (value.memory if isinstance(value, OpenCLBuffer) else value for value in args)
        with self._one_at_a_time:  # a kernel keeps its arguments, which another thread would change before it starts
            self._enqueue(found.function, tuple(shape), group, *inputs)

    def _enqueue(self, command: Callable[..., Any], *args: Any) -> None:
        """Send what makes a GPU's driver find the memory of buffers that were reserved before."""
        try:
            command(self._queue, *args)
        except self._opencl.MemoryError as error:
            raise MemoryError(f"{self.label} has no room for the buffers in use: {error}") from None

    def _find(self, kernel: str) -> _Found:
        """Build the program of a kernel, once, with all kernels that are in it."""
        prefix, (module, _) = kernel.rpartition(".")[0], find_kernel(kernel)
        package, _, file = module.rpartition(".")
        text = source(file, package=package)
        lanes = self._wide_lanes if text.startswith(WIDE) else self._lanes
        if self._is_pocl:
            check_room()
        self.on_build(kernel)
        program = self._opencl.Program(self._context, with_headers(text)).build(options=self._options(lanes))
        self.on_build("")
        for hint, name, arguments in SIGNATURE.findall(text):
            function = self._opencl.Kernel(program, name)
            function.set_arg_types([self._kind(argument) for argument in arguments.split(",")])
            self._kernels[f"{prefix}.{name}"] = _Found(function, lanes if hint else 0, *self._groups(function))
        return self._kernels[kernel]

    def _kind(self, argument: str) -> Any:
        """Type of a number, None of a buffer: untold, PyOpenCL finds out at each launch, which takes it 60 us."""
        return None if "*" in argument else np.int32 if argument.split()[-2] == "int" else self.real

    def _groups(self, function: Any) -> tuple[tuple[int, ...] | None, int]:
        """Work items a group: what the kernel asks for, which PoCL 3.0 wants to be told, and the most of a GPU."""
        info, device = self._opencl.kernel_work_group_info, self._context.devices[0]
        asked = tuple(function.get_work_group_info(info.COMPILE_WORK_GROUP_SIZE, device))
        most = min(GPU_GROUP, function.get_work_group_info(info.WORK_GROUP_SIZE, device))
        return asked if all(asked) else None, most

    def _options(self, lanes: int) -> list[str]:
        type_name = "double" if self.real == np.float64 else "float"
        single = [] if self.real == np.float64 else ["-cl-single-precision-constant"]
        return [f"-Dreal={type_name}", f"-DREAL_BYTES={self.real.itemsize}", f"-DLANES={lanes}", *single, *self._fused]

    def wait(self) -> None:
        """Return when everything launched has finished."""
        self._queue.finish()


@cache
def source(file: str, ending: str = "cl", package: str = KERNELS) -> str:
    """Text of a file of kernels."""
    return (resources.files(package) / f"{file}.{ending}").read_text()


def with_headers(text: str) -> str:
    """Put what all kernels have, and what they include, into their text, which compilers get without a file."""
    return source("lanes", "h") + INCLUDE.sub(lambda found: source(found[1], "h"), text)


def _devices() -> list[tuple[str, Any]]:
    opencl = _import_opencl()
    try:
        platforms = opencl.get_platforms()
    except opencl.LogicError:
        platforms = []
    found = [
        (f"opencl:{p}:{d}", device)
        for p, platform in enumerate(platforms)
        for d, device in enumerate(platform.get_devices())
    ]
    if not found:
        raise BackendUnavailable(
            f"no OpenCL device is present; {no_folder() or 'install the CPU one: pip install pyopencl[pocl]'}"
        )
    return found


def open_device(rest: str, real: "np.dtype[Any]") -> Device:
    """``rest``: ``""`` (a GPU where there is one, else the first device) or ``"PLATFORM:DEVICE"``."""
    found = _devices()
    opencl = _import_opencl()
    if not rest:
        found.sort(key=lambda row: not row[1].type & opencl.device_type.GPU)
        name, device = found[0]
        return OpenCLDevice(opencl, device, name, real)
    wanted = f"opencl:{rest}" + (":0" if rest.isdigit() else "")
    for name, device in found:
        if name == wanted:
            return OpenCLDevice(opencl, device, name, real)
    raise BackendUnavailable(f"expected one of {', '.join(name for name, _ in found)}, got opencl:{rest}")


def list_devices() -> list[tuple[str, str]]:
    """Name and description of each device."""
    return [(name, f"{device.platform.name}: {device.name.strip()}") for name, device in _devices()]
