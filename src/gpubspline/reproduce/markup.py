"""Pieces of the page: tables, the paper beside what is here, percents that do not lie."""

from collections.abc import Sequence
from html import escape


def table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Lay out texts as a table of HTML."""
    head = "".join(f'<th scope="col">{escape(text)}</th>' for text in heads)
    body = "".join("<tr>" + "".join(f"<td>{escape(text)}</td>" for text in row) + "</tr>" for row in rows)
    return f'<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'


def beside(paper: str, here: str) -> str:
    """Put what the paper shows beside what is here."""
    return (
        f'<div class="beside"><div><h3>Paper</h3><p>{escape(paper)}</p></div>'
        f"<div><h3>Here</h3><p>{escape(here)}</p></div></div>"
    )


def percent(value: float) -> str:
    """Percent with one digit where it has one, which never rounds to all or to none."""
    if 0 < value < 0.1:
        return "< 0.1"
    if 99.9 < value < 100:
        return "> 99.9"
    return f"{value:.1f}".removesuffix(".0")
