"""All passes in one launch, band by band, against the launches of a GPU."""

from copy import copy

import numpy as np
import pytest

from gpubspline.device import Device
from gpubspline.spline import contract
from gpubspline.spline.hyperpatch import hyperpatch


def with_cores(device: Device, cores: int) -> Device:
    """The same device, as if it had so many cores; with none, as a GPU is driven."""
    other = copy(device)
    other.cores = cores
    return other


@pytest.mark.parametrize(
    ("control", "degrees", "nodes"),
    [
        ((9, 8, 7, 4), (3, 3, 3), (41, 22, 19)),  # more nodes than lanes
        ((40, 37, 6, 4), (1, 2, 5), (35, 70, 9)),  # rows of control points longer than the lanes
        ((7, 6, 9, 5), (5, 4, 1), (33, 5, 40)),  # as many channels as no vector holds
        ((4, 30, 33, 3), (2, 3, 4), (3, 4, 5)),  # rows and planes of control points that no node needs
        ((5, 4, 4, 36), (2, 3, 3), (64, 9, 8)),  # more channels than lanes
        ((5, 4, 4, 4), (4, 3, 3), (1, 1, 1)),
        ((5, 8, 4, 4), (2, 5, 3), (291, 9, 34)),  # rows that begin anywhere in a GPU's blocks of memory, and end there
        ((20, 9, 12, 4), (3, 2, 3), (103, 101, 111)),  # larger than the caches: written past them
    ],
)
def test_bands_are_what_single_directions_give(
    control: tuple[int, ...],
    degrees: tuple[int, ...],
    nodes: tuple[int, ...],
    any_device: Device,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    if not any_device.cores:
        pytest.skip("bands are a CPU's")
    rng = np.random.default_rng(5)
    names = [f"c{c}" for c in range(control[-1] - 3)]
    away = np.array([700, -90, 1300, *[0] * len(names)])  # a middle, which the last pass adds
    patch = hyperpatch(rng.uniform(-1, 1, control) + away, degrees, channels=names)
    axes = [np.sort(rng.uniform(0, 1, n)) for n in nodes]
    one_by_one = patch.evaluate_grid(axes, with_cores(any_device, 0)).copy()
    for ring_bytes, cores in ((contract.RING_BYTES, 1), (1, 1), (20_000, 50)):  # one band, bands of a row, many items
        monkeypatch.setattr(contract, "RING_BYTES", ring_bytes)
        assert np.array_equal(patch.evaluate_grid(axes, with_cores(any_device, cores)), one_by_one)


def test_parameters_in_any_order(any_device: Device) -> None:
    rng = np.random.default_rng(6)
    patch = hyperpatch(rng.uniform(-1, 1, (6, 7, 8, 4)))
    axes = [np.linspace(0, 1, n) for n in (40, 21, 22)]
    forth = patch.evaluate_grid(axes, any_device).copy()
    back = patch.evaluate_grid([axis[::-1] for axis in axes], any_device)
    assert np.array_equal(back[::-1, ::-1, ::-1], forth)
    shuffled = [rng.permutation(len(axis)) for axis in axes]
    mixed = patch.evaluate_grid([axis[at] for axis, at in zip(axes, shuffled, strict=True)], any_device)
    assert np.array_equal(mixed, forth[np.ix_(*shuffled)])
