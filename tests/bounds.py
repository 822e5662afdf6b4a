"""Warp's kernels with every index checked: ``PYTHONPATH=tests python -m pytest -p bounds -k "warp or device" ...``.

A plug-in of pytest that builds kernels with Warp's assertions: an index out of bounds ends the process and says where.
With ``AS_GPU=1`` the CPU is used as a GPU is, without lanes, without padding and by the code for GPUs.
"""

import os
import tempfile
from dataclasses import replace
from typing import Any

import numpy as np
import warp

from gpubspline.device import warp as backend

warp.config.mode = "debug"
# a pointer that all threads share, which such a build follows: launches beside each other crash in it
warp.config.enable_tiles_in_stack_memory = False
warp.config.kernel_cache_dir = os.path.join(tempfile.gettempdir(), "gpubspline-bounds")


def _as_gpu(device: Any) -> None:
    make, find = device.__init__, device._find

    def made(self: Any, *args: Any) -> None:
        make(self, *args)
        self.cores = 0

    def unpadded(self: Any, shape: int | tuple[int, ...], dtype: Any = None) -> Any:
        kind = self._warp.dtype_from_numpy(np.dtype(self.real if dtype is None else dtype))
        return self._warp.empty(int(np.prod(shape, dtype=np.int64)), dtype=kind, device=self._device).reshape(shape)

    def by_one(self: Any, kernel: str) -> Any:
        self._found[kernel] = replace(find(self, kernel), counts=(1,))
        return self._found[kernel]

    device.__init__, device.empty, device._find = made, unpadded, by_one


if os.environ.get("AS_GPU"):
    _as_gpu(backend.WarpDevice)
