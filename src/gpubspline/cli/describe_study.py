"""What the command line says of a convergence study: a table, limits and orders, and what the stress is."""

import textwrap
from itertools import pairwise
from typing import Any

from gpubspline.analysis.convergence import QUANTITIES, Convergence
from gpubspline.analysis.richardson import Extrapolation

_UNITS = {"max_von_mises_mpa": "MPa", "p99_von_mises_mpa": "MPa", "max_displacement_mm": "mm"}
_HEADS = ("elements", "unknowns", "stress MPa", "change", "99 % MPa", "moved mm", "energy N mm", "s", "MiB")


def study_lines(found: Convergence) -> list[str]:
    """Give a row a model, then the limits."""
    first = found.models[0]
    case = first["load_case"]
    rows = [_HEADS, *(_row(found, number) for number in range(len(found.models)))]
    widths = [max(len(row[column]) for row in rows) for column in range(len(_HEADS))]
    table = ["  ".join(text.rjust(width) for text, width in zip(row, widths, strict=True)) for row in rows]
    width = max(len(label) for label in QUANTITIES.values())
    limits = [f"{label:{width}}  {_limit(name, found)}" for name, label in QUANTITIES.items()]
    how = f"{first['element_type']}, {first['formulation']}, modulus {first['modulus']}"
    return [
        f"load       {case['name']}" + (f": {case['title']}" if case["title"] else ""),
        f"elements   {how}",
        *table,
        *limits,
        f"stress     {_course(found)}; the last refinement changes it by {100 * found.last_change:.2f} %",
        *textwrap.wrap(f"it is the {first['max_von_mises_is']}", 118),
    ]


def _course(found: Convergence) -> str:
    """From which mesh on the stress goes one way only, which is what tells a limit from scatter."""
    models = found.models
    ways = [low["max_von_mises_mpa"] < high["max_von_mises_mpa"] for low, high in pairwise(models)]
    way, first = "rises" if ways[-1] else "falls", found.monotone_from()
    if first == models[0]["elements"]:
        return f"{way} with every refinement"
    if first == models[-2]["elements"]:
        return f"goes up and down, last it {way}"
    return f"goes up and down at first, {way} with every refinement from {first:,} elements on"


def _row(found: Convergence, number: int) -> tuple[str, ...]:
    model = found.models[number]
    return (
        f"{model['elements']:,}",
        f"{model['unknowns']:,}",
        f"{model['max_von_mises_mpa']:.4g}",
        f"{100 * found.changes['max_von_mises_mpa'][number]:+.2f} %",
        f"{model['p99_von_mises_mpa']:.4g}",
        f"{model['max_displacement_mm']:.4g}",
        f"{model['strain_energy_nmm']:.5g}",
        f"{model['seconds']:.1f}",
        f"{model['peak_memory_mb']:.0f}",
    )


def _limit(name: str, found: Convergence) -> str:
    limit: Extrapolation = found.limits[name]
    if limit.order is None or limit.limit is None:
        return f"no limit: {limit.note}" if limit.limit is None else limit.note
    off = found.models[-1][name] / limit.limit - 1 if limit.limit else 0.0
    unit = _UNITS.get(name, "N mm")
    return f"limit {limit.limit:.4g} {unit}, order {limit.order:.2f}; the finest mesh is off it by {100 * off:+.2f} %"


def reproduced_lines(numbers: dict[str, Any]) -> list[str]:
    """Give what the paper judges its meshes by, beside what they are here, and the study's last steps."""
    models = {m["name"]: m for part in numbers["figures"].values() for m in part.get("models", ())}
    lines = []
    for model in models.values():
        paper = model["paper"]["percent_above_0.5"]
        words = f"{model['elements']:,} elements, {model['percent_above_0.5']:.1f} % above 0.5"
        words += f" (paper {paper} %)" if paper else ""
        lines.append(f"{model['title']:26} {words}, {model['inverted']} inverted")
    study = numbers["figures"].get("fig13", {}).get("study")
    if study:
        lines.append(
            f"{'study, Fig. 13':26} {len(study['models'])} models to {study['reference_elements']:,} elements, last "
            f"step {100 * study['last_change_of_max_von_mises']:.2f} % (paper 0.5 %), in one direction from "
            f"{study['max_von_mises_monotone_from_elements']:,} on"
        )
    return lines
