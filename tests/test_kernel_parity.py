"""Every kernel in twins: the same names, argument order and types in Warp and OpenCL, and a CUDA build of each."""

import importlib
import re
import shutil
import subprocess
from importlib import resources
from pathlib import Path
from typing import Any

import pytest
import warp as wp

from gpubspline.device.opencl import SIGNATURE
from gpubspline.kernels.lanes import LaneArray

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


def overloaded(kernel: Any, real: Any) -> Any:
    """The kernel with all floating-point arguments of one type."""
    types = {"real *": wp.array(dtype=real), "real": real, "int": wp.int32, "int *": wp.array(dtype=wp.int32)}
    one_lane = wp.array(dtype=wp.types.vector(1, real))  # as on a GPU
    kinds = [argument.type for argument in kernel.adj.args]
    return wp.overload(kernel, [one_lane if kind is LaneArray else types[warp_type(kind)] for kind in kinds])


@pytest.mark.parametrize("file", FILES)
@pytest.mark.parametrize("real", [wp.float32, wp.float64], ids=["float32", "float64"])
def test_compiles_for_hopper(file: str, real: Any, tmp_path: Path) -> None:
    """A cubin for sm_90 on a machine without a GPU."""
    for name, kernel in warp_kernels(file).items():
        module = overloaded(kernel, real).module
        wp.compile_aot_module(module, device=None, arch=[90], module_dir=tmp_path / name, use_ptx=False)
        cubins = list((tmp_path / name).glob("*.cubin"))
        assert len(cubins) == 1 and cubins[0].stat().st_size > 1000, name


@pytest.mark.parametrize("file", FILES)
def test_no_register_spills_on_hopper(file: str, tmp_path: Path) -> None:
    """The report of ptxas, NVIDIA's assembler, where it is on the path and knows the PTX that Warp writes."""
    ptxas = shutil.which("ptxas")
    if ptxas is None:
        pytest.skip("no ptxas on the path")
    for name, kernel in warp_kernels(file).items():
        module = overloaded(kernel, wp.float32).module
        wp.compile_aot_module(module, device=None, arch=[90], module_dir=tmp_path / name, use_ptx=True)
        (ptx,) = (tmp_path / name).glob("*.ptx")
        ptx.write_bytes(ptx.read_bytes().rstrip(b"\0"))
        command = [ptxas, "-v", "-arch=sm_90", str(ptx), "-o", str(tmp_path / "out")]
        report = subprocess.run(command, capture_output=True, text=True, check=False).stderr
        if "Unsupported .version" in report:
            pytest.skip("the ptxas on the path is older than the PTX")
        spills = re.findall(r"(\d+) bytes spill stores, (\d+) bytes spill loads", report)
        assert spills and set(spills) == {("0", "0")}, report
