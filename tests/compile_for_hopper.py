"""Compile the Warp kernels of a file for sm_90 into a folder: FILE float32|float64 ptx|cubin FOLDER.

A program of its own, since Warp compiles along what a process has instantiated before, such as lanes for its CPU.
"""

import importlib
import sys
from pathlib import Path
from typing import Any

import warp as wp

from gpubspline.kernels.lanes import IntLaneArray, LaneArray


def kind(argument: Any, real: Any) -> Any:
    """Type of an argument on a GPU, where a lane array holds single lanes."""
    if argument is LaneArray:
        return wp.array(dtype=wp.types.vector(1, real))
    if argument is IntLaneArray:
        return wp.array(dtype=wp.types.vector(1, wp.int32))
    if isinstance(argument, wp.array):
        return wp.array(dtype=real) if argument.dtype is Any else argument
    return real if argument is Any else argument


def compile_file(file: str, real: Any, use_ptx: bool, folder: Path) -> None:
    """Compile every kernel into ``folder / KERNEL``."""
    module = importlib.import_module(f"gpubspline.kernels.{file}")
    for name, kernel in vars(module).items():
        if isinstance(kernel, wp.Kernel):
            overload = wp.overload(kernel, [kind(argument.type, real) for argument in kernel.adj.args])
            options = {"device": None, "arch": [90], "module_dir": folder / name, "use_ptx": use_ptx}
            wp.compile_aot_module(overload.module, **options)


if __name__ == "__main__":
    compile_file(sys.argv[1], getattr(wp, sys.argv[2]), sys.argv[3] == "ptx", Path(sys.argv[4]))
