"""The picture of what would be meshed: its outline where the region is, patient's sides where radiology has them."""

import numpy as np
import pytest
from matplotlib.image import imread

from gpubspline.ct.region import region_from_mask, region_from_threshold
from gpubspline.ct.volume import Volume
from gpubspline.report.page.slices import views
from gpubspline.report.preview import OUTLINE, _oriented, draw_preview, write_preview


def turned(order, signs, hu=lambda off, x: np.where(off < 9, 700 + 20 * x, -1000)):
    """A ball of 9 mm about (20, -12, 30) mm, brighter to the left, in a scan of these axes along i, j, k."""
    affine = np.eye(4)
    affine[:3, :3] = 0
    for index, (patient, sign) in enumerate(zip(order, signs, strict=True)):
        affine[patient, index] = sign * (1.0, 1.5, 2.0)[index]
    shape = np.array([30, 24, 20])
    affine[:3, 3] = np.array([20, -12, 30]) - affine[:3, :3] @ ((shape - 1) / 2)
    i, j, k = np.meshgrid(*map(np.arange, shape), indexing="ij")
    places = np.stack([i, j, k], axis=-1) @ affine[:3, :3].T + affine[:3, 3]
    off = np.linalg.norm(places - [20, -12, 30], axis=-1)
    values = hu(off, places[..., 0] - 20)
    return Volume(np.transpose(values, (2, 1, 0)).astype(np.int16), affine, "made")


@pytest.mark.parametrize(
    ("order", "signs"), [((0, 1, 2), (1, 1, 1)), ((2, 0, 1), (-1, 1, -1)), ((1, 2, 0), (1, -1, 1))]
)
def test_slices_lie_as_radiology_has_them(order, signs):
    """Left is at the right of axial and coronal slices, however the scan is stored."""
    volume = turned(order, signs)
    for view in views(volume.affine)[:2]:
        cut = _oriented(volume.hu, view, volume.shape[view["across"]] // 2)
        middle = cut[cut.shape[0] // 2]
        body = middle[middle > 0]
        assert view["letters"][:2] == ["R", "L"] and np.all(np.diff(body) >= 0) and body[0] < 600 < 800 < body[-1]


def test_the_outline_is_as_long_as_the_body_is_round(tmp_path):
    volume = turned((0, 1, 2), (1, 1, 1), lambda off, x: 100 * (9 - off))
    region = region_from_threshold(volume, 0)
    figure = draw_preview(volume, region, 0.0)
    for axes in figure.axes[:3]:
        (path,) = axes.collections[0].get_paths()
        across = np.ptp(path.vertices, axis=0) / [np.ptp(axes.get_xlim()), np.ptp(axes.get_ylim())]
        sizes = {"axial": (30, 36), "coronal": (30, 40), "sagittal": (36, 40)}
        name = axes.texts[-1].get_text().split(",")[0]
        np.testing.assert_allclose(across * sizes[name], 18, atol=0.5)
    assert [text.get_text() for text in figure.axes[3].texts] == ["threshold 0"]
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
