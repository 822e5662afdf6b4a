"""The cohort's page: one HTML file that needs nothing else, failures and outliers first."""

from collections.abc import Iterator, Mapping, Sequence
from html import escape
from importlib import resources
from pathlib import Path

import numpy as np

from gpubspline.batch.outliers import FEWEST, LIMIT, QUANTITIES, Quantity, outliers
from gpubspline.batch.record import Record
from gpubspline.files import whole_file
from gpubspline.material.density import MASS_OF

Apart = Mapping[str, Sequence[str]]
_BINS, _ROWS = 50, 5
"""Places side by side and above each other for the dots of a strip."""


def write_page(records: Sequence[Record], total: int, path: Path) -> None:
    """Write the page of the subjects that are through, of ``total``; whole or not at all."""
    apart = outliers(records)
    parts = [*_head(records, total), *_failures(records), *_apart(apart, records), *_strips(records, apart)]
    parts += _table(records, apart)
    page = (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>Cohort of {total} subjects</title>\n<style>\n{_text('page.css')}</style>\n</head>\n<body>\n"
        + "\n".join(parts)
        + f"\n<script>\n{_text('page.js')}</script>\n</body>\n</html>\n"
    )
    with whole_file(path) as temporary:
        temporary.write_text(page, encoding="utf-8")


def _text(name: str) -> str:
    return resources.files("gpubspline.batch").joinpath(name).read_text(encoding="utf-8")


def _head(records: Sequence[Record], total: int) -> Iterator[str]:
    failed, left = sum(record.failed for record in records), total - len(records)
    yield f"<h1>Cohort of {total} subjects</h1>"
    models = len(records) - failed
    words = [f"{models} model{'' if models == 1 else 's'}", f"{failed} failed"] + (
        [f"{left} still to come"] if left else []
    )
    yield f"<p>{', '.join(words)}.</p>"


def _failures(records: Sequence[Record]) -> Iterator[str]:
    failed = [(record.subject, record.error) for record in records if record.failed]
    if failed:
        yield '<h2 class="bad">Failed</h2>'
        yield _list(failed)
    warned = [(record.subject, "; ".join(record.warnings)) for record in records if record.warnings]
    if warned:
        yield "<h2>Warnings</h2>"
        yield _list(warned)


def _apart(apart: Apart, records: Sequence[Record]) -> Iterator[str]:
    yield "<h2>Outliers</h2>"
    models = sum(not record.failed for record in records)
    if models < FEWEST:
        yield f'<p class="note">None are looked for among fewer than {FEWEST} models.</p>'
        return
    titles = {quantity.name: quantity.title for quantity in QUANTITIES}
    if apart:
        yield _list([(subject, "; ".join(titles[name] for name in names)) for subject, names in apart.items()])
    else:
        yield "<p>None.</p>"
    yield f'<p class="note">Modified z-score (Iglewicz and Hoaglin 1993) beyond {LIMIT}, on the side that is bad.'
    mixed = any(len(quantity.by_kind(records)) > 1 for quantity in QUANTITIES)
    yield (" Masses are compared with those of their own kind of density." if mixed else "") + "</p>"


def _list(pairs: Sequence[tuple[str, str]]) -> str:
    return "<dl>" + "".join(f"<dt>{escape(a)}</dt><dd>{escape(b)}</dd>" for a, b in pairs) + "</dl>"


def _strips(records: Sequence[Record], apart: Apart) -> Iterator[str]:
    drawn = [strip for quantity in QUANTITIES for strip in _strips_of(quantity, records, apart)]
    if drawn:
        yield "<h2>Distributions</h2>"
        yield '<p class="note">A dot a subject, dashed the median, outliers red. Point at a dot for its subject.</p>'
        yield f'<div class="strips">{"".join(drawn)}</div>'


def _strips_of(quantity: Quantity, records: Sequence[Record], apart: Apart) -> Iterator[str]:
    """Strip of a quantity, or of each kind of it, in words; none of fewer than two subjects."""
    kinds = quantity.by_kind(records)
    for kind, known in kinds.items():
        if len(known) > 1:
            of = f", {MASS_OF.get(kind, 'of density unknown')}" if len(kinds) > 1 else ""
            yield _strip(quantity.title + of, quantity.name, known, apart)


def _strip(title: str, name: str, known: Sequence[tuple[str, float]], apart: Apart) -> str:
    """Dots of a quantity along its range."""
    values = np.array([value for _, value in known])
    low, high = values.min(), values.max()
    span = high - low or 1.0
    taken, dots = np.zeros(_BINS + 1, dtype=int), []
    for subject, value in known:
        share = (value - low) / span
        place = round(share * _BINS)
        row, taken[place] = taken[place] % _ROWS, taken[place] + 1
        mark = ' class="apart"' if name in apart.get(subject, ()) else ""
        at = f"left:{share:.1%};bottom:{0.15 + 0.6 * row:.2f}rem"
        dots.append(f'<i{mark} style="{at}" title="{escape(subject)}: {_number(value)}"></i>')
    median = float(np.median(values))
    middle = f'<b style="left:{(median - low) / span:.1%}"></b>'
    words = (_number(low), f"median {_number(median)}", _number(high))
    ends = f'<div class="ends">{"".join(f"<span>{word}</span>" for word in words)}</div>'
    return f'<div class="strip"><h3>{title}</h3><div class="dots">{middle}{"".join(dots)}</div>{ends}</div>'


def _table(records: Sequence[Record], apart: Apart) -> Iterator[str]:
    known = [q for q in QUANTITIES if any(q.of(record) is not None for record in records if not record.failed)]
    yield "<h2>Subjects</h2>"
    heads = ["Subject", "Elements", *(quantity.title for quantity in known)]
    mixed = any(len(quantity.by_kind(records)) > 1 for quantity in known)
    heads += ["Mass is"] if mixed else []
    yield '<div class="scroll"><table><thead><tr>'
    yield "".join(f'<th scope="col"><button type="button">{head}</button></th>' for head in heads)
    yield "</tr></thead><tbody>"
    for record in records:
        name = escape(record.subject)
        cells = [f'<td data-value="{name}"{_bad(record.failed)}>{name}</td>']
        cells.append(_cell(record.figures.get("mesh", {}).get("elements"), False))
        marks = apart.get(record.subject, ())
        cells += [_cell(None if record.failed else q.of(record), q.name in marks) for q in known]
        if mixed:
            of = MASS_OF.get(record.figures.get("mesh", {}).get("mass_density"), "")
            cells.append(f'<td data-value="{of}">{of}</td>')
        yield f"<tr>{''.join(cells)}</tr>"
    yield "</tbody></table></div>"


def _number(value: float) -> str:
    return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.4g}"


def _cell(value: float | None, apart: bool) -> str:
    text = "" if value is None else _number(value)
    return f'<td data-value="{"" if value is None else value}"{_bad(apart)}>{text}</td>'


def _bad(yes: bool) -> str:
    return ' class="bad"' if yes else ""
