"""Calibrations: by hand, by rods of a made scan, by tissues of a made and of a real one."""

import warnings
from pathlib import Path

import numpy as np
import pytest
import SimpleITK as sitk
from numpy.typing import NDArray
from scipy import stats

from gpubspline.ct.image import read_volume
from gpubspline.ct.volume import Volume
from gpubspline.errors import GpubsplineWarning, InputError
from gpubspline.material.calibration_file import read_calibration
from gpubspline.material.registry import law

RODS = ((0.0, 8.0), (0.05, 70.0), (0.1, 135.0), (0.2, 262.0))  # g/cm3, HU
PLACES = ((10.0, 12.0, 9.0), (30.0, 12.0, 9.0), (10.0, 28.0, 9.0), (30.0, 28.0, 9.0))


def scan() -> tuple[Volume, NDArray[np.uint8]]:
    """Four rods of 6 mm radius along z with noise of 10 HU, and their labels."""
    affine = np.diag([0.8, 0.8, 2.0, 1.0])
    affine[:3, 3] = (-1.0, -2.0, 1.0)
    k, j, i = np.indices((9, 50, 55))
    x, y = 0.8 * i - 1, 0.8 * j - 2
    hu, labels = np.full(k.shape, -1000.0), np.zeros(k.shape, np.uint8)
    for number, ((_, value), place) in enumerate(zip(RODS, PLACES, strict=True), start=1):
        inside = (x - place[0]) ** 2 + (y - place[1]) ** 2 < 36
        hu[inside], labels[inside] = value, number
    hu += np.random.default_rng(2).normal(0, 10, hu.shape)
    return Volume(hu.astype(np.float32), affine), labels


def write(folder: Path, text: str) -> Path:
    path = folder / "calibration.toml"
    path.write_text('kind = "QCT"\nsource = "our phantom"\n' + text)
    return path


def by_places() -> str:
    rods = [
        f"[[rods]]\ndensity_g_cm3 = {density}\ncentre_mm = {list(place)}\nradius_mm = 4"
        for (density, _), place in zip(RODS, PLACES, strict=True)
    ]
    return "\n".join(rods)


def test_rods_as_places(tmp_path: Path) -> None:
    volume, _ = scan()
    found = read_calibration(write(tmp_path, by_places())).carry_out(volume)
    density, hu = np.array(RODS).T
    slope, intercept = np.linalg.lstsq(np.stack([hu, np.ones(4)], axis=1), density, rcond=None)[0]
    assert found.relation.slope_g_cm3_per_hu == pytest.approx(slope, rel=0.01)
    assert found.relation.intercept_g_cm3 == pytest.approx(intercept, abs=1e-3)
    for reference, value in zip(found.references, hu, strict=True):
        assert reference.hu == pytest.approx(value, abs=3) and reference.deviation_hu == pytest.approx(10, abs=2)
        assert reference.voxels > 100
        expected = slope * value + intercept - reference.density_g_cm3
        assert reference.residual_g_cm3 == pytest.approx(expected, abs=3e-3)
    assert found.rms_g_cm3 is not None and found.rms_g_cm3 < 4e-3
    assert sum(reference.residual_g_cm3 for reference in found.references) == pytest.approx(0, abs=1e-12)


def test_rods_as_a_mask(tmp_path: Path) -> None:
    volume, labels = scan()
    image = sitk.GetImageFromArray(labels)
    image.SetSpacing(volume.spacing_mm.tolist())
    image.SetOrigin(volume.affine[:3, 3].tolist())
    sitk.WriteImage(image, str(tmp_path / "rods.nii.gz"))
    rods = [f"[[rods]]\ndensity_g_cm3 = {density}\nlabel = {n}" for n, (density, _) in enumerate(RODS, start=1)]
    path = write(tmp_path, 'mask = "rods.nii.gz"\n' + "\n".join(rods))
    found = read_calibration(path).carry_out(volume)
    for reference, (_, value) in zip(found.references, RODS, strict=True):
        assert reference.hu == pytest.approx(value, abs=2)
    places = read_calibration(write(tmp_path, by_places())).carry_out(volume)
    assert found.relation.slope_g_cm3_per_hu == pytest.approx(places.relation.slope_g_cm3_per_hu, rel=0.01)


def test_line_and_table(tmp_path: Path) -> None:
    line = read_calibration(write(tmp_path, "slope_g_cm3_per_hu = 0.0008\nintercept_g_cm3 = -0.01")).carry_out(None)
    assert line.relation.density_g_cm3(500) == pytest.approx(0.39) and line.rms_g_cm3 is None
    table = read_calibration(write(tmp_path, "points = [[0, 0], [200, 0.19], [1200, 0.9]]")).carry_out(None)
    assert table.relation.density_g_cm3(100) == pytest.approx(0.095)
    assert table.relation.density_g_cm3(700) == pytest.approx(0.545)
    assert table.relation.source == "our phantom" and table.to_dict()["table"][1] == [200.0, 0.19]


def test_a_calibrated_law_says_so(tmp_path: Path) -> None:
    line = read_calibration(write(tmp_path, "slope_g_cm3_per_hu = 0.0008\nintercept_g_cm3 = -0.01")).carry_out(None)
    calibrated = law("keyak-1998").calibrated(line.relation)
    assert [step.name for step in calibrated.density.steps] == ["calibration", "ash-from-QCT"]
    # rho_QCT = 0.39, rho_ash = 0.877 * 0.39 + 0.079 = 0.42103: E = 5307 * 0.42103 + 469 = 2703.4 MPa
    (piece,) = (piece for piece in calibrated.pieces if piece.lower_hu <= 500 < piece.upper_hu)
    assert piece.modulus_mpa(calibrated.density.density_g_cm3(500)) == pytest.approx(2703.41, rel=1e-5)


TISSUES = "[tissues]\nair = {}\nfat = {}\nmuscle = {}\n"


def test_tissues_of_a_made_scan(tmp_path: Path) -> None:
    """Peaks at -990, -105 and 48 HU under noise of 12 HU, bone and air of the padding besides."""
    rng = np.random.default_rng(4)
    parts = ((-990.0, 20_000), (-105.0, 9_000), (48.0, 12_000), (400.0, 3_000), (-1024.0, 20_000))
    hu = np.concatenate([rng.normal(mean, 12 if mean > -1000 else 0, n) for mean, n in parts])
    volume = Volume(hu.reshape(64, 100, 10).astype(np.float32), np.eye(4))
    found = read_calibration(write(tmp_path, TISSUES)).carry_out(volume)
    assert [each.hu for each in found.references] == pytest.approx([-990, -105, 48], abs=3)
    assert found.relation.unconfirmed and "Eggermont" in found.relation.unconfirmed[0]
    slope, intercept = np.polyfit([-990, -105, 48], [-0.84, -0.08, 0.03], 1)
    assert found.relation.slope_g_cm3_per_hu == pytest.approx(slope, rel=0.01)
    assert found.relation.intercept_g_cm3 == pytest.approx(intercept, abs=5e-3)


def test_tissues_of_a_real_scan(data: Path, tmp_path: Path) -> None:
    volume = read_volume(data / "hips" / "example_ct.nii.gz")
    found = read_calibration(write(tmp_path, TISSUES)).carry_out(volume)
    air, fat, muscle = (each.hu for each in found.references)
    assert -1010 < air < -960 and -120 < fat < -80 and 15 < muscle < 80
    assert 0.0007 < found.relation.slope_g_cm3_per_hu < 0.001
    assert max(abs(each.residual_g_cm3) for each in found.references) < 0.02


def test_phantomless_is_the_file_of_three_tissues(data: Path, tmp_path: Path) -> None:
    volume = read_volume(data / "hips" / "example_ct.nii.gz")
    by_file, by_name = (read_calibration(path).carry_out(volume) for path in (write(tmp_path, TISSUES), "phantomless"))
    assert by_name.references == by_file.references and by_name.relation.kind == "QCT"
    assert "Eggermont et al. 2019" in by_name.relation.source and by_name.relation.unconfirmed


@pytest.mark.parametrize(
    ("scan", "words"),
    [
        ("head/ct_example.nii.gz", "a peak of fat between -180 and -20 HU"),  # hardly any, and what is there no peak
        ("dicom_tilt", "a peak of fat between -180 and -20 HU"),  # its HU rise all the way to the brain's
        ("vertebra/sub-ct_label-22_ct.nii.gz", "a peak of air between -1020 and -900 HU"),
    ],
)
def test_scans_without_the_tissues_are_refused(data: Path, scan: str, words: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", GpubsplineWarning)  # of the tilted series' spacing
        volume = read_volume(data / scan)
    with pytest.raises(InputError, match=words):
        read_calibration("phantomless").carry_out(volume)


def test_contrast_agent_is_asked_about(data: Path) -> None:
    """The abdomen's mode is of enhanced organs, 94 HU, which no muscle has."""
    volume = read_volume(data / "dicom_j2k")
    with pytest.warns(GpubsplineWarning, match=r"off a line by up to 0.017 .*muscle 94 HU\): contrast agent"):
        read_calibration("phantomless").carry_out(volume)


SLOPE, INTERCEPT = 0.00081, -0.012
HA = np.array([0.0, 0.05, 0.1, 0.2, 0.4, 0.8])
"""Density of the rods of a phantom below the patient, g/cm3 of hydroxyapatite."""


def with_rods(volume: Volume, rng: np.random.Generator) -> tuple[Volume, list[list[float]]]:
    """Put rods of 9 mm radius into the air below a patient: noise, cupping across, a beam harder inside dense rods."""
    hu = volume.hu.astype(np.float32)
    i, j = np.meshgrid(*(np.arange(n) for n in volume.shape[:2]), indexing="ij")
    places = []
    for number, density in enumerate(HA):
        centre = np.array([20.0 + 16 * number, 92.0])
        inside = np.hypot(i - centre[0], j - centre[1]).T * 3.0 < 9.0
        shading = 6.0 * (2 * number / (len(HA) - 1) - 1) * rng.choice([-1, 1]) + rng.normal(0, 3)
        value = (density - INTERCEPT) / SLOPE * (1 - 0.01 * density) + shading
        hu[:, inside] = value + rng.normal(0, 25, (len(hu), np.count_nonzero(inside)))
        places.append([float(x) for x in volume.to_points(np.array([*centre, len(hu) / 2]))])
    return Volume(hu, volume.affine), places


def test_rods_beside_a_real_patient_give_the_line_within_its_standard_errors(data: Path, tmp_path: Path) -> None:
    """Of 24 scans, Student's t of four rods to spare holds 95 % of slopes and intercepts."""
    volume = read_volume(data / "hips" / "example_ct.nii.gz")
    rng, off = np.random.default_rng(11), []
    for _ in range(24):
        scan, places = with_rods(volume, rng)
        rods = [
            f"[[rods]]\ndensity_g_cm3 = {density}\ncentre_mm = {place}\nradius_mm = 6"
            for density, place in zip(HA, places, strict=True)
        ]
        found = read_calibration(write(tmp_path, "\n".join(rods))).carry_out(scan)
        line = found.relation
        hu = np.array([each.hu for each in found.references])
        known = stats.linregress(hu, HA)
        assert found.slope_error_g_cm3_per_hu == pytest.approx(known.stderr)
        assert found.intercept_error_g_cm3 == pytest.approx(known.intercept_stderr)
        assert found.references[0].deviation_hu == pytest.approx(25, rel=0.2)
        off.append(
            [
                (line.slope_g_cm3_per_hu - SLOPE) / known.stderr,
                (line.intercept_g_cm3 - INTERCEPT) / known.intercept_stderr,
            ]
        )
    inside = np.abs(off) < stats.t.ppf(0.975, 4)
    assert (inside.mean(axis=0) > 0.8).all()
    assert (
        np.abs(line.slope_g_cm3_per_hu / SLOPE - 1) < 0.03
    )  # what cupping and hardening amount to, 12 + 8 of 1,000 HU
    text = f"slope_g_cm3_per_hu = {line.slope_g_cm3_per_hu!r}\nintercept_g_cm3 = {line.intercept_g_cm3!r}"
    later = read_calibration(write(tmp_path, text)).carry_out(volume)  # the same scanner's next patient, without rods
    assert law("keyak-1998").calibrated(later.relation).range_hu == law("keyak-1998").calibrated(line).range_hu
    for hu in (100.0, 700.0):
        assert later.relation.density_g_cm3(hu) == pytest.approx(SLOPE * hu + INTERCEPT, abs=0.01)
    bent = with_rods(volume, rng)[0].hu  # the patient is as he was
    np.testing.assert_array_equal(bent[:, :80], volume.hu[:, :80])


def test_tissues_by_places_and_numbers(tmp_path: Path) -> None:
    volume, _ = scan()
    text = (
        "[tissues]\nair = {hu = -1000, density_g_cm3 = -0.8}\nmuscle = {centre_mm = [10, 12, 9], density_g_cm3 = 0.01}"
    )
    found = read_calibration(write(tmp_path, text)).carry_out(volume)
    assert found.references[1].hu == pytest.approx(8, abs=3) and not found.relation.unconfirmed
    assert found.relation.density_g_cm3(8) == pytest.approx(0.01, abs=3e-3)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[[rods]]\ndensity_g_cm3 = 0.1\ncentre_mm = [0, 0, 0]", "at least two rods of known density .* got 1"),
        ("[[rods]]\ndensity_g_cm3 = 0.1", "either a label or a centre_mm for rod 1"),
        ("[[rods]]\ndensity_g_cm3 = 0.1\nlabel = 1\n[[rods]]\ndensity_g_cm3 = 0.2\nlabel = 2", "a mask for the rods"),
        ("[[rods]]\ndensity_g_cm3 = 0.1\ncentre_mm = [0, 0]", "three numbers, LPS mm, as centre_mm of rod 1"),
        ("[[rods]]\ndensity_g_cm3 = 0.1\ncentre_mm = [0, 0, 0]\nradius_mm = 0", "positive radius_mm of rod 1"),
        ("[[rods]]\ndensity_g_cm3 = 0.1\ncentre_mm = [nan, 0, 0]", "three numbers, LPS mm, as centre_mm of rod 1"),
        ("[[rods]]\ndensity_g_cm3 = inf\ncentre_mm = [0, 0, 0]", "a number for density_g_cm3 in rod 1 .* got inf"),
        ("[tissues]\nair = {hu = nan}\nfat = {hu = 1}", "a number for hu in air .* got nan"),
        ("slope_g_cm3_per_hu = -0.001", "rises with HU"),
        ("slope_g_cm3_per_hu = 0.001\npoints = []", "got 2 of them"),
        ("", "expected one of slope_g_cm3_per_hu, points, rods, tissues in the calibration calibration.toml, got 0"),
        ("points = [[0, 0], [100, 0.1]]\nmask = 'x.nii'", "mask with rods alone"),
        ("points = [[0, 0], [100, -0.1]]", "rises with HU"),
        ("[tissues]\nair = {}", "at least two of air, fat, muscle"),
        ("[tissues]\nair = {}\nbrain = {}", "'brain' which is unknown"),
        ("[tissues]\nair = {hu = 1, centre_mm = [0, 0, 0]}\nfat = {}", "either hu or centre_mm for air"),
        ("colour = 1", "'colour' which is unknown"),
    ],
)
def test_bad_files(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(InputError, match=message) as error:
        read_calibration(write(tmp_path, text))
    assert "\n" not in str(error.value)


def test_rods_far_from_any_scan(tmp_path: Path) -> None:
    """Places beyond what whole numbers hold are outside the scan, no warning of NumPy's."""
    rods = "".join(f"[[rods]]\ndensity_g_cm3 = {n}\ncentre_mm = [1e300, 0, {n}]\n" for n in (1, 2))
    with pytest.raises(InputError, match="rod 1 of the calibration inside the scan"):
        read_calibration(write(tmp_path, rods)).carry_out(scan()[0])


def test_bad_kind(tmp_path: Path) -> None:
    path = write(tmp_path, "slope_g_cm3_per_hu = 0.001")
    path.write_text(path.read_text().replace("QCT", "wet"))
    with pytest.raises(InputError, match=r"density kind of QCT, ash, apparent in the calibration .*, got 'wet'"):
        read_calibration(path)


def test_what_is_not_in_the_scan(tmp_path: Path) -> None:
    volume, _ = scan()
    calibration = read_calibration(write(tmp_path, by_places()))
    with pytest.raises(InputError, match="the CT to find the rods of the calibration in"):
        calibration.carry_out(None)
    outside = by_places().replace("[10.0, 12.0, 9.0]", "[500.0, 12.0, 9.0]")
    with pytest.raises(InputError, match=r"rod 1 of the calibration inside the scan, got \(500, 12, 9\) mm"):
        read_calibration(write(tmp_path, outside)).carry_out(volume)
    same = by_places()
    for density, _ in RODS:
        same = same.replace(f"density_g_cm3 = {density}\n", "density_g_cm3 = 0.5\n")
    with pytest.raises(InputError, match="at least two rods of different density and HU"):
        read_calibration(write(tmp_path, same)).carry_out(volume)
    with pytest.raises(InputError, match="a peak of fat between -180 and -20 HU"):
        read_calibration(write(tmp_path, TISSUES)).carry_out(volume)


def test_what_no_scan_or_bone_has_is_asked_about(tmp_path: Path) -> None:
    """Rods in another order than they were written down, and a line in mg/cm3."""
    volume, _ = scan()
    swapped = by_places().replace("density_g_cm3 = 0.1\n", "density_g_cm3 = 0.3\n")
    with pytest.warns(GpubsplineWarning, match=r"rod 3 .* denser than rod 4 \(0.3 and 0.2 g/cm3\) .* are they swapped"):
        read_calibration(write(tmp_path, swapped)).carry_out(volume)
    line = "slope_g_cm3_per_hu = {}\nintercept_g_cm3 = {}"
    for slope, intercept in ((0.8, -5.0), (0.00001, 0.0)):
        with pytest.warns(GpubsplineWarning, match=r"gives 1,000 HU .* g/cm3, which is no bone's QCT density"):
            read_calibration(write(tmp_path, line.format(slope, intercept))).carry_out(None)
    read_calibration(write(tmp_path, line.format(0.0008, -0.005))).carry_out(None)  # warnings are errors here
