"""OpenCL's kernels for GPUs as NVIDIA's assembler sees them, on a machine without a GPU.

NVIDIA's own compiler of OpenCL C comes with its driver; clang stands in for it, which has the same ancestors.
"""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from gpubspline.device.opencl import source, with_headers

BUILT_INS = Path("/usr/lib/clc/nvptx64--nvidiacl.bc")
FILES = ("columns", "patch", "quality", "quality_columns", "resample", "material")
CLANG = (
    "clang-14 -x cl -cl-std=CL1.2 -target nvptx64-unknown-nvcl -O3 -w -S -Xclang -finclude-default-header "
    "-Xclang -mlink-builtin-bitcode -Xclang FROM -Xclang -target-cpu -Xclang sm_75 "
    "-Xclang -target-feature -Xclang +ptx63 -D__NV_CL_C_VERSION=120 -Dasm=__asm__ -DFUSED -cl-mad-enable -DLANES=1"
)
FLOAT32 = "-Dreal=float -DREAL_BYTES=4 -cl-single-precision-constant"
FLOAT64 = "-Dreal=double -DREAL_BYTES=8 -Dcl_khr_fp64"


def assembled(file: str, real: str, folder: Path) -> tuple[str, str]:
    """PTX, and what ptxas says of its registers."""
    if not shutil.which("ptxas") or not shutil.which("clang-14") or not BUILT_INS.exists():
        pytest.skip("no ptxas, clang-14 or libclc-14")
    text, ptx = folder / f"{file}.cl", folder / f"{file}.ptx"
    text.write_text(with_headers(source(file)))
    command = [*CLANG.replace("FROM", str(BUILT_INS)).split(), *real.split(), "-o", ptx, text]
    subprocess.run(command, check=True, capture_output=True, text=True)
    done = subprocess.run(
        ["ptxas", "-v", "-arch=sm_90", ptx, "-o", folder / "out"], check=True, capture_output=True, text=True
    )
    return ptx.read_text(), done.stderr


@pytest.mark.parametrize("file", FILES)
def test_no_register_spills(file: str, tmp_path: Path) -> None:
    _, report = assembled(file, FLOAT32, tmp_path)
    spills = re.findall(r"(\d+) bytes stack frame, (\d+) bytes spill stores, (\d+) bytes spill loads", report)
    assert spills and set(spills) == {("0", "0", "0")}, report


def test_columns_leave_room_for_as_many_threads_as_warps(tmp_path: Path) -> None:
    """Of 65,536 registers a multiprocessor, which is why a work item goes along with so few places."""
    _, report = assembled("columns", FLOAT32, tmp_path)
    _, other = assembled("quality_columns", FLOAT32, tmp_path)
    registers = [int(count) for count in re.findall(r"Used (\d+) registers", report + other)]
    assert [65536 // count // 128 * 128 >= 640 for count in registers] == [True, True], registers


def test_nvidia_writes_past_the_caches_and_fuses(tmp_path: Path) -> None:
    ptx, _ = assembled("columns", FLOAT32, tmp_path)
    assert ptx.count("st.global.cs.f32") == 20 and "st.global.f32" not in ptx  # four places for each of five degrees
    assert ptx.count("fma.rn.f32") > 100 and ptx.count("add.rn.f32") == 20  # what the middle is added to
    assert "rsqrt.approx.ftz.f32" in assembled("quality_columns", FLOAT32, tmp_path)[0]


def test_float64_compiles(tmp_path: Path) -> None:
    assert "st.global.f64" in assembled("columns", FLOAT64, tmp_path)[0]
