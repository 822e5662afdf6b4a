"""What the scan spreads over a surface, folded back: exact for straight edges, the scan's integral for thin layers."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import special

from gpubspline.ct.partial_volume import REACH, Folding, check_treatment, folding
from gpubspline.ct.region import Region
from gpubspline.ct.volume import Volume
from gpubspline.device import Device
from gpubspline.errors import InputError
from gpubspline.spline.lattice import control_lattice

Floats = NDArray[np.float64]
SPACING = np.array([0.8, 1.0, 1.3])
NORMALS = [(1.0, 0.0, 0.0), (0.0, 0.0, -1.0), (2.0, -1.0, 2.0)]


def scan(layers: list[tuple[float, float]], outside: float, normal: Floats, blur: float, shift: float = 0.0) -> tuple:
    """A half space in ``layers`` of (HU, depth of the outer side), blurred by a Gaussian along its normal.

    ``shift``: how deep the region's surface lies below the plane.
    """
    n = np.asarray(normal) / np.linalg.norm(normal)
    affine = np.diag([*SPACING, 1.0])
    affine[:3, 3] = -SPACING * 15
    index = np.stack(np.meshgrid(*[np.arange(31.0)] * 3, indexing="ij"), axis=-1)
    height = (index * SPACING + affine[:3, 3]) @ n  # above the plane
    hu, above = np.full(height.shape, outside), outside
    for value, depth in layers:
        hu = hu + (value - above) * special.ndtr((-depth - height) / blur)
        above = value
    distance = (height + shift).transpose(2, 1, 0)
    region = Region(distance < 0, distance.astype(np.float32), affine)
    return Volume(hu.transpose(2, 1, 0).astype(np.float32), affine), region, n


def along(normal: Floats, heights: Floats) -> Floats:
    return heights[:, None] * normal


def width(normal: Floats) -> float:
    return float(np.abs(normal * SPACING).sum())


def hu_of(fold: Folding, points: Floats) -> Floats:
    return fold.hu(points) + fold.correction(points)


@pytest.mark.parametrize("normal", NORMALS)
def test_a_straight_edge_gets_its_own_hu_up_to_the_surface(normal: Floats, device: Device) -> None:
    volume, region, n = scan([(1200.0, 0.0)], -100.0, normal, 0.25 * width(np.array(normal) / np.linalg.norm(normal)))
    points = along(n, np.linspace(-4.0, 0.0, 41))
    for fold in (folding(volume, region, points), folding(volume, region, points, device)):
        assert fold.hu(points)[-1] == pytest.approx(550, abs=25)  # half and half
        np.testing.assert_allclose(hu_of(fold, points), 1200, atol=30)
        just_outside = along(n, np.array([0.2, 0.4]))
        np.testing.assert_allclose(hu_of(fold, just_outside), 1200, atol=30)


def test_host_and_device_agree(device: Device) -> None:
    volume, region, _ = scan([(900.0, 0.0), (150.0, 1.2)], -50.0, np.array(NORMALS[2]), 0.6)
    points = np.random.default_rng(0).uniform(-5, 5, (500, 3))
    here, there = (folding(volume, region, points, where).correction(points) for where in (None, device))
    np.testing.assert_allclose(here, there, atol=0.05)


def test_nothing_changes_out_of_reach() -> None:
    volume, region, n = scan([(1200.0, 0.0)], -100.0, np.array(NORMALS[2]), 0.5)
    reach = REACH * width(n)
    points = along(n, np.array([-1.01 * reach, -2 * reach, 1.01 * reach, 2 * reach]))
    assert np.array_equal(folding(volume, region, points).correction(points), np.zeros(4))


@pytest.mark.parametrize(
    ("thickness", "within", "as_it_lies"), [(0.8, 0.05, 0.14), (1.5, 0.01, 0.1), (3.0, 0.01, 0.06)]
)
def test_a_thin_layer_keeps_what_the_scan_holds_of_it(thickness: float, within: float, as_it_lies: float) -> None:
    """A cortex of 2 to 7.5 standard deviations of the blur: HU integrated over the inside, folded and as they lie."""
    volume, region, n = scan([(1500.0, 0.0), (200.0, thickness)], 0.0, np.array(NORMALS[0]), 0.4)
    heights = np.linspace(-6.0, 0.0, 1201)
    points, true = along(n, heights), 1500 * thickness + 200 * (6.0 - thickness)
    fold = folding(volume, region, points)
    assert np.trapezoid(hu_of(fold, points), heights) == pytest.approx(true, rel=within)
    assert np.trapezoid(fold.hu(points), heights) < (1 - as_it_lies) * true


def test_skin_that_is_cut_too_deep_does_not_become_bone() -> None:
    """At -200 HU the surface of a head in air lies inside the skin: half of it is left out, and is not made up for."""
    volume, region, n = scan([(50.0, 0.0)], -1000.0, np.array(NORMALS[0]), 0.6, shift=0.45)
    points = along(n, np.linspace(-4.0, -0.45, 30))
    found = hu_of(folding(volume, region, points), points)
    assert folding(volume, region, points).hu(points)[-1] > -250
    assert found.max() < 60 and found.min() > 0


def test_a_neighbour_across_a_gap_takes_nothing_away() -> None:
    volume, region, n = scan([(900.0, 0.0)], 0.0, np.array(NORMALS[0]), 0.4)
    k, j, i = np.nonzero(region.distance_mm > 1.1)
    volume.hu[k, j, i] = 1500.0  # begins within the reach
    points = along(n, np.linspace(-3.0, 0.0, 31))
    assert folding(volume, region, points).correction(points).min() >= 0


def test_row_ends_of_a_lattice_are_of_the_body() -> None:
    volume, region, _ = scan([(1200.0, 0.0)], -100.0, np.array(NORMALS[0]), 0.25)
    for treatment, expected in (("fold", 1200), ("none", 550)):
        lattice = control_lattice(volume, region, (5, 4, 4), smoothing=0, partial_volume=treatment)
        np.testing.assert_allclose(lattice.points[-1, ..., 3], expected, atol=40)
        np.testing.assert_allclose(lattice.points[:3, ..., 3], 1200, atol=1)
    with pytest.raises(InputError, match="fold or none"):
        control_lattice(volume, region, (5, 4, 4), partial_volume="mirror")


def test_one_slice_is_folded_within_its_plane() -> None:
    """A section has no neighbours along its axis: the normal lies in it."""
    volume, region, _ = scan([(1200.0, 0.0)], -100.0, np.array(NORMALS[0]), 0.25)
    flat = Volume(volume.hu[15:16].copy(), volume.affine)
    section = Region(region.mask[15:16], region.distance_mm[15:16], volume.affine)
    y = volume.affine[1, 3] + 15 * SPACING[1]
    points = np.stack([np.linspace(-3, 0, 16), np.full(16, y), np.full(16, volume.affine[2, 3])], axis=1)
    fold = folding(flat, section, points)
    np.testing.assert_allclose(hu_of(fold, points), 1200, atol=30)


def test_what_is_no_treatment_is_refused() -> None:
    with pytest.raises(InputError, match="fold or none, got 'mirror'"):
        check_treatment("mirror")
