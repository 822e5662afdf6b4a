"""Meshes of blocks of real bodies: the public benchmark of all-hex meshers, a vertebra; and what is refused."""

from pathlib import Path

import numpy as np
import pytest

from gpubspline.bench.bench_blocks import OFF, femur, three_arms, without_pillow
from gpubspline.ct.image import read_volume
from gpubspline.ct.masks import read_mask
from gpubspline.ct.region import Region, region_from_mask
from gpubspline.device import Device
from gpubspline.errors import GpubsplineError, MeshError
from gpubspline.mesh.blocks.level_set import level_set
from gpubspline.mesh.blocks.mesher import blocks_mesh, mesh_level_set
from gpubspline.mesh.blocks.result import Blocks
from gpubspline.mesh.distance import sample_distance, surface_distance
from gpubspline.mesh.element_size import size_for
from gpubspline.mesh.floors import Effort
from gpubspline.mesh.quality import assess
from gpubspline.surface.read import read_surface
from gpubspline.surface.region import region_from_surface


def judge(made: Blocks, region: Region, device: Device, floor: float, vtk: bool = False) -> None:
    """No hex below the floor, volume within 1 %, mean distance within 0.05 of an element, topology of the region's."""
    mesh, quality = assess(made.mesh, device)
    assert quality.inverted == 0 and quality.min >= floor
    assert mesh.volume_mm3 == pytest.approx(region.volume_mm3, rel=0.01)
    assert surface_distance(mesh, region, device).mean <= 0.05 * made.report.size_mm
    assert made.report.euler["mesh"] == made.report.euler["region"]
    assert made.report.off_surface_nodes["count"] == 0
    if vtk:
        pytest.importorskip("pyvista")
        found = mesh.to_pyvista().cell_quality("scaled_jacobian").cell_data["scaled_jacobian"]
        assert found.min() == pytest.approx(quality.min, abs=1e-3)


@pytest.mark.parametrize("device", ["opencl"], indirect=True)
def test_published_bone(data: Path, device: Device) -> None:
    """The best published mesh of it: 8,619 hexes, worst 0.610, 2.3 % of the volume lost."""
    region = region_from_surface(read_surface(data / "surfaces" / "bone.ply"), device)
    size = size_for(region, 9000, device)
    made = blocks_mesh(region, size, device=device)
    judge(made, region, device, 0.70, vtk=True)
    assert made.mesh.n_elements == pytest.approx(9000, rel=0.1) and made.mesh.n_elements >= 8600
    assert made.mesh.volume_mm3 == pytest.approx(region.volume_mm3, rel=0.002)
    middles = made.mesh.points[made.mesh.boundary()].mean(axis=1).astype(np.float64)
    off = np.abs(sample_distance(region, middles, device)) / size
    assert off.mean() <= 0.02 and off.max() <= 0.25


@pytest.mark.parametrize("device", ["warp"], indirect=True)
def test_whole_vertebra(data: Path, device: Device) -> None:
    """Holes and processes, thin ones among them: its canal is a tunnel."""
    folder = data / "vertebra"
    volume = read_volume(folder / "sub-ct_label-22_ct.nii.gz")
    mask = read_mask(folder / "sub-ct_seg-vert_label-22_msk.nii.gz", volume, 22)
    region = region_from_mask(volume, mask)
    made = blocks_mesh(region, 2.0, device=device)
    judge(made, region, device, 0.60)
    assert made.report.euler["mesh"] == 0


@pytest.mark.parametrize(("region", "size"), [(femur(), 5.0), (three_arms(), 3.0)])
def test_phantoms_branching_too(region: Region, size: float, device: Device) -> None:
    judge(blocks_mesh(region, size, device=device), region, device, 0.65)


def test_each_backend_meshes_alike(both_devices: tuple[Device, ...]) -> None:
    made = [blocks_mesh(three_arms(), 4.0, device=device) for device in both_devices]
    assert np.array_equal(made[0].mesh.cells, made[1].mesh.cells)
    least = [each.report.min_scaled_jacobian for each in made]
    assert min(least) >= 0.65 and abs(least[0] - least[1]) < 0.05


@pytest.mark.parametrize("device", ["opencl"], indirect=True)
def test_steps_that_the_method_stands_on(device: Device) -> None:
    """Without the pillow hexes stay poor; without the bulge volume is lost; without any step the worst hex is worse."""
    region, size = three_arms(), 3.5
    level = level_set(region, size, device=device)
    whole = mesh_level_set(level, device)
    assert without_pillow(region, size, device)[1] < 0.45 < 0.65 < whole.report.min_scaled_jacobian
    flat = mesh_level_set(level, device, **OFF["nodes on the surface, not outside by the sag"])
    lost = [1 - made.mesh.volume_mm3 / region.volume_mm3 for made in (flat, whole)]
    assert lost[0] > 0.015 > abs(lost[1])
    start = mesh_level_set(level, device, Effort(goal=0.0, steps=0, loosen=False))
    assert start.report.min_scaled_jacobian < whole.report.min_scaled_jacobian - 0.2


def noise(seed: int = 0) -> Region:
    """Voxels inside at random: walls as thin as a voxel everywhere."""
    values = np.random.default_rng(seed).normal(size=(10, 10, 10)).astype(np.float32)
    values[[0, -1]] = values[:, [0, -1]] = values[:, :, [0, -1]] = 1.0
    return Region(values < 0, values, np.eye(4))


def test_porous_voxels_are_refused_or_sound(device: Device) -> None:
    """At voxel size no mesh may come with an inverted hex: either an error that says where, or none inverted."""
    try:
        made = blocks_mesh(noise(), 1.0, device=device, attempts=1)
    except GpubsplineError as error:
        assert isinstance(error, MeshError) and " mm" in str(error) and "smaller size" in str(error)
        assert "\n" not in str(error)
    else:
        assert assess(made.mesh, device)[1].inverted == 0


def test_inverted_hexes_stay_only_where_they_are_allowed(device: Device) -> None:
    asked = {"device": device, "attempts": 1, "effort": Effort(goal=0.0, steps=0, loosen=False)}
    with pytest.raises(MeshError, match=r"hexes stayed inverted, the worst at \("):
        blocks_mesh(noise(3), 1.0, **asked)
    assert assess(blocks_mesh(noise(3), 1.0, **asked, allow_inverted=True).mesh, device)[1].inverted > 0


def test_sheet_thinner_than_an_element_is_refused(device: Device) -> None:
    k = np.abs(np.indices((21, 31, 31))[0] - 10.0) - 1.0
    edge = np.maximum.reduce([np.abs(index - 15.0) - 12.0 for index in np.indices((21, 31, 31))[1:]])
    distance = np.maximum(k, edge).astype(np.float32)
    with pytest.raises(GpubsplineError, match=r"mm.*smaller size"):
        blocks_mesh(Region(distance < 0, distance, np.eye(4)), 6.0, device=device)
