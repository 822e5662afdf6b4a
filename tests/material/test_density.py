"""The chain HU -> QCT -> ash -> apparent: each step by hand, composed, and read backwards."""

import numpy as np
import pytest

from gpubspline.errors import InputError
from gpubspline.material.density import DensityRelation, Step, conversions, first_step
from gpubspline.material.registry import law, laws

SCANNER = DensityRelation("QCT", 0.0008, -0.01, "rods of our phantom")


def test_steps_by_hand() -> None:
    """Schileo 2008: rho_ash = 0.877 rho_QCT + 0.079, rho_ash / rho_app = 0.6; the paper's eq 3.7."""
    ash = SCANNER.to("ash")
    assert ash.density_g_cm3(500) == pytest.approx(0.877 * 0.39 + 0.079)  # rho_QCT = 0.0008 * 500 - 0.01 = 0.39
    assert SCANNER.to("apparent").density_g_cm3(500) == pytest.approx((0.877 * 0.39 + 0.079) / 0.6)
    assert first_step("eq-3.7").density_g_cm3(1630) == pytest.approx(1.9)
    assert first_step("eq-3.7").to("QCT").density_g_cm3(1630) == pytest.approx((0.6 * 1.9 - 0.079) / 0.877)


def test_a_chain_names_its_steps_and_sources() -> None:
    apparent = SCANNER.to("apparent")
    assert [step.name for step in apparent.steps] == ["ash-from-QCT", "ash-from-apparent, backwards"]
    assert apparent.source.startswith("rods of our phantom; Schileo")
    assert apparent.unconfirmed and all("coefficients" in what or "ratio" in what for what in apparent.unconfirmed)
    assert SCANNER.to("QCT") is SCANNER and not SCANNER.unconfirmed


@pytest.mark.parametrize("kind", ["ash", "apparent"])
def test_there_and_back(kind: str) -> None:
    back = SCANNER.to(kind).to("QCT")
    assert (back.slope_g_cm3_per_hu, back.intercept_g_cm3) == pytest.approx((0.0008, -0.01))


def test_a_table_goes_through_the_chain() -> None:
    table = DensityRelation.from_points("QCT", ((0.0, 0.0), (200.0, 0.2), (1000.0, 0.8)), "table").to("ash")
    hu = np.linspace(0, 1000, 41)
    expected = 0.877 * np.interp(hu, [0, 200, 1000], [0, 0.2, 0.8]) + 0.079
    assert [table.density_g_cm3(value) for value in hu] == pytest.approx(expected.tolist())
    assert [table.hu(value) for value in expected] == pytest.approx(hu.tolist())


def test_densities_are_never_negative() -> None:
    assert SCANNER.density_g_cm3(-1000) == 0.0


@pytest.mark.parametrize("name", sorted(laws()))
def test_calibrated_laws_keep_their_moduli_by_density(name: str) -> None:
    found = laws()[name]
    calibrated = found.calibrated(SCANNER)
    assert calibrated.density.kind == found.density.kind
    for old, new in zip(found.pieces, calibrated.pieces, strict=True):
        for before, after in ((old.lower_hu, new.lower_hu), (old.upper_hu, new.upper_hu)):
            density = found.density.density_g_cm3(before)
            assert calibrated.density.density_g_cm3(after) == pytest.approx(density)
            assert new.modulus_mpa(density) == old.modulus_mpa(density)
    assert "rods of our phantom" in calibrated.density.source
    assert len(calibrated.jumps()) == len(found.jumps())


def test_calibration_by_hand() -> None:
    """wirtz-2000 begins its second range at 1.9 * 350 / 1630 = 0.407975 g/cm3, here 0.6 of which are ash."""
    calibrated = law("wirtz-2000").calibrated(SCANNER)
    expected = ((0.6 * 1.9 * 350 / 1630 - 0.079) / 0.877 + 0.01) / 0.0008
    assert calibrated.pieces[1].lower_hu == pytest.approx(expected)


def test_bad_steps() -> None:
    with pytest.raises(InputError, match="step from the density QCT, got ash-from-apparent: apparent to ash"):
        SCANNER.then(conversions()["ash-from-apparent"])
    with pytest.raises(InputError, match="density kind of QCT, ash, apparent, got 'wet'"):
        SCANNER.to("wet")
    with pytest.raises(InputError, match="begin with a step from HU, got ash-from-QCT: QCT to ash"):
        first_step("ash-from-QCT")
    with pytest.raises(InputError, match=r"density step of eq-3\.7, ash-from-QCT, ash-from-apparent, got 'x'"):
        first_step("x")
    with pytest.raises(InputError, match="rises with ash, got rho = -1 ash"):
        Step("s", "ash", "apparent", -1.0)
    with pytest.raises(InputError, match="expected a step from HU or a density"):
        Step("s", "ash", "ash", 1.0)
    with pytest.raises(InputError, match="at least two points"):
        DensityRelation.from_points("ash", ((0.0, 0.0),))
