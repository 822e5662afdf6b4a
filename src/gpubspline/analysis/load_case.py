"""Load cases: supports, forces, pressures and gravity, each on a region of the surface, from a TOML file.

Units are N, mm and MPa. A file holds one load case::

    title = "A block pulled and pressed"
    source = "where it comes from"                       # optional, as is all that is not marked as needed
    axes = "patient"                                     # of every vector, see below
    away_mm = 5.0                                        # or away_of_width = 0.1: stress nearer than this to a support
                                                         # or a force is left out of the maximum
    averaged_mm = 3.0                                    # the maximum is that of means over balls of this radius

    landmarks = "F.mrk.json"                             # points of 3D Slicer (or .fcsv), beside the file: their names
                                                         # stand wherever centre_mm or point_mm does

    [regions.tip]                                        # where all that is given holds:
    side = "w1"                                          # face u0 to w1 of a structured mesh, node set, or "surface"
    sphere = { centre_mm = [0, 0, 90], radius_mm = 20 }
    box = { low_mm = [-10, -10, 80], high_mm = [10, 10, 95] }
    halfspace = { point_mm = [0, 0, 80], normal = [0, 0, 1] }     # the side that the normal points to
    patch = { point_mm = [0, 9, 90], radius_mm = 8 }     # nearest surface; or area_mm2
    cap = { towards = [0, 0, 1], depth_mm = 4 }          # outermost surface; or depth_of_width; within_deg = 45
                                                         # leaves out what faces further away than that

    [[fixed]]                                            # needed, once or more
    region = "w0"                                        # a region of the file, or what ``side`` takes
    components = "xyz"
    displacement_mm = [0, 0, 0]

    [[force]]                                            # the total, spread evenly over the region's area
    region = "tip"
    force_n = [0, 0, -100]

    [[pressure]]                                         # pushes into the body where positive
    region = "u1"
    pressure_mpa = 0.5

    [gravity]                                            # on the mesh's own density
    acceleration_mm_s2 = [0, 0, -9810]

Points are always in patient mm (LPS). Vectors and directions are along ``axes``: ``"patient"``, x to the left, y to the
back, z to the head; or those of a femur, x medial, y anterior, z superior: ``"left femur"``, ``"right femur"``, or
``"femur"``, which finds the side from where the head is.
"""

from collections.abc import Callable
from dataclasses import dataclass
from importlib import resources
from math import isfinite
from pathlib import Path
from typing import Any, TypeVar

from gpubspline.analysis.landmarks import read_landmarks
from gpubspline.analysis.regions import Box, Cap, HalfSpace, Part, Patch, Region, Side, Sphere, Vector
from gpubspline.errors import InputError
from gpubspline.tables import checked, is_a, parse, read_text

AXES = ("patient", "femur", "left femur", "right femur")
_SIZES = ("away_mm", "away_of_width", "averaged_mm")
Item = TypeVar("Item")


@dataclass(frozen=True)
class Support:
    """Nodes of a region held along some axes, at rest or moved, mm."""

    region: Region
    components: tuple[bool, bool, bool] = (True, True, True)
    displacement_mm: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Force:
    """A total force, N, spread evenly over the area of a region."""

    region: Region
    force_n: Vector


@dataclass(frozen=True)
class Pressure:
    """A pressure, MPa, on a region, into the body where positive."""

    region: Region
    pressure_mpa: float


@dataclass(frozen=True)
class LoadCase:
    """What holds and what moves a body.

    Attributes
    ----------
    name, title, source: what it is called, in short and in full, and where it comes from.
    supports: where they overlap, the later one's displacement holds.
    forces, pressures: on regions of the surface.
    gravity_mm_s2: acceleration, mm/s2, or None.
    axes: of all vectors, one of ``AXES``.
    away: how near to supports and forces stress is left out of the maximum: mm, or a share of the body's width where
        ``away_of_width``.
    averaged_mm: radius of the balls over which stress is averaged before its maximum is taken; 0 for none.
    """

    name: str
    supports: tuple[Support, ...]
    forces: tuple[Force, ...] = ()
    pressures: tuple[Pressure, ...] = ()
    gravity_mm_s2: Vector | None = None
    axes: str = "patient"
    away: float = 0.0
    away_of_width: bool = False
    averaged_mm: float = 0.0
    title: str = ""
    source: str = ""

    def __post_init__(self) -> None:
        """Check that something is held, and something moves it."""
        if self.axes not in AXES:
            raise InputError(f"expected axes of {', '.join(AXES)}, got {self.axes!r}")
        if not self.supports:
            raise InputError("expected at least one support ([[fixed]]), got none")
        moved = any(any(support.displacement_mm) for support in self.supports)
        if not (self.forces or self.pressures or self.gravity_mm_s2 or moved):
            raise InputError("expected a force, a pressure, gravity or a displacement, got supports only")


def load_cases() -> tuple[str, ...]:
    """Names of the load cases that come with the package."""
    files = resources.files("gpubspline.analysis").iterdir()
    return tuple(sorted(file.name[:-5] for file in files if file.name.endswith(".toml")))


def load_case(name: str | Path) -> LoadCase:
    """Find a load case by its name, or read it from a file.

    Arguments
    ---------
    name: one of ``load_cases()``, or the path of a file that ends in ``.toml`` (schema: this module's docstring).

    Raises
    ------
    InputError, one line that names the key, where there is no such load case or the file does not follow the schema.
    """
    if isinstance(name, Path) or name.lower().endswith(".toml"):
        return read_load_case(read_text(Path(name), "load case"), Path(name).name, Path(name).parent)
    if name not in load_cases():
        raise InputError(f"expected a load case of {', '.join(load_cases())}, or a .toml file, got {name!r}")
    text = resources.files("gpubspline.analysis").joinpath(f"{name}.toml").read_text(encoding="utf-8")
    return read_load_case(text, name)


def read_load_case(text: str, name: str, folder: Path = Path()) -> LoadCase:
    """Read a load case from a TOML text (schema: this module's docstring); raises InputError as ``load_case``.

    ``folder``: where its landmarks lie.
    """
    try:
        return _case(parse(text, name), name, folder)
    except InputError as error:
        raise InputError(f"load case {name}: {error}") from None


def _case(tables: dict[str, Any], name: str, folder: Path) -> LoadCase:
    if isinstance(tables.get("landmarks"), str):
        tables = _placed(tables, read_landmarks(folder / tables["landmarks"]))
    texts = {"title": str, "source": str, "axes": str}
    lists = {"landmarks": str, "regions": dict, "fixed": list, "force": list, "pressure": list, "gravity": dict}
    given = checked(tables, "the file", {}, {**texts, **dict.fromkeys(_SIZES, float), **lists})
    regions = {key: _region(key, table) for key, table in given.get("regions", {}).items()}
    away, of_width = _one_of(given, "away_mm", "away_of_width", "the file") or (0.0, False)
    return LoadCase(
        name,
        _each(given, "fixed", lambda table, where: _support(table, where, regions)),
        _each(given, "force", lambda table, where: _force(table, where, regions)),
        _each(given, "pressure", lambda table, where: _pressure(table, where, regions)),
        _gravity(given["gravity"]) if "gravity" in given else None,
        away=away,
        away_of_width=of_width,
        averaged_mm=_positive(given["averaged_mm"], "averaged_mm of the file") if "averaged_mm" in given else 0.0,
        **{key: given[key] for key in texts if key in given},
    )


def _placed(table: Any, points: dict[str, Vector]) -> Any:
    """Put the coordinates of landmarks where their names stand."""
    if isinstance(table, list):
        return [_placed(each, points) for each in table]
    if not isinstance(table, dict):
        return table
    made = {key: _placed(value, points) for key, value in table.items()}
    for key in ("centre_mm", "point_mm"):
        if isinstance(made.get(key), str):
            if made[key] not in points:
                raise InputError(f"expected one of the landmarks {', '.join(points)} for {key}, got {made[key]!r}")
            made[key] = list(points[made[key]])
    return made


def _each(given: dict[str, Any], key: str, make: Callable[[Any, str], Item]) -> tuple[Item, ...]:
    return tuple(make(table, f"[[{key}]] {number}") for number, table in enumerate(given.get(key, ()), start=1))


def _support(table: Any, where: str, regions: dict[str, Region]) -> Support:
    given = checked(table, where, {"region": str}, {"components": str, "displacement_mm": list})
    letters = given.get("components", "xyz")
    if not letters or set(letters) - set("xyz"):
        raise InputError(f"expected letters of xyz for components in {where}, got {letters!r}")
    x, y, z = (letter in letters for letter in "xyz")
    at = _vector(given.get("displacement_mm", [0, 0, 0]), f"displacement_mm of {where}", zero=True)
    return Support(_find(given["region"], regions), (x, y, z), at)


def _force(table: Any, where: str, regions: dict[str, Region]) -> Force:
    given = checked(table, where, {"region": str, "force_n": list}, {})
    return Force(_find(given["region"], regions), _vector(given["force_n"], f"force_n of {where}"))


def _pressure(table: Any, where: str, regions: dict[str, Region]) -> Pressure:
    given = checked(table, where, {"region": str, "pressure_mpa": float}, {})
    if not isfinite(given["pressure_mpa"]):
        raise InputError(f"expected a finite pressure_mpa in {where}, got {given['pressure_mpa']}")
    return Pressure(_find(given["region"], regions), float(given["pressure_mpa"]))


def _gravity(table: Any) -> Vector:
    given = checked(table, "[gravity]", {"acceleration_mm_s2": list}, {})
    return _vector(given["acceleration_mm_s2"], "acceleration_mm_s2 of [gravity]")


def _find(name: str, regions: dict[str, Region]) -> Region:
    return regions.get(name) or Region(name, (Side(name),))


def _region(name: str, table: Any) -> Region:
    where = f"[regions.{name}]"
    given = checked(table, where, {}, {"side": str, **dict.fromkeys(_PARTS, dict)})
    if not given:
        raise InputError(f"expected side, {', '.join(_PARTS)} in {where}, got nothing")
    parts = [Side(value) if key == "side" else _PARTS[key](value, f"{key} of {where}") for key, value in given.items()]
    return Region(name, tuple(parts))


def _sphere(table: Any, where: str) -> Part:
    given = checked(table, where, {"centre_mm": list, "radius_mm": float}, {})
    centre = _vector(given["centre_mm"], f"centre_mm in {where}", zero=True)
    return Sphere(centre, _positive(given["radius_mm"], f"radius_mm in {where}"))


def _box(table: Any, where: str) -> Part:
    given = checked(table, where, {"low_mm": list, "high_mm": list}, {})
    low, high = (_vector(given[key], f"{key} in {where}", zero=True) for key in ("low_mm", "high_mm"))
    if any(a > b for a, b in zip(low, high, strict=True)):
        raise InputError(f"expected low_mm up to high_mm in {where}, got {list(low)} and {list(high)}")
    return Box(low, high)


def _halfspace(table: Any, where: str) -> Part:
    given = checked(table, where, {"point_mm": list, "normal": list}, {})
    point = _vector(given["point_mm"], f"point_mm in {where}", zero=True)
    return HalfSpace(point, _vector(given["normal"], f"normal in {where}"))


def _patch(table: Any, where: str) -> Part:
    given = checked(table, where, {"point_mm": list}, {"radius_mm": float, "area_mm2": float})
    point = _vector(given["point_mm"], f"point_mm in {where}", zero=True)
    size, is_area = _needed(given, "radius_mm", "area_mm2", where)
    return Patch(point, area_mm2=size) if is_area else Patch(point, radius_mm=size)


def _cap(table: Any, where: str) -> Part:
    sizes: dict[str, type] = {"depth_mm": float, "depth_of_width": float, "within_deg": float}
    given = checked(table, where, {"towards": list}, sizes)
    depth, of_width = _needed(given, "depth_mm", "depth_of_width", where)
    within = _positive(given["within_deg"], f"within_deg in {where}") if "within_deg" in given else None
    if within is not None and within > 180:
        raise InputError(f"expected at most 180 for within_deg in {where}, got {within:g}")
    return Cap(_vector(given["towards"], f"towards in {where}"), depth, of_width, within)


_PARTS: dict[str, Callable[[Any, str], Part]] = {
    "sphere": _sphere,
    "box": _box,
    "halfspace": _halfspace,
    "patch": _patch,
    "cap": _cap,
}


def _needed(given: dict[str, Any], first: str, second: str, where: str) -> tuple[float, bool]:
    found = _one_of(given, first, second, where)
    if found is None:
        raise InputError(f"expected {first} or {second} in {where}, got neither")
    return found


def _one_of(given: dict[str, Any], first: str, second: str, where: str) -> tuple[float, bool] | None:
    """Value of one of two keys, and whether it is the second's; None where neither is given."""
    if first in given and second in given:
        raise InputError(f"expected {first} or {second} in {where}, got both")
    key = second if second in given else first
    return (_positive(given[key], f"{key} in {where}"), key == second) if key in given else None


def _positive(value: float, where: str) -> float:
    if not (isfinite(value) and value > 0):
        raise InputError(f"expected a number above 0 for {where}, got {value}")
    return float(value)


def _vector(value: Any, where: str, zero: bool = False) -> Vector:
    if not (isinstance(value, list) and len(value) == 3 and all(is_a(v, float) and isfinite(v) for v in value)):
        raise InputError(f"expected three finite numbers for {where}, got {value!r}")
    x, y, z = (float(v) for v in value)
    if not zero and x == y == z == 0:
        raise InputError(f"expected a vector that is not zero for {where}")
    return x, y, z
