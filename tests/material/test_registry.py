"""The registry and the user's own TOML file."""

from pathlib import Path

import pytest

from gpubspline.errors import InputError
from gpubspline.material.registry import DEFAULT_LAW, law, laws, read_laws

DENSITY = """
[mine.density]
kind = "ash"
slope_g_cm3_per_hu = 0.001
intercept_g_cm3 = -0.05
source = "rods"
"""
PIECE = """
[[mine.pieces]]
density_g_cm3 = [0.05, 0.95]
factor_mpa = 10000
exponent = 2
poisson = 0.3
"""
MINE = '[mine]\ntitle = "Mine"\nunconfirmed = ["site"]\n' + DENSITY + PIECE


def modulus_mpa(name: str, hu: float) -> float:
    """Young's modulus of a registered law at one HU."""
    found = laws()[name]
    (piece,) = (piece for piece in found.pieces if piece.lower_hu <= hu < piece.upper_hu)
    return piece.modulus_mpa(found.density.density_g_cm3(hu))


@pytest.mark.parametrize(
    ("name", "hu", "expected"),
    [
        # rho = 1.9 * 200 / 1630 = 0.233129 g/cm3, 1904 * 0.233129^1.64 (eqs 3.6 and 3.7)
        ("wirtz-2000", 200.0, 174.793),
        # rho = 1.9 g/cm3, 2065 * 1.9^3.09
        ("wirtz-2000", 1630.0, 15006.13),
        # rho = 0.95 g/cm3: 6850 * 0.95^1.49, 4730 * 0.95^1.56, 8920 * 0.95^1.83
        ("morgan-2003-femoral-neck", 815.0, 6345.981),
        ("morgan-2003-vertebra", 815.0, 4366.264),
        ("morgan-2003-pooled", 815.0, 8120.804),
        # rho_ash = 0.57, 0.1596 and 1.14 g/cm3: 5307 * 0.57 + 469, 33900 * 0.1596^2.2, 10200 * 1.14^2.01
        ("keyak-1998", 815.0, 3493.99),
        ("keyak-1998", 228.2, 598.2353),
        ("keyak-1998", 1630.0, 13273.300),
        # 3790 * 0.01^0.06 * 0.95^3; 1890 * 0.57^1.92; 1540 * 0.95 - 58
        ("carter-hayes-1977", 815.0, 2464.96),
        ("keller-1994-spine", 815.0, 642.31),
        ("keaveny-1997", 815.0, 1405.0),
        # rho = 0.95 g/cm3: 15010 * 0.95^2.18, 15520 * 0.95^1.93
        ("morgan-2003-greater-trochanter", 815.0, 13422.03),
        ("morgan-2003-proximal-tibia", 815.0, 14057.18),
        # rho = 0.233129 g/cm3: 1157 * 0.233129^1.78; rho = 1.9 g/cm3: 2314 * 1.9^1.57
        ("wirtz-2000-transverse", 200.0, 86.62719),
        ("wirtz-2000-transverse", 1630.0, 6338.792),
        # rho = 0.95 g/cm3: 1904 * 0.95^1.64, 1157 * 0.95^1.78, 2065 * 0.95^3.09, 2314 * 0.95^1.57
        ("wirtz-2000-cancellous-axial", 815.0, 1750.385),
        ("wirtz-2000-cancellous-transverse", 815.0, 1056.042),
        ("wirtz-2000-cortical-axial", 815.0, 1762.325),
        ("wirtz-2000-cortical-transverse", 815.0, 2134.958),
        # rho_ash = 0.57, rho_QCT = (0.57 - 0.079) / 0.877 = 0.559863: 3230 * 0.559863 - 34.7, 2980 * 0.559863^1.05
        ("kopperdahl-2002-linear", 815.0, 1773.658),
        ("kopperdahl-2002-power", 815.0, 1620.699),
    ],
)
def test_values_worked_by_hand(name: str, hu: float, expected: float) -> None:
    assert modulus_mpa(name, hu) == pytest.approx(expected, rel=1e-5)


def test_default_law_is_the_papers() -> None:
    paper = law()
    assert paper.name == DEFAULT_LAW == "wirtz-2000"
    assert paper.density.kind == "apparent"
    assert paper.density.density_g_cm3(1630.0) == pytest.approx(1.9, rel=1e-14)
    assert paper.range_hu == (100.0, 2000.0)
    assert [piece.poisson for piece in paper.pieces] == [0.3, 0.36]
    ((hu, below, above),) = paper.jumps()
    assert hu == 350.0
    assert (below, above) == pytest.approx((437.630, 129.354), rel=1e-5)


def test_only_the_stated_laws_jump() -> None:
    jumps = {name: found.jumps() for name, found in laws().items() if found.jumps()}
    assert list(jumps) == ["wirtz-2000", "wirtz-2000-transverse"]
    ((hu, below, above),) = jumps["wirtz-2000-transverse"]  # rho = 0.407975: 1157 rho^1.78, 2314 rho^1.57
    assert (hu, below, above) == pytest.approx((350.0, 234.564, 566.316), rel=1e-5)


def test_densities_and_rates_are_those_of_the_sources() -> None:
    for prefix, kind in (("kopperdahl", "QCT"), ("keyak", "ash"), ("keller", "ash"), ("morgan", "apparent")):
        assert {found.density.kind for name, found in laws().items() if name.startswith(prefix)} == {kind}
    assert laws()["carter-hayes-1977"].strain_rate_per_s == 0.01
    assert laws()["carter-hayes-1977"].pieces[0].factor_mpa == pytest.approx(3790 * 0.01**0.06)


def test_every_law_has_its_pedigree() -> None:
    for name, found in laws().items():
        assert found.name == name
        assert found.title and found.site and found.citation and found.density.source
        assert not found.jumps() or found.notes
        assert set(found.unconfirmed) < set(found.all_unconfirmed) or found.density.kind == "apparent"


def test_own_law_from_a_file(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(MINE)
    for name in (path, str(path)):
        mine = law(name)
        assert mine.name == "mine" and mine.unconfirmed == ("site",)
        assert (mine.density.kind, mine.density.source) == ("ash", "rods")
        assert mine.range_hu == pytest.approx((100.0, 1000.0))  # (0.05 + 0.05) / 0.001, (0.95 + 0.05) / 0.001
        assert mine.pieces[0].modulus_mpa(0.5) == 2500.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("= 0.3", "= 0.5"), "Poisson's ratio from 0 up to and without 0.5, got 0.5"),
        (("= 10000", "= -1"), "factor of 0 or more"),
        (("exponent = 2", "exponent = 0"), "exponent above 0"),
        (("exponent = 2", "exponent = inf"), "a number for exponent in piece 1, got inf"),
        (("exponent = 2", "exponent = true"), "expected a number for exponent in piece 1, got True"),
        (("exponent = 2", ""), "'exponent' missing"),
        (("exponent = 2", "exponent = 2\nyield = 3"), "'yield' which is unknown"),
        (("exponent = 2", "exponent = 2\nhu = [1, 2]"), "either hu or density_g_cm3"),
        (("exponent = 2", "exponent = 2\noffset_mpa = -100"), "positive modulus everywhere"),
        (("[0.05, 0.95]", "[0.95, 0.05]"), "range of HU that rises, got 1000 to 100"),
        (("[0.05, 0.95]", "[0.05]"), "two numbers in density_g_cm3 of piece 1"),
        (("[[mine.pieces]]", "[mine.pieces]"), "expected a list for pieces"),
        (('"ash"', '"wet"'), "density kind of QCT, ash, apparent, got 'wet'"),
        (("= 0.001", "= -0.001"), "density that rises with HU"),
        (("intercept", "points = [[0, 0], [1, 1]]\nintercept"), "either points, slope_g_cm3_per_hu or chain"),
        (("slope_g_cm3_per_hu = 0.001", "points = [[0, 0], [1, 1]]"), "points alone"),
        (("exponent = 2", "exponent = 2\nrate_exponent = 0.06"), "a strain_rate_per_s for the rate_exponent"),
        (('title = "Mine"', 'title = "Mine"\nstrain_rate_per_s = 0'), "positive strain rate"),
        (('title = "Mine"', 'title = "Mine"\nspecimens_g_cm3 = [0.7, 0.2]'), "densities of specimens that rise"),
        (('title = "Mine"', 'colour = "red"'), "'title' missing"),
        (("[mine]", "[mine"), "expected TOML in mine.toml"),
        (("[mine]", "x = 3\n[mine]"), "expected a table for the law 'x'"),
    ],
)
def test_bad_law_is_named_in_one_line(tmp_path: Path, change: tuple[str, str], message: str) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(MINE.replace(*change))
    with pytest.raises(InputError) as error:
        law(path)
    assert message in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("points", ["[[0, 0]]", "[[1, 0], [1, 1]]", "[[0, 0], [1, 'x']]", "[[0, 0], [1, 1], [2, 1]]"])
def test_bad_points(points: str) -> None:
    text = MINE.replace("slope_g_cm3_per_hu = 0.001\nintercept_g_cm3 = -0.05", f"points = {points}")
    with pytest.raises(InputError, match=r"points|two numbers|rises with HU"):
        read_laws(text, "text")


@pytest.mark.parametrize(("rate", "exponent"), [("-1.0", "0.06"), ("0", "-0.06"), ("0.01", "1e9"), ("0.01", "-1e9")])
def test_strain_rates_without_a_power(rate: str, exponent: str) -> None:
    text = MINE.replace('title = "Mine"', f'title = "Mine"\nstrain_rate_per_s = {rate}')
    with pytest.raises(InputError, match=r"positive strain_rate_per_s and its power in piece 1, got .*\^"):
        read_laws(f"{text}rate_exponent = {exponent}\n", "text")


def test_overlapping_pieces() -> None:
    with pytest.raises(InputError, match="do not overlap in the law 'mine', got HU 100 to 1000 and 600 to 1050"):
        read_laws(MINE + PIECE.replace("0.95", "1.00").replace("0.05", "0.55"), "text")


def test_no_such_law(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"wirtz-2000, .*keaveny-1997, a \.toml file or constant:.*, got 'hooke'"):
        law("hooke")
    with pytest.raises(InputError, match="No such file"):
        law(tmp_path / "none.toml")
    two = tmp_path / "two.toml"
    two.write_text(MINE + MINE.replace("mine", "yours"))
    with pytest.raises(InputError, match=r"exactly one material law in two\.toml, got 2"):
        law(two)
    two.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="UTF-8"):
        law(two)
