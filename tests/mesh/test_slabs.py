"""A mesh made and written slab by slab is the mesh made whole."""

from pathlib import Path

import numpy as np
import pytest

from gpubspline.clock import Clock
from gpubspline.ct.phantom import phantom
from gpubspline.ct.region import region_from_threshold
from gpubspline.device import Device
from gpubspline.errors import InputError
from gpubspline.export import read_mesh
from gpubspline.material.registry import law
from gpubspline.mesh.sample import sample
from gpubspline.mesh.slabs import sample_slabs
from gpubspline.pipeline import sample_patch, summarise
from gpubspline.recipe import Body, Sampling
from gpubspline.spline.fit import fit
from gpubspline.spline.hyperpatch import Hyperpatch, hyperpatch
from gpubspline.spline.lattice import control_lattice
from gpubspline.streaming import stream_patch


def warped(mirrored: bool) -> Hyperpatch:
    axes = np.meshgrid(*[np.linspace(0, 1, 6)] * 3, indexing="ij")
    bend = 0.05 * np.random.default_rng(5).standard_normal((6, 6, 6, 3))
    points = 40 * (np.stack(axes, axis=-1) + bend)
    control = np.concatenate([points, 300 + 40 * points[..., :1]], axis=-1)
    return hyperpatch(control[::-1] if mirrored else control)


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("slab_nodes", [1, 130, 10**6])
def test_slabs_are_the_layers_of_the_whole(device: Device, mirrored: bool, slab_nodes: int) -> None:
    patch, nodes = warped(mirrored), (9, 7, 11)
    whole = sample(patch, nodes, device=device)
    slabs = list(sample_slabs(patch, nodes, device=device, slab_nodes=slab_nodes))
    points = np.concatenate([slab.mesh.points[slab.own_nodes] for slab in slabs])
    assert np.allclose(points, whole.points, atol=1e-4)
    assert (slabs[0].first, slabs[-1].last) == (0, 10) and len(slabs) == {1: 10, 130: 5, 10**6: 1}[slab_nodes]
    assert whole.volume_mm3 == pytest.approx(sum(slab.mesh.volume_mm3 for slab in slabs), rel=1e-5)
    assert [side for slab in slabs for side in slab.sides if side[0] == "w"] == ["w0", "w1"]


def test_streamed_file_and_figures_are_those_of_the_whole(device: Device, tmp_path: Path) -> None:
    volume = phantom("child-femur").scan()
    region = region_from_threshold(volume, 300)
    body = Body(volume, volume, region, 300)
    patch = fit(control_lattice(volume, region, (9, 11, 20)), device=device).patch
    sampling = Sampling(law(), (12, 14, 23))
    whole = sample_patch(patch, sampling, device, Clock(), body)
    parts = stream_patch(patch, sampling, tmp_path / "m.vts", device, Clock(), body, slab_nodes=12 * 14 * 4)
    one, other = (summarise(model, device, Clock()) for model in (whole, parts))
    for key in ("nodes", "elements", "element_type", "out_of_range_nodes"):
        assert one[key] == other[key]
    assert other["volume_mm3"]["mesh"] == pytest.approx(one["volume_mm3"]["mesh"], rel=1e-5)
    for key in ("hu", "modulus_mpa", "surface_distance_mm"):
        assert other[key] == pytest.approx(one[key], rel=1e-4, abs=1e-4)
    judged, added = one["scaled_jacobian"], other["scaled_jacobian"]
    assert added["histogram"] == judged["histogram"] and added["inverted"] == judged["inverted"]
    for key in ("min", "mean", "fraction_above_0.5", "fraction_below_0.1", "fraction_below_0.2"):
        assert added[key] == pytest.approx(judged[key], rel=1e-5)
    assert [row["element"] for row in added["worst"]] == [row["element"] for row in judged["worst"]]
    written = read_mesh(tmp_path / "m.vts")
    assert np.allclose(written.points, whole.mesh.points, atol=1e-4)
    for name in ("HU", "density_g_cm3", "E_MPa", "nu"):
        assert np.allclose(written.fields[name], whole.mesh.fields[name], rtol=1e-4, atol=1e-3)
    for name in ("scaled_jacobian", "material"):
        assert np.allclose(written.cell_fields[name], whole.mesh.cell_fields[name], atol=1e-4)


def test_a_surface_has_no_slabs(device: Device) -> None:
    with pytest.raises(InputError, match="solid"):
        next(sample_slabs(hyperpatch(np.random.default_rng(0).random((5, 5, 4))), (9, 9), device=device))
