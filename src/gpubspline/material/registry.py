"""The published laws that come with the package, and a user's own from a TOML file of the same schema.

A file holds one table per law::

    [my-femur]
    title = "Our femur, calibrated with the phantom of May"
    site = "proximal femur"                              # optional, as are citation, notes and unconfirmed
    citation = "Morgan, Bayraktar, Keaveny, J Biomech 36 (2003) 897-904"
    unconfirmed = ["Poisson's ratio"]
    direction = "axial"                                  # optional, as are the next two
    strain_rate_per_s = 0.005
    specimens_g_cm3 = [0.26, 0.75]                       # densities it was measured at

    [my-femur.density]                                   # rho = slope * HU + intercept, g/cm3, never below 0
    kind = "apparent"                                    # or "ash" or "QCT"
    slope_g_cm3_per_hu = 0.00116                         # or points = [[HU, g/cm3], [HU, g/cm3], ...]
    intercept_g_cm3 = 0.0
    source = "calibration phantom"                       # or, for all four, chain = ["eq-3.7", "ash-from-apparent"]:
                                                         # steps of conversions.toml, the first from HU

    [[my-femur.pieces]]                                  # E = factor * rho**exponent + offset, once or more
    hu = [100.0, 1500.0]                                 # lower <= HU < upper; or density_g_cm3 = [lower, upper]
    factor_mpa = 6850.0
    exponent = 1.49
    rate_exponent = 0.06                                 # optional: times strain_rate_per_s**rate_exponent
    offset_mpa = 0.0                                     # optional, 0
    poisson = 0.3
"""

from collections.abc import Mapping
from functools import lru_cache
from importlib import resources
from math import inf, isfinite
from pathlib import Path
from types import MappingProxyType
from typing import Any

from gpubspline.errors import InputError
from gpubspline.material.density import DensityRelation, conversion, first_step
from gpubspline.material.laws import Law, Piece, constant_law
from gpubspline.tables import checked, pair, parse, read_text

DEFAULT_LAW = "wirtz-2000"
"""Eqs 3.6 and 3.7 of the paper."""

_CONSTANT = "constant:E=...,nu=...[,rho=...]"


@lru_cache(maxsize=1)
def laws() -> Mapping[str, Law]:
    """Read the registry: every law that comes with the package, by name."""
    text = resources.files("gpubspline.material").joinpath("registry.toml").read_text(encoding="utf-8")
    return MappingProxyType(read_laws(text, "the registry"))


def law(name: str | Path = DEFAULT_LAW) -> Law:
    """Find a law by its name in the registry, or read it from a TOML file that holds exactly one.

    Arguments
    ---------
    name: a name of ``laws()``; the path of a file that ends in ``.toml`` (schema: this module's docstring); or
        ``"constant:E=110000,nu=0.3,rho=4.43"``, MPa and g/cm3, of which ``rho`` may be left out: then the density is
        that of the HU by the default law.

    Raises
    ------
    InputError where there is no such law or file, or the file holds anything but one law.
    """
    if is_constant(name):
        return _constant(str(name))
    if isinstance(name, Path) or name.lower().endswith(".toml"):
        return _law_of_file(Path(name))
    if name not in laws():
        known = ", ".join(laws())
        raise InputError(f"expected a material law of {known}, a .toml file or {_CONSTANT}, got {name!r}")
    return laws()[name]


def is_constant(name: str | Path) -> bool:
    """Whether a text asks for one modulus, whatever the HU."""
    return isinstance(name, str) and name.partition(":")[0].strip().lower() == "constant"


def _constant(text: str) -> Law:
    given: dict[str, float] = {}
    for part in text.partition(":")[2].split(","):
        key, _, value = (each.strip() for each in part.partition("="))
        try:
            number = float(value)
        except ValueError:
            number = inf
        if key not in ("E", "nu", "rho") or key in given or not isfinite(number):
            raise InputError(f"expected {_CONSTANT} (MPa, g/cm3), got {text!r}")
        given[key] = number
    if not {"E", "nu"} <= given.keys():
        raise InputError(f"expected {_CONSTANT} (MPa, g/cm3), got {text!r}")
    return constant_law(given["E"], given["nu"], given.get("rho"), density=laws()[DEFAULT_LAW].density)


def _law_of_file(path: Path) -> Law:
    found = list(read_laws(read_text(path, "material law"), path.name).values())
    if len(found) != 1:
        raise InputError(f"expected exactly one material law in {path.name}, got {len(found)}")
    return found[0]


def read_laws(text: str, source: str) -> dict[str, Law]:
    """Read the laws of a TOML text by name.

    Arguments
    ---------
    text: TOML of the schema in this module's docstring.
    source: what to call the text in an error.

    Raises
    ------
    InputError, one line that names the law and the key, for what is not TOML or not of the schema.
    """
    return {name: _law(name, table, f"{name!r} in {source}") for name, table in parse(text, source).items()}


def _law(name: str, table: Any, where: str) -> Law:
    fields = checked(
        table,
        f"the law {where}",
        required={"title": str, "density": dict, "pieces": list},
        optional={
            "site": str,
            "direction": str,
            "strain_rate_per_s": float,
            "specimens_g_cm3": list,
            "citation": str,
            "unconfirmed": list,
            "notes": str,
        },
    )
    try:
        density, rate = read_density(fields.pop("density")), fields.get("strain_rate_per_s")
        pieces = tuple(
            _piece(piece, number, density, rate) for number, piece in enumerate(fields.pop("pieces"), start=1)
        )
        unconfirmed = tuple(str(part) for part in fields.pop("unconfirmed", ()))
        if "specimens_g_cm3" in fields:
            fields["specimens_g_cm3"] = pair(fields["specimens_g_cm3"], "specimens_g_cm3")
        return Law(name, density=density, pieces=pieces, unconfirmed=unconfirmed, **fields)
    except InputError as error:
        raise InputError(f"the law {where}: {error}") from None


def read_density(table: Any) -> DensityRelation:
    """Read the table ``[density]`` of a law; raises InputError where it is not of the schema."""
    fields = checked(
        table,
        "[density]",
        required={"kind": str},
        optional={
            "points": list,
            "slope_g_cm3_per_hu": float,
            "intercept_g_cm3": float,
            "source": str,
            "chain": list,
        },
    )
    if sum(key in fields for key in ("points", "slope_g_cm3_per_hu", "chain")) != 1:
        raise InputError(
            "expected either points, slope_g_cm3_per_hu or chain in [density], got none of them or several"
        )
    if "chain" in fields:
        return _chain(fields.pop("chain"), **fields)
    if "points" not in fields:
        return DensityRelation(**fields)
    if "intercept_g_cm3" in fields:
        raise InputError("expected points alone in [density], got an intercept_g_cm3 beside them")
    points = tuple(pair(point, "a point of [density]") for point in fields.pop("points"))
    return DensityRelation.from_points(points=points, **fields)


def _chain(names: list[Any], kind: str, **others: Any) -> DensityRelation:
    if others or not names:
        raise InputError(f"expected kind and chain alone in [density], got {', '.join(others) or 'an empty chain'}")
    found = first_step(str(names[0]))
    for name in names[1:]:
        step = conversion(str(name))
        found = found.then(step if step.takes == found.kind else step.reversed())
    if found.kind != kind:
        raise InputError(f"expected a chain to the density {kind}, got {' -> '.join(map(str, names))}: {found.kind}")
    return found


def _at_rate(rate_per_s: float, exponent: float, number: int) -> float:
    """Factor of a strain rate; raises InputError where it is no positive number."""
    try:
        factor = rate_per_s**exponent if rate_per_s > 0 else 0.0
    except OverflowError:
        factor = 0.0
    if not factor > 0:
        got = f"{rate_per_s:g}^{exponent:g}"
        raise InputError(f"expected a positive strain_rate_per_s and its power in piece {number}, got {got}")
    return factor


def _piece(table: Any, number: int, density: DensityRelation, rate: float | None) -> Piece:
    fields = checked(
        table,
        f"piece {number}",
        required={"factor_mpa": float, "exponent": float, "poisson": float},
        optional={"hu": list, "density_g_cm3": list, "offset_mpa": float, "rate_exponent": float},
    )
    if ("hu" in fields) == ("density_g_cm3" in fields):
        raise InputError(f"expected either hu or density_g_cm3 in piece {number}, got both or neither")
    if "hu" in fields:
        lower, upper = pair(fields.pop("hu"), f"hu of piece {number}")
    else:
        ends = pair(fields.pop("density_g_cm3"), f"density_g_cm3 of piece {number}")
        lower, upper = (density.hu(end) for end in ends)
    if "rate_exponent" in fields:
        if rate is None:
            raise InputError(f"expected a strain_rate_per_s for the rate_exponent of piece {number}, got none")
        fields["factor_mpa"] *= _at_rate(rate, fields.pop("rate_exponent"), number)
    return Piece(lower, upper, **fields)
