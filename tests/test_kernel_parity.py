"""Every kernel in twins: the same names, argument order and types in Warp and OpenCL, and a CUDA build of each."""

import importlib
import re
import shutil
import subprocess
import sys
from importlib import resources
from pathlib import Path
from typing import Any

import pytest
import warp as wp

from gpubspline.device.opencl import SIGNATURE
from gpubspline.kernels.lanes import IntLaneArray

KERNELS = resources.files("gpubspline.kernels")
FILES = sorted(Path(entry.name).stem for entry in KERNELS.iterdir() if entry.name.endswith(".cl"))
SHARED = {Path(entry.name).stem for entry in KERNELS.iterdir() if entry.name.endswith(".h")}


def opencl_kernels(file: str) -> dict[str, list[tuple[str, str]]]:
    """Kernel name to (argument, type) rows, read from the text."""
    text = re.sub(r"//[^\n]*", "", (KERNELS / f"{file}.cl").read_text())
    found = {}
    for _, name, arguments in SIGNATURE.findall(text):
        rows = []
        for argument in arguments.split(","):
            words = argument.replace("*", " * ").split()
            kind = " ".join(word for word in words[:-1] if word not in ("__global", "const", "restrict"))
            rows.append((words[-1], kind))
        found[name] = rows
    return found


def warp_kernels(file: str) -> dict[str, Any]:
    module = importlib.import_module(f"gpubspline.kernels.{file}")
    return {name: value for name, value in vars(module).items() if isinstance(value, wp.Kernel)}


def warp_type(kind: Any) -> str:
    if kind is IntLaneArray:
        return "int *"
    if isinstance(kind, wp.array):
        return warp_type(kind.dtype) + " *"
    return {"int32": "int"}.get(getattr(kind, "__name__", ""), "real")


def test_every_file_has_a_twin() -> None:
    warp_files = {Path(entry.name).stem for entry in KERNELS.iterdir() if entry.name.endswith(".py")}
    assert warp_files == {"__init__", *SHARED, *FILES}


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


def compiled(file: str, real: str, ending: str, folder: Path) -> dict[str, Path]:
    """What Warp makes of each kernel of a file for sm_90."""
    program = Path(__file__).with_name("compile_for_hopper.py")
    done = subprocess.run(
        [sys.executable, program, file, real, ending, folder], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    found = {name: list((folder / name).glob(f"*.{ending}")) for name in warp_kernels(file)}
    assert found and all(len(paths) == 1 for paths in found.values()), found
    return {name: path for name, (path,) in found.items()}


@pytest.mark.parametrize("file", FILES)
@pytest.mark.parametrize("real", ["float32", "float64"])
def test_compiles_for_hopper(file: str, real: str, tmp_path: Path) -> None:
    """A cubin for sm_90 on a machine without a GPU."""
    assert all(path.stat().st_size > 1000 for path in compiled(file, real, "cubin", tmp_path).values())


@pytest.mark.parametrize("file", FILES)
def test_no_register_spills_on_hopper(file: str, tmp_path: Path) -> None:
    """The report of ptxas, NVIDIA's assembler, where it is on the path and knows the PTX that Warp writes."""
    ptxas = shutil.which("ptxas")
    if ptxas is None:
        pytest.skip("no ptxas on the path")
    for ptx in compiled(file, "float32", "ptx", tmp_path).values():
        ptx.write_bytes(ptx.read_bytes().rstrip(b"\0"))
        command = [ptxas, "-v", "-arch=sm_90", str(ptx), "-o", str(tmp_path / "out")]
        report = subprocess.run(command, capture_output=True, text=True, check=False).stderr
        if "Unsupported .version" in report:
            pytest.skip("the ptxas on the path is older than the PTX")
        spills = re.findall(r"(\d+) bytes spill stores, (\d+) bytes spill loads", report)
        assert spills and set(spills) == {("0", "0")}, report
