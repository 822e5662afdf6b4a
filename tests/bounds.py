"""Warp's kernels with every index checked: ``PYTHONPATH=tests python -m pytest -p bounds -k "warp or device" ...``.

A plug-in of pytest that builds kernels with Warp's assertions: an index out of bounds ends the process and says where.
With ``AS_GPU=1`` the CPU is used as a GPU is, without lanes, without padding and by the code for GPUs.
"""

import os
import tempfile
from typing import Any

import warp

from gpubspline.device import warp as backend

warp.config.mode = "debug"
# a pointer that all threads share, which such a build follows: launches beside each other crash in it
warp.config.enable_tiles_in_stack_memory = False
warp.config.kernel_cache_dir = os.path.join(tempfile.gettempdir(), "gpubspline-bounds")


def _as_gpu(device: Any) -> None:
    make = device.__init__

    def made(self: Any, *args: Any) -> None:
        make(self, *args)
        self.cores, self._lanes, self._padding = 0, (1,), 0

    device.__init__ = made


if os.environ.get("AS_GPU"):
    _as_gpu(backend.WarpDevice)
