"""The sections of a report as HTML, each from one part of the account; every text is escaped here."""

from collections.abc import Iterable, Sequence
from html import escape
from itertools import groupby
from typing import Any

import numpy as np

from gpubspline.material.alarms import MASS_TOLERANCE, mass_advice
from gpubspline.material.density import DensityRelation
from gpubspline.material.laws import Law
from gpubspline.mesh.quality import Quality
from gpubspline.report.page import charts
from gpubspline.report.page.account import Account, Table
from gpubspline.report.page.charts import percent
from gpubspline.report.page.figures import figure_rows, number, vector

MOST_CHANGED = 0.1
"""Share of nodes outside a law from which a report warns of it."""


def warning_lines(account: Account) -> list[str]:
    """What the user was warned of, and what the figures call for."""
    said, quality = list(account.warnings), account.quality
    if quality is not None and quality.inverted:
        said.append(f"{quality.inverted:,} of {quality.n_elements:,} elements are inverted: no solver takes them.")
    if quality is not None and quality.fraction_below_0_1 > 0.01:
        said.append(f"{percent(quality.fraction_below_0_1)} of the elements have a scaled Jacobian below 0.1.")
    said += _alarm_lines(account.figures)
    for law in dict.fromkeys(account.laws):
        said += [f"Law {law.name}, not confirmed from its source: {part}." for part in law.all_unconfirmed]
    return said


def _alarm_lines(figures: dict[str, Any]) -> list[str]:
    """What the figures of a mapping and of the elements' validity call for."""
    said, alarms = [], figures.get("alarms") or {}
    outside, of = alarms.get("outside_law"), alarms.get("of", "nodes")
    if outside is None and figures.get("out_of_range_nodes") and figures.get("nodes"):
        outside = figures["out_of_range_nodes"] / figures["nodes"]
    if outside and outside > MOST_CHANGED:
        policy = (figures.get("law") or {}).get("out_of_range_policy") or "changed"
        said.append(f"{percent(outside)} of the {of} have HU outside the law: {policy}.")
    if (alarms.get("beyond_specimens") or 0) > MOST_CHANGED:
        said.append(
            f"{percent(alarms['beyond_specimens'])} of the {of} have a density that no specimen of the law had."
        )
    off = (alarms.get("mass_g") or {}).get("difference")
    if off is not None and abs(off) > MASS_TOLERANCE:
        said.append(
            f"The mass of the mesh is {100 * abs(off):.1f} % {'above' if off > 0 else 'below'} that of the voxels: "
            f"{mass_advice(alarms, figures.get('volume_mm3'))}."
        )
    if figures.get("certified_valid") is False:
        said.append("The Jacobian determinant is not certified to be positive throughout every element.")
    return said


def warnings_box(account: Account) -> str:
    """The warnings, which come first."""
    said = warning_lines(account)
    if not said:
        return '<p class="calm">No warnings.</p>'
    return f'<ul class="warnings" aria-label="warnings">{"".join(f"<li>{escape(line)}</li>" for line in said)}</ul>'


def headline(account: Account) -> str:
    """The few numbers that a person wants first."""
    mesh, quality = account.mesh, account.quality
    figures = account.figures
    elements, kind = figures.get("elements", mesh.n_elements), figures.get("element_type", mesh.element_type)
    tiles = [*_body_tiles(account), (f"{elements:,}", f"{kind} elements")]
    tiles.append((f"{figures.get('nodes', mesh.n_nodes):,}", "nodes"))
    if quality is not None:
        tiles += [
            (percent(quality.fraction_above_0_5), "scaled Jacobian above 0.5"),
            (f"{quality.min:.3f}", "least scaled Jacobian"),
            (f"{quality.inverted:,}", "inverted"),
        ]
    if figures.get("max_von_mises_mpa") is not None:
        tiles.append((f"{number(figures['max_von_mises_mpa'])} MPa", "greatest von Mises stress"))
    if figures.get("max_displacement_mm") is not None:
        tiles.append((f"{number(figures['max_displacement_mm'])} mm", "greatest displacement"))
    distance = figures.get("surface_distance_mm")
    if distance:
        tiles.append((f"{number(distance['mean'])} mm", "mean distance to the surface"))
    return "".join(f"<div><b>{escape(value)}</b><span>{escape(name)}</span></div>" for value, name in tiles)


def _body_tiles(account: Account) -> list[tuple[str, str]]:
    """Size, volume and mass as far as they are known: whoever knows the patient sees whether they can be."""
    figures = account.figures
    size = " × ".join(f"{mm:.0f}" for mm in np.ptp(account.mesh.points, axis=0)) if account.mesh.n_nodes else ""
    tiles = [(f"{size} mm", "size along x, y, z")] if size else []
    volume, mass = (figures.get("volume_mm3") or {}).get("mesh"), figures.get("mass_g")
    if volume:
        tiles.append((f"{number(volume / 1000)} cm³", "volume"))
    if mass:
        kind = figures.get("mass_density")
        tiles.append((f"{number(mass)} g", f"mass, by {kind} density" if kind else "mass"))
    return tiles


def chart_section(account: Account, nodal: dict[str, Any]) -> str:
    """Every chart that the account has something for."""
    drawn = []
    if account.quality is not None:
        below = f"{_spread(account.quality)}; counts above the bars"
        drawn += [
            ("Scaled Jacobian", charts.jacobian_chart(account.quality), below),
            ("Beside the paper's models", charts.paper_chart(account.quality), "elements above 0.5 and below 0.1"),
        ]
    powers = [law for law in account.laws if not law.is_constant]
    if "HU" in nodal and "E_MPa" in nodal and powers:
        jumps = "red is the law; each dot is a node, beside the law where its HU was clamped or floored"
        drawn.append(("Young's modulus against HU", charts.law_chart(nodal["HU"], nodal["E_MPa"], powers), jumps))
    names = {
        "HU": "HU of the nodes",
        "E_MPa": "Young's modulus of the nodes",
        "von_mises_mpa": "Von Mises stress of the nodes",
    }
    drawn += [(title, charts.distribution(name, nodal[name]), "") for name, title in names.items() if name in nodal]
    drawn = [(curve.title, charts.curve_chart(curve), curve.note) for curve in account.curves] + drawn
    return "".join(
        f"<figure><h3>{escape(title)}</h3>{svg}<figcaption>{escape(note)}</figcaption></figure>"
        for title, svg, note in drawn
    )


def _spread(quality: Quality) -> str:
    return f"least {quality.min:.3f}, mean {quality.mean:.3f}, {quality.inverted:,} inverted"


def worst_section(account: Account) -> str:
    """The worst elements; a click on a row shows the element, where the mesh shown has it."""
    quality = account.quality
    if quality is None:
        return ""
    shown = quality.n_elements == account.mesh.n_elements
    rows = []
    listed = zip(quality.worst, quality.worst_values, quality.worst_centroids_mm, strict=True)
    for place, (element, value, at) in enumerate(listed):
        opens = f'<tr tabindex="0" data-worst="{place}">' if shown else "<tr>"
        where = ", ".join(f"{mm:.1f}" for mm in at)
        rows.append(f"{opens}<td>{element + 1:,}</td><td>{value:.4f}</td><td>{where}</td></tr>")
    head = "<tr><th>element</th><th>scaled Jacobian</th><th>at x, y, z (mm)</th></tr>"
    return (
        f'<section id="worst"><h2>Worst elements</h2><p class="hint">{"Click a row to see it." if shown else ""}</p>'
        f"<table><thead>{head}</thead><tbody>{''.join(rows)}</tbody></table></section>"
    )


def own_tables(account: Account) -> str:
    """Tables of the command's own, of where a load case acts, and of what of the region the mesh leaves out."""
    acting, lost = account.figures.get("regions"), account.figures.get("lost_features")
    made = [_load_table(acting, account.figures.get("load_case") or {})] if acting else []
    if lost:
        rows = [(vector(part["place_mm"]), part["out_mm"]) for part in lost]
        made.append(Table("Parts of the region left out", ("at x, y, z (mm)", "outside the mesh by (mm)"), rows))
    return "".join(_own_table(table) for table in [*account.tables, *made])


def _load_table(acting: Sequence[dict[str, Any]], case: dict[str, Any]) -> Table:
    """Where a load case acts, of the figures of ``analysis.response``."""
    rows = [
        (
            part["region"],
            part["kind"],
            vector(part["force_n"]),
            part["area_mm2"],
            part["nodes"],
            vector([round(mm, 2) + 0.0 for mm in part["centre_mm"]]),
        )
        for part in acting
    ]
    columns = ("region", "kind", "force x, y, z (N)", "area (mm²)", "nodes", "centre x, y, z (mm)")
    return Table(f"Load case {case.get('name', '')}".strip(), columns, rows, case.get("source") or "")


def _own_table(table: Table) -> str:
    head = "".join(f"<th>{escape(column)}</th>" for column in table.columns)
    rows = "".join(f"<tr>{''.join(f'<td>{escape(number(cell))}</td>' for cell in row)}</tr>" for row in table.rows)
    note = f'<p class="hint">{escape(table.note)}</p>' if table.note else ""
    return (
        f'<section class="own"><h2>{escape(table.title)}</h2><div class="wide"><table><thead><tr>{head}</tr></thead>'
        f"<tbody>{rows}</tbody></table></div>{note}</section>"
    )


def figures_section(figures: dict[str, Any]) -> str:
    """Every figure that no other section shows."""
    rows = figure_rows(figures)
    return _definitions("figures", "Figures", rows) if rows else ""


def timing_section(seconds: dict[str, float]) -> str:
    """Wall time of each stage, with a bar as long."""
    stages = {name: value for name, value in seconds.items() if name != "total"}
    if not stages:
        return ""
    total = seconds.get("total", sum(stages.values()))
    rows = "".join(
        f'<tr><td>{escape(name)}</td><td><i style="width:{100 * value / max(total, 1e-9):.1f}%"></i></td>'
        f"<td>{value:.2f} s</td></tr>"
        for name, value in stages.items()
    )
    return (
        f'<section id="timings"><h2>Timings</h2><table><tbody>{rows}<tr><td>total</td><td></td><td>{total:.2f} s</td>'
        "</tr></tbody></table></section>"
    )


def law_section(laws: Sequence[Law]) -> str:
    """Each law and each conversion with its formula and its citation."""
    each = dict.fromkeys(laws)  # labels may share one
    return "".join(f'<section class="law"><h2>Law {escape(law.name)}</h2>{_law(law)}</section>' for law in each)


def _law(law: Law) -> str:
    rate, specimens = law.strain_rate_per_s, law.specimens_g_cm3
    rows = [("is", law.title), ("site", ", ".join(filter(None, [law.site, law.direction])))]
    rows.append(("strain rate", f"{rate:g} per second" if rate is not None else ""))
    rows.append(("specimens", f"{specimens[0]:g} to {specimens[1]:g} g/cm³" if specimens is not None else ""))
    rows += _density_rows(law.density)
    if law.is_constant:
        (piece,) = law.pieces
        rows.append(("at any HU", f"E = {number(piece.offset_mpa)} MPa, ν = {piece.poisson:g}"))
    for piece in () if law.is_constant else law.pieces:
        shift = f" {piece.offset_mpa:+g}" if piece.offset_mpa else ""
        power = f"E = {piece.factor_mpa:.6g} ρ^{piece.exponent:g}{shift} MPa, ν = {piece.poisson:g}"
        rows.append((f"{piece.lower_hu:.0f} to {piece.upper_hu:.0f} HU", power))
    rows += [("jump", f"at {hu:g} HU from {below:,.0f} to {above:,.0f} MPa") for hu, below, above in law.jumps()]
    rows += [("citation", law.citation), ("unconfirmed", "; ".join(law.all_unconfirmed)), ("note", law.notes)]
    return _list((name, text) for name, text in rows if text)


def _density_rows(density: DensityRelation) -> list[tuple[str, str]]:
    """What the density comes to, and each conversion on the way with its source."""
    if density.is_constant:
        return [(f"ρ {density.kind}", f"{density.intercept_g_cm3:g} g/cm³")]
    if density.table:
        points = ", ".join(f"{rho:.4g} at {hu:g} HU" for hu, rho in density.table)
        rows = [(f"ρ {density.kind}", f"by a table: {points} g/cm³")]
    else:
        rows = [(f"ρ {density.kind}", _line(density.slope_g_cm3_per_hu, "HU", density.intercept_g_cm3))]
    if not density.steps:
        return [*rows, ("from", density.source)]
    return rows + [
        (step.name, f"{step.gives} = {_line(step.slope, step.takes, step.intercept)}; {step.source}")
        for step in density.steps
    ]


def _line(slope: float, takes: str, intercept: float) -> str:
    return f"{slope:.6g} {takes}" + (f" {intercept:+.6g}" if intercept else "") + " g/cm³"


def run_section(account: Account) -> str:
    """The command, every option in force by its group, and the sources."""
    parts = []
    if account.command:
        parts.append(f"<pre>{escape(account.command)}</pre>")
    for panel, settings in groupby(account.settings, key=lambda setting: setting.panel):
        rows = "".join(
            f"<dt{' class=given' if s.given else ''}>{escape(s.name)}</dt><dd>{escape(s.value)}</dd>" for s in settings
        )
        parts.append(f'<div class="panel"><h3>{escape(panel)}</h3><dl>{rows}</dl></div>')
    hint = '<p class="hint">Bold was given, the rest are defaults. Paths are left out.</p>' if account.settings else ""
    options = f'<section id="run"><h2>How it was made</h2>{hint}<div class="panels">{"".join(parts)}</div></section>'
    sources = "".join(f"<li>{escape(source)}</li>" for source in account.sources)
    cited = f'<section id="sources"><h2>Sources</h2><ul>{sources}</ul></section>' if account.sources else ""
    return (options if parts else "") + cited


def _definitions(name: str, title: str, rows: Iterable[tuple[str, str]]) -> str:
    return f'<section id="{name}"><h2>{escape(title)}</h2>{_list(rows)}</section>'


def _list(rows: Iterable[tuple[str, str]]) -> str:
    return f"<dl>{''.join(f'<dt>{escape(name)}</dt><dd>{escape(text)}</dd>' for name, text in rows)}</dl>"
