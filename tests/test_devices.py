"""Devices: names, errors, and one mesh from both backends."""

import gc
import importlib
import os
import re
import subprocess
import sys
from collections.abc import Callable
from copy import copy
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from gpubspline.clock import Clock
from gpubspline.ct.region import Region
from gpubspline.device import BACKENDS, Device, _open, list_devices, open_device
from gpubspline.device.vectors import inner_product
from gpubspline.errors import BackendUnavailable, InputError
from gpubspline.material.mapping import apply_material, law_on_device
from gpubspline.material.registry import law
from gpubspline.mesh.distance import distances
from gpubspline.mesh.quality import assess, scaled_jacobian
from gpubspline.mesh.sample import sample
from gpubspline.pipeline import fit_patch, sample_patch
from gpubspline.recipe import Sampling, Shaping, Source
from gpubspline.spline.hyperpatch import hyperpatch

AFFINE = np.diag([100.0, 100.0, 100.0, 1.0])


@pytest.mark.parametrize("slice_index", [None, 6, 24])
def test_both_backends_give_the_same_mesh(
    data: Path, both_devices: tuple[Device, Device], slice_index: int | None
) -> None:
    source = Source(data / "head" / "ct_example.nii.gz", threshold_hu=-200, slice_index=slice_index)
    solid = slice_index is None
    patch = fit_patch(source, Shaping((20, 80, 26) if solid else None), both_devices[0], Clock()).fit.patch
    sampling = Sampling(law(), (20, 80, 28) if solid else (140, 140))
    one, other = (sample_patch(patch, sampling, device, Clock()).mesh for device in both_devices)
    assert np.abs(one.points - other.points).max() < 1e-4
    assert np.abs(one.fields["HU"] - other.fields["HU"]).max() < 0.05
    assert np.abs(one.cell_fields["scaled_jacobian"] - other.cell_fields["scaled_jacobian"]).max() < 1e-4


@pytest.mark.parametrize("name", BACKENDS)
def test_a_kernel_is_told_of_while_it_is_built_and_once(name: str) -> None:
    device = _open.__wrapped__(name, "float32")
    told: list[str] = []
    device.on_build = told.append
    control = np.stack(np.meshgrid(*[np.arange(4.0)] * 3, [0.0], indexing="ij"), axis=-1)[:, :, :, 0]
    mesh = sample(hyperpatch(control), (5, 5, 5), device=device)
    del told[:]
    scaled_jacobian(mesh, device)
    assert told[-1] == "" and "quality" in told[0] and all(told[::2])
    del told[:]
    scaled_jacobian(mesh, device)
    assert not told


def test_a_name_opens_one_device() -> None:
    assert open_device("warp:cpu") is open_device("warp:cpu")
    assert open_device("warp:cpu", "float64").real == np.float64
    assert {name for name, _ in list_devices()} >= {"warp:cpu", "opencl:0:0"}


@pytest.mark.parametrize(
    ("name", "error", "reason"),
    [
        ("metal", InputError, "expected a backend of warp, opencl"),
        ("warp:tpu", InputError, "warp:cpu or warp:cuda:0"),
        ("warp:cuda:99", BackendUnavailable, "CUDA"),
        ("opencl:7:0", BackendUnavailable, "expected one of opencl:0:0"),
    ],
)
def test_what_is_not_there_is_named(name: str, error: type[Exception], reason: str) -> None:
    with pytest.raises(error, match=reason):
        open_device(name)


def test_precision_is_one_of_two() -> None:
    with pytest.raises(InputError, match="float32 or float64"):
        open_device("auto", "float16")


def test_what_does_not_fit_is_a_memory_error(device: Device) -> None:
    with pytest.raises(MemoryError, match="no room"):
        device.empty(1 << 52)


def test_what_a_gpu_finds_no_room_for_later_is_a_memory_error() -> None:
    """Drivers reserve a buffer's memory when the first command uses it."""
    opencl = pytest.importorskip("pyopencl")
    device = copy(open_device("opencl"))

    def refused(*_: Any) -> None:
        raise opencl.MemoryError("clEnqueueNDRangeKernel failed: MEM_OBJECT_ALLOCATION_FAILURE")

    arguments = (*(device.put(np.ones(1)) for _ in range(2)), 1, 1, device.empty(1))
    device.launch("vectors.product", 1, *arguments)
    found = {name: replace(kernel, function=refused) for name, kernel in device._kernels.items()}
    device.__dict__.update(_kernels=found)
    with pytest.raises(MemoryError, match=f"{re.escape(device.label)} has no room .* MEM_OBJECT_ALLOCATION_FAILURE"):
        device.launch("vectors.product", 1, *arguments)


def test_buffers_come_back_as_they_went(any_device: Device) -> None:
    lattice = np.random.default_rng(0).random((3, 4, 5))
    flat = any_device.get(any_device.put(lattice))
    assert np.allclose(flat, lattice.ravel(), rtol=1e-7) and flat.dtype == any_device.real
    numbers = any_device.put(np.arange(6).reshape(2, 3))
    assert any_device.put(numbers) is numbers
    assert np.array_equal(any_device.get(numbers), np.arange(6)) and any_device.get(numbers).dtype == np.int32


@pytest.mark.parametrize(
    "stored",
    [
        np.asfortranarray,
        lambda values: np.repeat(values, 2, axis=1)[:, ::2],
        lambda values: values[::-1].copy()[::-1],
        lambda values: np.moveaxis(np.moveaxis(values, 0, 2).copy(), 2, 0),
    ],
)
@pytest.mark.parametrize("dtype", [float, np.float32, int])
@pytest.mark.parametrize("mapped", [True, False])
def test_what_is_put_does_not_depend_on_how_it_lies_in_memory(
    any_device: Device, stored: Callable[[NDArray[Any]], NDArray[Any]], dtype: type, mapped: bool
) -> None:
    device = copy(any_device)
    if device.backend == "opencl":
        device.__dict__.update(_is_cpu=mapped)  # else as to a GPU
    values = np.arange(60).reshape(3, 4, 5).astype(dtype)
    other = stored(values)
    assert other.strides != values.strides or other.base is not None
    assert np.array_equal(device.get(device.put(other)), values.ravel())


@pytest.mark.parametrize("number", [2**31, -(2**31) - 1])
def test_integers_that_32_bits_do_not_hold_are_not_cut(device: Device, number: int) -> None:
    with pytest.raises(InputError, match=f"integers of 32 bits, got .*{number}"):
        device.put(np.array([0, number]))
    assert np.array_equal(device.get(device.put(np.array([2**31 - 1, -(2**31)]))), [2**31 - 1, -(2**31)])


@pytest.mark.parametrize("n", [1, 63, 64 * 4096 + 5])
def test_a_product_is_numpys_and_the_same_each_time(any_device: Device, n: int) -> None:
    x, y = np.random.default_rng(n).normal(size=(2, n))
    buffers = any_device.put(x), any_device.put(y)
    found = [inner_product(any_device, *buffers, n) for _ in range(3)]
    scale = np.linalg.norm(x) * np.linalg.norm(y)
    assert abs(found[0] - x @ y) < 10 * np.finfo(any_device.real).eps * scale
    assert found[0] == found[1] == found[2]


def test_opencl_drives_a_gpu_as_it_does_a_cpu(both_devices: tuple[Device, ...]) -> None:
    """The way of a GPU, one lane, padded groups and copies, gone on the CPU: kernels must not tell the difference."""
    cpu = both_devices[1]
    gpu = copy(cpu)
    gpu.__dict__.update(_is_cpu=False, _lanes=1, _wide_lanes=1, cores=0, _kernels={})
    control = np.random.default_rng(0).uniform(-50, 50, (6, 7, 8, 4))
    control[..., :3] += 100 * np.stack(np.meshgrid(*map(np.arange, (6, 7, 8)), indexing="ij"), axis=-1)
    control[..., 3] += 300
    made = []
    for device in (cpu, gpu):
        mesh = sample(hyperpatch(control), (19, 14, 11), device=device)
        mesh, _ = apply_material(mesh, device=device)
        mesh, quality = assess(mesh, device)
        explicit = scaled_jacobian(replace(mesh, structure=None, connectivity=mesh.cells), device)
        grid = Region(
            np.ones((5, 6, 7), dtype=bool), np.random.default_rng(1).random((5, 6, 7), dtype=np.float32), AFFINE
        )
        made.append((mesh.points, mesh.fields["E_MPa"], quality.counts, explicit, distances(mesh, grid, device)[0]))
    for one, other in zip(*made, strict=True):
        assert np.allclose(one, other, rtol=1e-5, atol=1e-5)


def test_opencl_finishes_before_it_is_let_go() -> None:
    """A process that ends while kernels run crashes in them: at Ctrl-C, say."""
    opencl = pytest.importorskip("pyopencl")
    device = importlib.import_module("gpubspline.device.opencl").open_device("", np.dtype(np.float32))  # no shared one
    there, n = law_on_device(law(), device), 1 << 21
    arguments = (device.put(np.zeros(n)), n, *(device.empty(n) for _ in range(3)), device.empty(n, np.int32))
    for _ in range(30):
        there.launch(*arguments)
    last = opencl.enqueue_marker(device._queue)
    done = opencl.command_execution_status.COMPLETE
    assert last.command_execution_status != done
    del device, there, arguments
    gc.collect()
    assert last.command_execution_status == done


CHECKED = """
import warp
warp.config.mode = "debug"  # every index is compared with the buffer's size; what is out of it ends the process
warp.config.enable_tiles_in_stack_memory = False  # a pointer of such builds that all threads share
import numpy as np
from gpubspline import open_device
from gpubspline.spline.hyperpatch import hyperpatch
device = open_device("warp:cpu")
for shape, samples in (((2, 2, 2), 40), ((7, 8, 9), 11)):
    patch = hyperpatch(np.ones((*shape, 4)), 1)
    assert np.all(patch.evaluate_grid([np.linspace(0, 1, samples)] * 3, device) == 1)
"""


def test_vectors_that_begin_near_the_end_of_a_buffer_lie_in_it() -> None:
    """A row shorter than a vector, and fewer numbers in all than one holds, read as vectors."""
    pytest.importorskip("warp")
    subprocess.run([sys.executable, "-c", CHECKED], check=True, timeout=300)


@pytest.mark.skipif(not Path("/sys/kernel/mm/transparent_hugepage").exists(), reason="only Linux has large pages")
@pytest.mark.parametrize("name", ["opencl", "warp:cpu"])
def test_large_buffers_ask_for_large_pages(name: str) -> None:
    device = open_device(name)
    if not device.cores:
        pytest.skip("the memory of a GPU has pages of its own")
    values = device.get(device.empty(1 << 23))
    middle, inside = values.ctypes.data + values.nbytes // 2, False
    for line in Path("/proc/self/smaps").read_text().splitlines():
        words = line.split()
        if "-" in words[0]:
            start, end = (int(part, 16) for part in words[0].split("-"))
            inside = start <= middle < end
        elif inside and words[0] == "VmFlags:":
            assert "hg" in words
            return
    pytest.fail("expected the buffer in /proc/self/smaps")


WITHOUT_ROOM = """
import resource
resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))
import numpy as np
from gpubspline.device import open_device
device = open_device("opencl")
device.launch("material.law", 1, *[device.empty(1)] * 9)
"""


def test_a_compiler_without_room_for_its_files_is_told_not_left_to_abort() -> None:
    ended = subprocess.run([sys.executable, "-c", WITHOUT_ROOM], capture_output=True, text=True, check=False)
    last = ended.stderr.strip().splitlines()[-1]
    assert (
        ended.returncode == 1 and "BackendUnavailable: expected room for 8.39 MB that PoCL's compiler writes in" in last
    )
    assert "File too large" in last


def test_a_home_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "home").write_text("no folder")
    plain = {
        name: value for name, value in os.environ.items() if not name.endswith(("CACHE_DIR", "CACHE_HOME", "_PATH"))
    }
    run = [sys.executable, "-m", "gpubspline", "backends"]
    env = {**plain, "HOME": str(tmp_path / "home")}
    ended = subprocess.run(run, capture_output=True, text=True, check=False, env=env)
    said = ended.stdout + ended.stderr
    assert "Traceback" not in said and said.count("cannot keep what it compiles in") == 2, said
    assert "POCL_CACHE_DIR names" in said and "WARP_CACHE_PATH names" in said
