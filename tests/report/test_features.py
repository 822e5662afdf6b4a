"""The picture of thin features and of what a mesh leaves out."""

import numpy as np
import pytest
from matplotlib.image import imread

from gpubspline.cautions import warn_of_lost
from gpubspline.cli.solid import warn_of_shape
from gpubspline.ct.region import Region
from gpubspline.errors import GpubsplineWarning, InputError
from gpubspline.mesh.element_size import default_size
from gpubspline.mesh.lost import list_lost
from gpubspline.mesh.thickness import measure_thickness
from gpubspline.report.features import draw_features, write_features


def plate_with_fin(thickness=3.0):
    """A plate 8 mm thick with a fin of another thickness on it."""
    affine = np.eye(4)
    k, j, i = np.indices((40, 40, 40)) - 19.3
    plate = np.maximum(np.maximum(np.abs(i), np.abs(j)) - 16, np.abs(k + 8) - 4)
    fin = np.maximum(np.maximum(np.abs(i) - thickness / 2, np.abs(j) - 14), np.maximum(k - 14, -4 - k))
    level = np.minimum(plate, fin).astype(np.float32)
    return Region(level < 0, level, affine)


def test_thickness_is_measured_across_each_feature():
    thick = measure_thickness(plate_with_fin())
    in_fin = thick.places_mm[:, 2] - 19.3 > 2
    in_plate = (np.abs(thick.places_mm[:, 0] - 19.3) > 6) & (np.abs(thick.places_mm[:, 0] - 19.3) < 10)
    assert in_fin.sum() > 100 and np.median(thick.thickness_mm[in_fin]) == pytest.approx(3.0, abs=0.7)
    assert in_plate.sum() > 50 and np.median(thick.thickness_mm[in_plate]) == pytest.approx(8.0, abs=0.7)


def test_the_default_size_is_half_the_thinnest_feature_within_reason():
    """A fin of 3 mm asks for 1.5 mm, one of 6 for 3, unless that is too few elements; sizes follow the body's scale."""
    thin, thick = default_size(plate_with_fin(3.0)), default_size(plate_with_fin(6.0))
    assert thin == pytest.approx(1.5, abs=0.4) and thin < thick
    region = plate_with_fin(3.0)
    scaled = Region(region.mask, 2 * region.distance_mm, np.diag([2.0, 2.0, 2.0, 1.0]))
    assert default_size(scaled) == pytest.approx(2 * thin, rel=1e-3)


def test_the_picture_marks_what_is_lost(tmp_path):
    region = plate_with_fin()
    lost = [{"place_mm": [19.0, 20.0, 33.0], "out_mm": 4.0}]
    write_features(region, {"lost_features": lost, "size_mm": 2.0}, tmp_path / "with.png")
    write_features(region, {"lost_features": None, "size_mm": None}, tmp_path / "without.png")
    red = [count_red(imread(tmp_path / name)) for name in ("with.png", "without.png")]
    assert red[0] > 100 and red[1] == 0
    texts = [text.get_text() for text in draw_features(region, {"lost_features": lost}).texts]
    assert any("1  at (19.0, 20.0, 33.0) mm, up to 4.0 mm outside the mesh" in text for text in texts)
    with pytest.raises(InputError, match=r"ends in \.png"):
        write_features(region, {}, tmp_path / "a.jpg")


def count_red(pixels):
    r, g, b = np.moveaxis(pixels[..., :3], -1, 0)
    return int(np.count_nonzero((r > 0.6) & (g < 0.25) & (b < 0.3)))


def test_lost_parts_are_warned_of_once_with_the_farthest():
    lost = [{"place_mm": [1, 2, 3], "out_mm": 1.0}, {"place_mm": [4, 5, 6], "out_mm": 7.0}]
    with pytest.warns(GpubsplineWarning, match=r"2 parts of the region are left out, up to 7\.0 mm .* \(4\.0, 5\.0, 6"):
        warn_of_lost(lost, 1.5)
    with pytest.warns(GpubsplineWarning, match=r"8% of the region's volume and 2 parts of the region are left out"):
        warn_of_lost(lost, 1.5, less=0.08)
    warn_of_lost([], 1.5, less=0.08)


@pytest.mark.parametrize(("lost", "mesh_mm3", "said"), [(1, 90.0, 1), (0, 90.0, 1), (1, 110.0, 2), (1, 99.0, 1)])
def test_volume_that_lost_parts_had_is_warned_of_once(lost, mesh_mm3, said):
    features = [{"place_mm": [1, 2, 3], "out_mm": 3.0, "thickness_mm": 1.0}][:lost]
    figures = {
        "method": {"name": "blocks"},
        "volume_mm3": {"mesh": mesh_mm3, "region": 100.0},
        "lost_features": features,
        "size_mm": 1.5,
    }
    with pytest.warns(GpubsplineWarning) as warned:
        warn_of_shape(figures)
    assert len(warned) == said


@pytest.mark.parametrize(
    ("thick", "said"),
    [(4.0, "a --size below 1.5 mm follows"), (1.2, "where it is 1.2 mm thick; a --size of 0.6 mm"), (0.2, "--smooth")],
)
def test_what_follows_a_lost_part_is_said_by_its_thickness(thick, said):
    with pytest.warns(GpubsplineWarning, match=said):
        warn_of_lost([{"place_mm": [1, 2, 3], "out_mm": 3.0, "thickness_mm": thick}], 1.5)


def test_lost_parts_are_listed_once_and_their_thickness_measured():
    """A plate of 10 voxels with a rod of 4 on it: what both found at its top is one part, as thick as the rod."""
    k, j, i = np.indices((40, 24, 24)) - 12.0
    plate = np.maximum.reduce([np.abs(k) - 5, np.abs(j) - 9, np.abs(i) - 9])
    distance = np.minimum(plate, np.maximum(np.hypot(i, j) - 2, np.abs(k - 10) - 12)).astype(np.float32)
    region = Region(distance < 0, distance, np.eye(4))
    top, far = {"place_mm": [12.0, 12.0, 33.5], "out_mm": 16.0}, {"place_mm": [3.5, 12.0, 12.0], "out_mm": 2.0}
    twin = {"place_mm": [12.0, 12.0, 33.0], "out_mm": 15.0}
    lost = list_lost([twin, far], [top], region)
    assert [feature["out_mm"] for feature in lost] == [16.0, 2.0]
    assert lost[0]["thickness_mm"] == pytest.approx(4.0, abs=0.1)
    assert list_lost([], [], region) == []
