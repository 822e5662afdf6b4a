"""Finer meshes of blocks: as good as the coarse ones, on the surface, with their sets."""

from pathlib import Path

import numpy as np
import pytest

from gpubspline.bench.bench_blocks import three_arms
from gpubspline.ct.image import read_volume
from gpubspline.ct.masks import read_mask
from gpubspline.ct.region import Region, region_from_mask
from gpubspline.device import Device, open_device
from gpubspline.errors import InputError
from gpubspline.mesh.blocks.chords import measure_chords
from gpubspline.mesh.blocks.curved import LEAST, curve, onto, unbiased
from gpubspline.mesh.blocks.level_set import ON_SURFACE, volume_inside
from gpubspline.mesh.blocks.mesher import blocks_mesh
from gpubspline.mesh.blocks.refine import GIVEN, _slack, refine
from gpubspline.mesh.blocks.result import Blocks
from gpubspline.mesh.movable import FIXED, FREE
from gpubspline.mesh.quality import assess
from gpubspline.mesh.validity import certify


def check(fine: Blocks, coarse: Blocks, times: int, device: Device) -> None:
    """As many hexes, none much worse than the coarse ones, sound throughout; faces as much inside as outside."""
    assert fine.mesh.n_elements == times**3 * coarse.mesh.n_elements
    _, quality = assess(fine.mesh, device)
    assert quality.min == pytest.approx(fine.report.min_scaled_jacobian, abs=1e-4)
    assert quality.min >= coarse.report.min_scaled_jacobian - GIVEN - 0.02
    assert certify(fine.mesh, device).certificate.valid
    faces = fine.mesh.boundary()
    assert np.array_equal(np.unique(faces), fine.mesh.node_sets["surface"])
    surface = coarse.surface()
    chords = measure_chords(surface.in_lattice(fine.mesh.points), faces, unbiased(surface.phi))
    assert abs(chords.volume) < 5e-4 * volume_inside(surface.phi)
    assert np.average(np.abs(chords.off), weights=chords.areas) < 0.01


@pytest.mark.parametrize(("times", "device"), [(2, "warp"), (3, "opencl")], indirect=["device"])
def test_finer_meshes_are_as_good(times: int, device: Device) -> None:
    coarse = blocks_mesh(three_arms(), 3.0, device=device)
    fine = refine(coarse, times, device=device)
    check(fine, coarse, times, device)
    assert fine.report.off_surface_nodes["count"] == 0


@pytest.mark.parametrize("size_mm", [2.6, 3.0])
def test_finer_vertebra(size_mm: float, data: Path) -> None:
    """Thin processes, ridges sharper than an element: nodes on all of the level set would fold hexes at these."""
    device = open_device("auto")
    folder = data / "vertebra"
    volume = read_volume(folder / "sub-ct_label-22_ct.nii.gz")
    region = region_from_mask(volume, read_mask(folder / "sub-ct_seg-vert_label-22_msk.nii.gz", volume, 22))
    coarse = blocks_mesh(region, size_mm, attempts=1, device=device)
    fine = refine(coarse, 2, device=device)
    check(fine, coarse, 2, device)
    assert certify(fine.mesh, device).certificate.least_ratio >= 0.2
    curved = curve(coarse, device=device).sample(1, "hex27")
    assert assess(curved, device)[1].min >= LEAST - 0.02 and certify(curved, device).certificate.least_ratio > 0.02


def test_parts_stay_parts(device: Device) -> None:
    whole = three_arms()
    k = np.indices(whole.mask.shape)[0]
    low, high = (np.where(side, whole.distance_mm, 5.0).astype(np.float32) for side in (k < 40, k >= 40))
    parts = {
        "low": Region(whole.mask & (k < 40), low, whole.affine),
        "high": Region(whole.mask & (k >= 40), high, whole.affine),
    }
    coarse = blocks_mesh(whole, 3.0, parts=parts, device=device)
    finer = refine(coarse, 2, device=device)
    fine = finer.mesh
    assert [body.elements for body in finer.report.bodies] == [8 * body.elements for body in coarse.report.bodies]
    assert sum(body.volume_mm3["mesh"] for body in finer.report.bodies) == pytest.approx(fine.volume_mm3, rel=1e-5)
    assert finer.report.bodies[0].volume_mm3["region"] == coarse.report.bodies[0].volume_mm3["region"]
    assert {name: 8 * len(members) for name, members in coarse.mesh.element_sets.items()} == {
        name: len(members) for name, members in fine.element_sets.items()
    }
    shared = np.intersect1d(*(np.unique(fine.cells[fine.element_sets[name]]) for name in ("low", "high")))
    assert np.array_equal(shared, fine.node_sets["low_to_high"]) and len(shared) > 3 * len(
        coarse.mesh.node_sets["low_to_high"]
    )


def test_what_holds_the_nodes_of_a_finer_mesh() -> None:
    """Those of the surface by how far they are off it, those between bodies where they are, all others by nothing."""
    sets = {"surface": np.array([0, 1, 2]), "low_to_high": np.array([2, 3])}
    slack = _slack(sets, np.array([0.5 * ON_SURFACE, 0.3, 0.0, 0.0, 0.7]))
    assert slack.tolist() == [0.0, 0.3, FIXED, FIXED, FREE]


def test_points_between_two_sheets_find_one(device: Device) -> None:
    """Midway in a plate the distance has no slope: the way is along the normal."""
    k = np.abs(np.indices((31, 41, 41))[0] - 15.0) - 3.5
    edge = np.maximum.reduce([np.abs(index - 20.0) - 14.0 for index in np.indices((31, 41, 41))[1:]])
    distance = np.maximum(k, edge).astype(np.float32)
    made = blocks_mesh(Region(distance < 0, distance, np.eye(4)), 4.0, device=device)
    middle = np.array([[20.0, 20.0, 15.0], [17.0, 22.0, 15.2]])
    found = onto(made.surface(), device)(middle, np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]))
    assert np.allclose(found[:, :2], middle[:, :2], atol=0.3), found
    assert np.allclose(found[:, 2], [18.5, 11.5], atol=0.5), found


def test_no_times(device: Device) -> None:
    made = blocks_mesh(three_arms(), 5.0, device=device)
    assert refine(made, 1, device=device) is made
    with pytest.raises(InputError, match="1 or more"):
        refine(made, 0, device=device)
