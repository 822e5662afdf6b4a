"""Both backends driven as a GPU is, on the CPU: ``PYTHONPATH=tests python -m pytest -p as_gpu -k "device" ...``.

A plug-in of pytest. Kernels run without lanes or padding and by the code for GPUs; OpenCL's in groups with idle work
items, their buffers copied instead of mapped. Behind each buffer of OpenCL lies a guard: what a kernel writes there is
found after its launch. Warp's kernels are checked so by the plug-in ``bounds``.
"""

from dataclasses import replace
from typing import Any

import numpy as np
import pyopencl

from gpubspline.device.opencl import OpenCLBuffer, OpenCLDevice
from gpubspline.device.warp import WarpDevice

GUARD = 4096
"""Numbers behind a buffer."""
UNTOUCHED = {"f": np.nan, "i": -1431655766}
"""What they are, as in ``conftest``, which fills whole buffers with it."""


def _drive_as_gpu(device: Any, **attributes: Any) -> None:
    make = device.__init__

    def made(self: Any, *args: Any) -> None:
        make(self, *args)
        self.__dict__.update(cores=0, **attributes)

    device.__init__ = made


def _guard_buffers(device: Any) -> None:
    reserve, start = device.empty, device.launch

    def empty(self: Any, shape: int | tuple[int, ...], dtype: Any = None) -> OpenCLBuffer:
        shape = (shape,) if isinstance(shape, int) else tuple(map(int, shape))
        buffer = reserve(self, int(np.prod(shape, dtype=np.int64)) + GUARD, dtype)
        value = np.array(UNTOUCHED[buffer.dtype.kind], buffer.dtype)
        pyopencl.enqueue_fill_buffer(self._queue, buffer.memory, value, 0, buffer.memory.size)
        return replace(buffer, shape=shape)

    def launch(self: Any, kernel: str, dim: int | tuple[int, ...], *args: Any) -> None:
        start(self, kernel, dim, *args)
        for number, buffer in enumerate(args):
            if isinstance(buffer, OpenCLBuffer):
                behind = np.empty(GUARD, buffer.dtype)
                offset = buffer.size * buffer.dtype.itemsize
                pyopencl.enqueue_copy(self._queue, behind, buffer.memory, src_offset=offset)
                written = np.flatnonzero(behind == behind if buffer.dtype.kind == "f" else behind != UNTOUCHED["i"])
                assert not written.size, f"{kernel} writes {written[:4]} behind argument {number} of {buffer.shape}"

    device.empty, device.launch = empty, launch


_drive_as_gpu(WarpDevice, _lanes=(1,), _padding=0)
_drive_as_gpu(OpenCLDevice, _is_cpu=False, _lanes=1, _wide_lanes=1)
_guard_buffers(OpenCLDevice)
