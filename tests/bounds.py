"""Warp's kernels with every index checked: ``PYTHONPATH=tests python -m pytest -p bounds -k "warp or device" ...``.

A plug-in of pytest that builds kernels with Warp's assertions: an index out of bounds ends the process and says where.
With ``AS_GPU=1`` as the plug-in ``as_gpu`` drives them.
"""

import importlib
import os
import tempfile

import warp

warp.config.mode = "debug"
# a pointer that all threads share, which such a build follows: launches beside each other crash in it
warp.config.enable_tiles_in_stack_memory = False
warp.config.kernel_cache_dir = os.path.join(tempfile.gettempdir(), "gpubspline-bounds")

if os.environ.get("AS_GPU"):
    importlib.import_module("as_gpu")
