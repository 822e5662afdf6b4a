"""The picture of what would be meshed: its outline where the region is, patient's sides where radiology has them."""

import numpy as np
import pytest
import SimpleITK as sitk
from matplotlib.image import imread

from gpubspline.ct.region import region_from_mask, region_from_threshold
from gpubspline.ct.volume import Volume
from gpubspline.errors import InputError
from gpubspline.material.mapping import map_material
from gpubspline.material.registry import law, laws
from gpubspline.report.page.slices import views
from gpubspline.report.preview import (
    INSIDE,
    OUTLINE,
    OUTSIDE,
    _fullest,
    _oriented,
    draw_preview,
    write_preview,
)
from gpubspline.report.quantity import DISTINCT
from gpubspline.report.tissues import find_tissues


def turned(order, signs, hu):
    """HU of the distance from (20, -12, 30) mm and of x, y, z there, in a scan of these axes along i, j, k."""
    affine = np.eye(4)
    affine[:3, :3] = 0
    for index, (patient, sign) in enumerate(zip(order, signs, strict=True)):
        affine[patient, index] = sign * (1.0, 1.5, 2.0)[index]
    shape = np.array([30, 24, 20])
    affine[:3, 3] = np.array([20, -12, 30]) - affine[:3, :3] @ ((shape - 1) / 2)
    i, j, k = np.meshgrid(*map(np.arange, shape), indexing="ij")
    places = np.stack([i, j, k], axis=-1) @ affine[:3, :3].T + affine[:3, 3]
    off = np.linalg.norm(places - [20, -12, 30], axis=-1)
    values = hu(off, *np.moveaxis(places - [20, -12, 30], -1, 0))
    return Volume(np.transpose(values, (2, 1, 0)).astype(np.int16), affine, "made")


@pytest.mark.parametrize(
    ("order", "signs"),
    [((0, 1, 2), (1, 1, 1)), ((2, 0, 1), (-1, -1, -1)), ((1, 2, 0), (-1, 1, -1)), ((0, 2, 1), (-1, -1, 1))],
)
def test_slices_lie_as_radiology_has_them(order, signs):
    """The patient's left at the right, front and head above, however the scan is stored: it is brighter there."""
    volume = turned(order, signs, lambda off, x, y, z: np.where(off < 9, 700 + 20 * x - 7 * y + 11 * z, -1000))
    letters = {"axial": ["R", "L", "A", "P"], "coronal": ["R", "L", "S", "I"], "sagittal": ["A", "P", "S", "I"]}
    for view in views(volume.affine):
        cut = _oriented(volume.hu, view, volume.shape[view["across"]] // 2).astype(float)
        assert view["letters"] == letters.pop(view["name"])
        cut[cut < 0] = np.nan
        right, down = np.nanmean(np.diff(cut, axis=1)), np.nanmean(np.diff(cut, axis=0))
        assert (right > 0) == (view["letters"][1] == "L") and down < 0
    assert not letters


def test_slices_are_those_that_hold_most():
    mask = np.zeros((8, 9, 10), dtype=bool)
    mask[1, 2:5, 3] = mask[1, 2, 3:9] = mask[6, 7, 8] = True
    assert [_fullest(mask, axis) for axis in range(3)] == [1, 2, 3]


def test_the_outline_is_as_long_as_the_body_is_round(tmp_path):
    volume = turned((0, 1, 2), (1, 1, 1), lambda off, x, y, z: 100 * (9 - off))
    region = region_from_threshold(volume, 0)
    figure = draw_preview(volume, region, 0.0)
    for axes in figure.axes[:3]:
        (path,) = axes.collections[0].get_paths()
        across = np.ptp(path.vertices, axis=0) / [np.ptp(axes.get_xlim()), np.ptp(axes.get_ylim())]
        sizes = {"axial": (30, 36), "coronal": (30, 40), "sagittal": (36, 40)}
        name = axes.texts[-1].get_text().split(",")[0]
        np.testing.assert_allclose(across * sizes[name], 18, atol=0.5)
        middle = (path.vertices.min(axis=0) + path.vertices.max(axis=0)) / 2
        np.testing.assert_allclose(middle, [np.mean(axes.get_xlim()), np.mean(axes.get_ylim())], atol=0.01)  # inches
    every, inside = (bars.get_data().values for bars in figure.axes[3].patches)
    assert (every[every > 0.5].sum(), inside[inside > 0.5].sum()) == (volume.hu.size, region.mask.sum())
    assert [text.get_text() for text in figure.axes[3].texts] == ["threshold 0"]
    with pytest.raises(InputError, match=r"\.png"):
        write_preview(volume, region, tmp_path / "p.pdf")
    write_preview(volume, region_from_mask(volume, region.mask), tmp_path / "p.png")
    wanted = [int(OUTLINE[n : n + 2], 16) / 255 for n in (1, 3, 5)]
    near = np.abs(imread(tmp_path / "p.png")[..., :3] - wanted).max(axis=2) < 0.1
    assert near.sum() > 1000


def test_the_command_says_what_is_left_out_and_refuses_what_is_no_picture(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    hu = np.full((12, 12, 12), -1000, np.int16)
    hu[2:8, 2:8, 2:8], hu[9:11, 9:11, 9:11] = 500, 500
    np.save("ct.npy", hu)
    status, said, err = run("preview", "ct.npy", "--spacing", "1,1,1", "--threshold", "0", "-o", "p.png")
    assert (status, err) == (0, "") and f"{8 / 224:.1%} of what is above it lies apart and is left out" in said
    assert "hexes of" in said and (tmp_path / "p.png").stat().st_size > 10_000
    for words in (("-o", "p.pdf"), ("-o", "q.png", "--threshold", "900"), ("-o", "ct.npy")):
        status, said, err = run("preview", "ct.npy", "--spacing", "1,1,1", *words)
        assert (status, said) == (2, "") and err.count("\n") == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == ["ct.npy", "p.png"]
    err = run("preview", "ct.npy", "--spacing", "1,1,1", "--mask", "p.png", "-o", "p.png")[2]
    assert "p.png" in err and "input" in err


def labelled_cube():
    """Three layers along z of 4 mm, 200, 400 and 800 HU, in air: labels 1 and 2 of the first two, 2 outside too."""
    hu = np.full((18, 12, 12), -1000, np.int16)
    hu[3:7, 2:10, 2:10], hu[7:11, 2:10, 2:10], hu[11:15, 2:10, 2:10] = 200, 400, 800
    labels = np.zeros(hu.shape, np.int32)
    labels[3:7, 2:10, 2:10], labels[7:11, 2:10, 2:10], labels[7:11, :2] = 1, 2, 2
    return Volume(hu, np.eye(4)), labels


def test_labels_are_told_with_their_hu_and_what_their_law_makes_of_them():
    volume, labels = labelled_cube()
    region = region_from_threshold(volume, 0)
    laws = {0: law("wirtz-2000"), 2: law("constant:E=110000,nu=0.3")}
    found = find_tissues(volume, region, labels, {1: "spongy", 2: "metal", 7: "none"}, laws)
    spongy, metal, none, rest = found.tissues
    assert (spongy.label, spongy.mm3, spongy.apart, spongy.hu) == (1, 256, 0, (200, 200))
    assert spongy.modulus_mpa == pytest.approx([1904 * (1.9 * 200 / 1630) ** 1.64] * 2)
    assert metal.apart == pytest.approx(4 * 24 / (256 + 4 * 24)) and metal.modulus_mpa == (110000, 110000)
    assert metal.words[1:] == ("256 mm³, 27% left out", "400 to 400 HU", "E 110,000 MPa, constant:E=110000,nu=0.3")
    assert none.hu is None and none.words[1] == "no voxel of the body"
    assert (rest.label, rest.name, rest.law, rest.hu) == (0, "the rest", "wirtz-2000", (800, 800))
    assert rest.modulus_mpa == pytest.approx([2065 * (1.9 * 800 / 1630) ** 3.09] * 2)
    overlay = [image for image in draw_preview(volume, region, 0.0, found).axes[1].images][1].get_array()
    of_metal = np.all(overlay[..., :3] == DISTINCT[1], axis=2)  # of the coronal slice, z up
    assert set(np.unique(overlay[of_metal][:, 3])) <= {INSIDE, OUTSIDE} and of_metal.sum() == 4 * 8
    assert np.all(overlay[:3] == 0) and not np.any(np.all(overlay[3:7, 2:10, 3:] > 0, axis=2))  # of no label


@pytest.mark.parametrize("hu", [0, 100, 230.5, 349.9, 350, 1200, 2000, 2400, -1000])
def test_a_modulus_on_the_host_is_that_of_the_device(hu, device64):
    for name, each in laws().items():
        there = map_material(np.array([hu]), each, device=device64).modulus_mpa[0]
        assert each.modulus_mpa(hu) == pytest.approx(there, rel=1e-12), name


def test_the_command_draws_labels_and_refuses_what_does_not_go_together(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    volume, labels = labelled_cube()
    for name, values in (("ct", volume.hu), ("labels", labels.astype(np.uint8))):
        sitk.WriteImage(sitk.GetImageFromArray(values), f"{name}.nii.gz")
    given = ["preview", "ct.nii.gz", "--threshold", "0", "-o", "p.png"]
    status, said, err = run(*given, "--labels", "labels.nii.gz", "--law", "2=constant:E=5,nu=0.3")
    assert (status, err) == (0, "") and "256 mm³, 27% left out  400 to 400 HU  E 5 MPa, constant:E=5,nu=0.3" in said
    assert imread("p.png").shape[0] > 1.05 * (run(*given), imread("p.png").shape[0])[1]  # a legend below
    assert "labels   " not in run(*given)[1] and "the body" in run(*given, "--law", "keyak-1998")[1]
    for words in (("--law", "2=keyak-1998"), ("--labels", "labels.nii.gz", "--law", "9=keyak-1998")):
        status, said, err = run(*given, *words)
        assert (status, said) == (2, "") and err.count("\n") == 1
