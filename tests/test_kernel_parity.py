"""Every kernel in twins: the same names, argument order and types in Warp and OpenCL, and a CUDA build of each."""

import importlib
import re
import shutil
import subprocess
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import warp as wp

from gpubspline.device.opencl import SIGNATURE

KERNELS = resources.files("gpubspline.kernels")
FILES = sorted(Path(entry.name).stem for entry in KERNELS.iterdir() if entry.name.endswith(".cl"))


def opencl_kernels(file: str) -> dict[str, list[tuple[str, str]]]:
    """Kernel name to (argument, type) rows, read from the text."""
    text = re.sub(r"//[^\n]*", "", (KERNELS / f"{file}.cl").read_text())
    found = {}
    for _, name, arguments in SIGNATURE.findall(text):
        rows = []
        for argument in arguments.split(","):
            words = argument.replace("*", " * ").split()
            kind = " ".join(word for word in words[:-1] if word not in ("__global", "const"))
            rows.append((words[-1], kind))
        found[name] = rows
    return found


def warp_kernels(file: str) -> dict[str, Any]:
    module = importlib.import_module(f"gpubspline.kernels.{file}")
    return {name: value for name, value in vars(module).items() if isinstance(value, wp.Kernel)}


def warp_type(kind: Any) -> str:
    if isinstance(kind, wp.array):
        return warp_type(kind.dtype) + " *"
    return {"int32": "int"}.get(getattr(kind, "__name__", ""), "real")


def test_every_file_has_a_twin() -> None:
    warp_files = {Path(entry.name).stem for entry in KERNELS.iterdir() if entry.name.endswith(".py")} - {
        "__init__",
        "lanes",
    }
    assert warp_files == set(FILES)


@pytest.mark.parametrize("file", FILES)
def test_signatures_agree(file: str) -> None:
    opencl, warp = opencl_kernels(file), warp_kernels(file)
    assert opencl.keys() == warp.keys() and opencl
    assert opencl.keys() == set(re.findall(r"\bvoid\s+(\w+)\(__global", (KERNELS / f"{file}.cl").read_text()))
    for name, rows in opencl.items():
        found = [(argument.label, warp_type(argument.type)) for argument in warp[name].adj.args]
        last = found[len(rows) :]  # filled in by the Warp device, see its launch
        assert last in ([("first", "int")], [("first", "int"), ("lanes", "int")])
        assert found[: len(rows)] == rows, name


@pytest.mark.parametrize("file", FILES)
@pytest.mark.parametrize("real", [wp.float32, wp.float64], ids=["float32", "float64"])
def test_compiles_for_hopper(file: str, real: Any, tmp_path: Path) -> None:
    """A cubin for sm_90 on a machine without a GPU, and no register spilled where cuobjdump can tell."""
    for name, kernel in warp_kernels(file).items():
        types = [
            wp.array(dtype=real) if warp_type(a.type) == "real *" else real if warp_type(a.type) == "real" else a.type
            for a in kernel.adj.args
        ]
        overload = wp.overload(kernel, types)
        wp.compile_aot_module(overload.module, device=None, arch=[90], module_dir=tmp_path / name, use_ptx=False)
        cubins = list((tmp_path / name).glob("*.cubin"))
        assert len(cubins) == 1 and cubins[0].stat().st_size > 1000, name
        if shutil.which("cuobjdump"):
            usage = subprocess.run(["cuobjdump", "-res-usage", cubins[0]], capture_output=True, text=True, check=True)
            assert re.search(r"REG:\d+", usage.stdout + usage.stderr)
            assert not np.any([int(n) for n in re.findall(r"LOCAL:(\d+)", usage.stdout + usage.stderr)]), name
