"""What the command line says of material laws and of what they made of a mesh: lines of text."""

import textwrap
from collections.abc import Sequence
from math import inf
from typing import TYPE_CHECKING, Any

from gpubspline.material.alarms import MASS_TOLERANCE, mass_advice, mass_words
from gpubspline.material.density import conversions
from gpubspline.material.laws import Law
from gpubspline.material.registry import DEFAULT_LAW
from gpubspline.report.tissues import ABOUT

if TYPE_CHECKING:  # the analysis is not loaded to list laws
    from gpubspline.analysis.law_comparison import LawOutcome
    from gpubspline.report.tissues import Tissue

_UNDER = 11 * " "


def law_lines(law: Law) -> list[str]:
    """Name, densities, formulas, ranges, jumps, source and what is unconfirmed of a material law."""
    lines = [f"{law.name}{' (default)' if law.name == DEFAULT_LAW else ''}: {law.title}"]
    about = [law.site, law.direction]
    if law.strain_rate_per_s is not None:
        about.append(f"at {law.strain_rate_per_s:g} per second")
    if law.specimens_g_cm3 is not None:
        about.append(f"specimens of {law.specimens_g_cm3[0]:g} to {law.specimens_g_cm3[1]:g} g/cm3")
    lines += [f"    {', '.join(filter(None, about))}"] if any(about) else []
    lines += density_lines(law)
    for piece in law.pieces:
        raised = "" if piece.exponent == 1 else f"^{piece.exponent:g}"
        power = f"{piece.factor_mpa:.6g} rho{raised}{_added(piece.offset_mpa)}"
        lines.append(f"    {piece.lower_hu:.0f} to {piece.upper_hu:.0f} HU: E = {power} MPa, nu = {piece.poisson:g}")
    for hu, below, above in law.jumps():
        lines.append(f"    jump: at {hu:g} HU the modulus {_verb(below, above)} from {below:.0f} to {above:.0f} MPa")
    lines.append(f"    {law.citation}")
    return [*lines, *(["    unconfirmed: " + "; ".join(law.all_unconfirmed)] if law.all_unconfirmed else [])]


def _verb(below: float, above: float) -> str:
    return "falls" if above < below else "rises"


def density_lines(law: Law) -> list[str]:
    """What the density of a law comes to, and the names of its steps."""
    relation = law.density
    by = " by " + ", then ".join(step.name for step in relation.steps) if relation.steps else ""
    if relation.table:
        points = ", ".join(f"{density:.4g} at {hu:g} HU" for hu, density in relation.table)
        return [f"    rho {relation.kind}{by}, by a table: {points} g/cm3"]
    return [f"    rho {relation.kind} = {_line(relation.slope_g_cm3_per_hu, 'HU', relation.intercept_g_cm3)}{by}"]


def constant_lines() -> list[str]:
    """What may stand in the place of a law, and how labels get laws of their own."""
    return [
        "constant:E=MPA,nu=RATIO[,rho=G_CM3]: one modulus, whatever the HU",
        "    without rho of the density that the law of the rest, or the default one, gives the HU",
        "of a label of --labels alone: --law LABEL=LAW, once for each, beside --law LAW of the rest",
    ]


def step_lines() -> list[str]:
    """The steps that densities are made of, with their sources."""
    lines = ["density steps"]
    for step in conversions().values():
        lines.append(f"    {step.name}: {step.gives} = {_line(step.slope, step.takes, step.intercept)}; {step.source}")
        lines += [f"        unconfirmed: {what}" for what in step.unconfirmed]
    return lines


def _line(slope: float, takes: str, intercept: float) -> str:
    return f"{slope:.6g} {takes}{_added(intercept)} g/cm3"


def _added(value: float) -> str:
    return f" {'-' if value < 0 else '+'} {abs(value):.6g}" if value else ""


def material_lines(figures: dict[str, Any]) -> list[str]:
    """The material of a run: values, mapping, calibration, alarms, and what is unconfirmed of the law."""
    hu, modulus, law, alarms = figures["hu"], figures["modulus_mpa"], figures["law"], figures["alarms"]
    if law is None:
        return ["material   none: no CT was given (--ct)"]
    lines = [f"material   HU {hu['min']:.0f} to {hu['max']:.0f}, E {modulus['min']:.0f} to {modulus['max']:.0f} MPa"]
    lines += _calibration_lines(figures["calibration"]) if figures["calibration"] else []
    across = figures["transverse_law"]
    if across is not None:
        lines.append(f"orthotropic along w by the law {law['name']}, across it by {across['name']}")
    parts = figures.get("law_by_label") or []
    lines += _alarm_lines(alarms, law, figures.get("volume_mm3"), parts)
    for each in filter(None, [*([part["law"] for part in parts] or [law]), across]):
        if each["unconfirmed"]:
            lines += _wrapped(f"unconfirmed of the law {each['name']}: " + "; ".join(each["unconfirmed"]))
    return lines + (_wrapped(f"unconfirmed of the {across['orthotropy_unconfirmed']}") if across else [])


def _wrapped(text: str) -> list[str]:
    return textwrap.wrap(text, 119, initial_indent=_UNDER, subsequent_indent=_UNDER)


def tissue_lines(tissues: "Sequence[Tissue]") -> list[str]:
    """What each label of a preview would be meshed as."""
    rows = [tissue.words for tissue in tissues]
    widths = [max(len(row[column]) for row in rows) for column in range(3)]
    padded = ["  ".join(text.ljust(width) for text, width in zip(row, (*widths, 0), strict=True)) for row in rows]
    return [
        f"labels     {ABOUT}",
        *(f"{_UNDER}{line}".rstrip() for line in padded),
    ]


def _part_lines(parts: Sequence[dict[str, Any]]) -> list[str]:
    """What the law of each label makes of its elements."""
    lines = []
    for part in parts:
        e, of = part["modulus_mpa"], f"the set {part['set']}" if part["label"] else "the rest"
        span = f"{e['min']:.6g}" if e["min"] == e["max"] else f"{e['min']:.0f} to {e['max']:.0f}"
        weight = "" if part["mass_g"] is None else f", {part['mass_g']:.4g} g"
        if weight and part["mass_by_law_g"] != part["mass_g"]:
            weight += f" ({part['mass_by_law_g']:.4g} g by its law's {part['density']} density)"
        lines += _wrapped(f"{of}: {part['law']['name']}, {part['elements']:,} elements, E {span} MPa{weight}")
    return lines


def _alarm_lines(
    alarms: dict[str, Any], law: dict[str, Any], volume_mm3: dict[str, Any] | None, parts: Sequence[dict[str, Any]]
) -> list[str]:
    of, depth, order = alarms["of"], alarms["surface_depth_mm"], alarms["order_difference"]
    inside = ", what the scan spread over the surface folded back in" if alarms["partial_volume"] == "fold" else ""
    inside = inside if depth is None else f", the surface read {depth:g} mm inside"
    by = "by laws of labels" if parts else f"by the law {law['name']}"
    covered, specimens = "what their laws cover", "of their law"
    if not parts:
        low, high = law["range_hu"] or (-inf, inf)
        covered = f"the law's {low:.0f} to {high:.0f} HU"
        low, high = law["specimens_g_cm3"] or (0, 0)
        specimens = f"{low:g} to {high:g} g/cm3"
    lines = [f"mapping    {alarms['mapping']}{inside}, {by}", *_part_lines(parts)]
    lines.append(f"alarms     {alarms['outside_law']:.2%} of the {of} outside {covered} ({law['out_of_range_policy']})")
    if alarms["beyond_specimens"] is not None:
        lines.append(f"{_UNDER}{alarms['beyond_specimens']:.2%} lighter or denser than the specimens' {specimens}")
    lines.append(f"{_UNDER}{alarms['near_zero_modulus']:.2%} of a modulus below {alarms['near_zero_mpa']:g} MPa")
    mass = alarms["mass_g"]
    if mass["difference"] is not None:
        lines.append(
            f"{_UNDER}mass of the mesh {mass['mesh']:.4g} g, of the voxels {mass['voxels']:.4g} g: "
            f"{mass['difference']:+.2%}"
        )
        if abs(mass["difference"]) > MASS_TOLERANCE:
            lines[-1] += ", more than 1 %:"
            lines += _wrapped(mass_advice(alarms, volume_mm3))
    elif mass["mesh"] is not None:
        lines.append(f"{_UNDER}mass of the mesh {mass['mesh']:.4g} g")
    if mass["mesh"] is not None:
        lines += _wrapped(f"masses are {mass_words(mass)}")
    if order is not None:
        lines.append(
            f"{_UNDER}element-hu and element-e differ by {order['mean']:.1%} of the modulus on average, "
            f"{order['max']:.0%} at most"
        )
    return lines


def _calibration_lines(calibration: dict[str, Any]) -> list[str]:
    method, kind = calibration["method"], calibration["kind"]
    lines = [f"calibrated {kind} density by {method}: {calibration['source']}"]
    for each in calibration["references"]:
        spread = "" if each["deviation_hu"] is None else f" +- {each['deviation_hu']:.1f}"
        lines.append(
            f"{_UNDER}{each['name']}: {each['density_g_cm3']:g} g/cm3 at {each['hu']:.1f}{spread} HU, "
            f"off by {each['residual_g_cm3']:+.4f} g/cm3"
        )
    slope, intercept = calibration["slope_g_cm3_per_hu"], calibration["intercept_g_cm3"]
    if not calibration["table"]:
        errors = calibration["slope_error_g_cm3_per_hu"], calibration["intercept_error_g_cm3"]
        within = "" if None in errors else f", standard errors {errors[0]:.2g} and {errors[1]:.2g}"
        lines.append(f"{_UNDER}{kind} = {_line(slope, 'HU', intercept)}{within}")
    return lines


def comparison_lines(outcomes: "Sequence[LawOutcome]") -> list[str]:
    """The laws on one model, from the softest, each beside the default."""
    solved = all(each.stiffness_n_mm is not None for each in outcomes)
    ordered = sorted(outcomes, key=_stiffness)
    (paper,) = (each for each in outcomes if each.law.name == DEFAULT_LAW)
    width = max(len(each.law.name) for each in ordered)
    stiff = "stiffness (N/mm)  " if solved else ""
    lines = [f"{'law':{width}}  mean E (MPa)  outside  {stiff}of the default's"]
    for each in ordered:
        name, mean, ratio = each.law.name, each.mean_modulus_mpa, _stiffness(each) / _stiffness(paper)
        force = f"{each.stiffness_n_mm:16,.0f}  " if solved else ""
        mark = "  unconfirmed in part" if each.law.all_unconfirmed else ""
        lines.append(f"{name:{width}}  {mean:12,.0f}  {each.outside:7.1%}  {force}{ratio:16.2f}{mark}")
    return lines


def _stiffness(outcome: "LawOutcome") -> float:
    """Stiffness of the model, or its mean modulus where it was not solved."""
    return outcome.mean_modulus_mpa if outcome.stiffness_n_mm is None else outcome.stiffness_n_mm
