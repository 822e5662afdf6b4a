"""Figures of a run as rows of words: names with units from the keys of the summary, numbers to four digits."""

import math
from collections.abc import Sequence
from typing import Any

from gpubspline.material.alarms import mass_words

UNITS = {
    "nmm": "N mm",
    "mm3": "mm³",
    "mm2": "mm²",
    "g_cm3": "g/cm³",
    "mpa": "MPa",
    "n_mm": "N/mm",
    "mm": "mm",
    "hu": "HU",
    "kg": "kg",
    "g": "g",
    "n": "N",
    "s": "s",
}
"""Endings of keys and the units that they are."""

ELSEWHERE = (
    "scaled_jacobian",
    "law",
    "law_by_label",
    "seconds",
    "nodes",
    "elements",
    "element_type",
    "regions",
    "alarms",
    "lost_features",
    "attempts",
)
"""Keys that have a section of their own, and what only the summary tells."""


PARTIAL_VOLUME = {"fold": "folded back in", "none": "as it lies"}


def figure_rows(figures: dict[str, Any]) -> list[tuple[str, str]]:
    """Name and value of every figure that is known and has no section of its own."""
    alarms = figures.get("alarms") or {}
    taken = [*ELSEWHERE, *(["mass_g", "mass_density", "out_of_range_nodes"] if alarms else [])]
    rows = [row for key, value in figures.items() if key not in taken for row in _rows(*_unit_of(key), value)]
    return rows + _label_rows(figures.get("law_by_label") or []) + alarm_rows(alarms)


def _label_rows(parts: Sequence[dict[str, Any]]) -> list[tuple[str, str]]:
    """Name and material of every label that has a law of its own, and of the rest."""
    rows = []
    for part in parts:
        name = f"material of the set {part['set']}" if part["label"] else "material of the rest"
        e, mass = part["modulus_mpa"], part["mass_g"]
        span = number(e["min"]) if e["min"] == e["max"] else f"{number(e['min'])} to {number(e['max'])}"
        weight = "" if mass is None else f", {number(mass)} g"
        if weight and part.get("mass_by_law_g", mass) != mass:
            weight += f" ({number(part['mass_by_law_g'])} g by its law's {part['density']} density)"
        rows.append((name, f"{part['law']['name']}, {number(part['elements'])} elements, E {span} MPa{weight}"))
    return rows


def alarm_rows(alarms: dict[str, Any]) -> list[tuple[str, str]]:
    """Name and value of the counts of a mapping, of ``Alarms.to_dict``: shares in percent, masses in g."""
    of, soft = alarms.get("of", "nodes"), alarms.get("near_zero_mpa", 0)
    shares = {
        "outside the law": alarms.get("outside_law"),
        "density of no specimen": alarms.get("beyond_specimens"),
        f"modulus below {soft:g} MPa": alarms.get("near_zero_modulus"),
    }
    rows = [("mapping", str(alarms["mapping"]))] if alarms.get("mapping") else []
    rows += [(name, f"{100 * share:.3g} % of the {of}") for name, share in shares.items() if share is not None]
    mass = alarms.get("mass_g") or {}
    if mass.get("mesh") is not None:
        rest = "" if mass.get("voxels") is None else f", of the voxels {number(mass['voxels'])} g: "
        off = "" if mass.get("difference") is None else f"{100 * mass['difference']:+.3g} %"
        rows.append(("mass of the mesh", f"{number(mass['mesh'])} g{rest}{off}"))
        rows += [("masses are", mass_words(mass))] if mass.get("density") else []
    if alarms.get("partial_volume"):
        rows.append(("partial volume at the surface", PARTIAL_VOLUME[alarms["partial_volume"]]))
    if alarms.get("surface_depth_mm"):
        rows.append(("surface read at a depth of", f"{number(alarms['surface_depth_mm'])} mm"))
    order = alarms.get("order_difference")
    if order:
        rows.append(("element-hu from element-e", f"{order['mean']:.2%} on average, {order['max']:.2%} at most"))
    return rows


def _rows(name: str, unit: str, value: Any) -> list[tuple[str, str]]:
    if value is None or value == [] or value == {}:
        return []
    if isinstance(value, dict):
        known = {key: part for key, part in value.items() if part is not None and part != ""}
        if known and all(isinstance(part, int | float) and not isinstance(part, bool) for part in known.values()):
            parts = [(*_unit_of(key), number(part)) for key, part in known.items()]
            return [(name, _with_unit(", ".join(_with_unit(f"{w} {v}", u) for w, u, v in parts), unit))]
        return [row for key, part in known.items() for row in _rows(*_nested(name, key), part)]
    if isinstance(value, list):
        if any(isinstance(part, dict) for part in value):
            return [
                (f"{name} {place}", "; ".join(f"{_unit_of(k)[0]} {_told(v, _unit_of(k)[1])}" for k, v in part.items()))
                for place, part in enumerate(value, start=1)
                if isinstance(part, dict)
            ]
        return [(name, _told(value, unit))]
    return [(name, _told(value, unit))]


def _nested(name: str, key: str) -> tuple[str, str]:
    words, unit = _unit_of(key)
    return f"{name}: {words}", unit


def _told(value: Any, unit: str) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{_unit_of(key)[0]} {_told(part, _unit_of(key)[1] or unit)}" for key, part in value.items())
    if isinstance(value, list | tuple):
        return _with_unit(vector(value), unit)
    return _with_unit(number(value), unit if isinstance(value, int | float) else "")


def vector(values: Sequence[Any]) -> str:
    """Write numbers beside each other; what is nothing beside the greatest of them is 0."""
    sizes = [abs(value) for value in values if isinstance(value, int | float)]
    least = 1e-5 * max(sizes, default=0.0)
    kept = [0.0 if isinstance(value, float) and abs(value) < least else value for value in values]
    return "(" + ", ".join(number(value) for value in kept) + ")"


def _with_unit(text: str, unit: str) -> str:
    return f"{text} {unit}".strip()


def _unit_of(key: str) -> tuple[str, str]:
    """Words of a key, and its unit."""
    for ending, unit in UNITS.items():
        if key == ending:
            return _words(key), unit
        if key.endswith(f"_{ending}"):
            return _words(key.removesuffix(f"_{ending}")), unit
    return _words(key), ""


def _words(key: str) -> str:
    words = key.replace("_", " ")
    return {
        "hu": "HU",
        "modulus": "Young's modulus",
        "jacobian determinant": "Jacobian determinant",
        "euler": "Euler number",
        "topology": "other topology",
        "max von mises monotone from elements": "the maximum goes one way only from, elements",
    }.get(words, words)


def number(value: Any) -> str:
    """Write whole numbers with commas, others to four digits; texts stay."""
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if not isinstance(value, int | float):
        return str(value)
    if isinstance(value, int):
        return f"{value:,}"
    if not math.isfinite(value):
        return str(value)
    if value == 0 or 1e-3 <= abs(value) < 1e7:
        digits = 0 if abs(value) >= 1000 else 4 - max(1, 1 + math.floor(math.log10(abs(value)))) if value else 0
        text = f"{value:,.{max(digits, 0)}f}"
        return text.rstrip("0").rstrip(".") if "." in text else text
    return f"{value:.3e}"
