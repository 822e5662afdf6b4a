"""Devices: names, errors, and one mesh from both backends."""

from pathlib import Path

import numpy as np
import pytest

from gpubspline.clock import Clock
from gpubspline.device import Device, list_devices, open_device
from gpubspline.errors import BackendUnavailable, InputError
from gpubspline.material.registry import law
from gpubspline.pipeline import fit_patch, sample_patch
from gpubspline.recipe import Sampling, Shaping, Source


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


def test_buffers_come_back_as_they_went(any_device: Device) -> None:
    lattice = np.asfortranarray(np.random.default_rng(0).random((3, 4, 5)))
    flat = any_device.get(any_device.put(lattice))
    assert np.allclose(flat, lattice.ravel(order="F"), rtol=1e-7) and flat.dtype == any_device.real
    numbers = any_device.put(np.arange(6).reshape(2, 3))
    assert any_device.put(numbers) is numbers
    assert np.array_equal(any_device.get(numbers), np.arange(6)) and any_device.get(numbers).dtype == np.int32
