"""From an account to one HTML file, whole or not at all, that asks the network for nothing."""

import json
from html import escape
from importlib import resources
from pathlib import Path
from string import Template
from typing import Any

from gpubspline.errors import InputError
from gpubspline.files import whole_file
from gpubspline.report.page import sections
from gpubspline.report.page.account import Account
from gpubspline.report.page.scene import nodal_fields, scene
from gpubspline.report.page.slices import slices

SCRIPTS = ("unpack.js", "camera.js", "body.js", "slices.js", "page.js")
"""Parts of the page's program, in the order they need each other."""


def check_page(path: Path) -> None:
    """Raise ``InputError`` where ``path`` is not the name of a page."""
    if path.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"expected a report file that ends in .html, got {path.name}")


def write_report(account: Account, path: str | Path) -> None:
    """Write an account as one page: it opens without a network, holds no path and no name of a patient.

    Arguments
    ---------
    account: what to tell.
    path: an ``.html``, which appears whole or not at all.

    Raises
    ------
    InputError where the mesh has no field to show, or the file cannot be written.
    """
    path = Path(path)
    check_page(path)
    text = page(account)
    with whole_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def page(account: Account) -> str:
    """Give the text of the page."""
    data = {
        "scene": scene(account.mesh, account.quality),
        "slices": None if account.volume is None else slices(account.volume, account.mesh),
    }
    return Template(_file("page.html")).substitute(
        title=escape(account.title),
        style=_file("page.css"),
        script="\n".join(_file(name) for name in SCRIPTS),
        data=json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c"),
        **_sections(account),
    )


def _sections(account: Account) -> dict[str, str]:
    figures: dict[str, Any] = account.figures
    return {
        "warnings": sections.warnings_box(account),
        "headline": sections.headline(account),
        "charts": sections.chart_section(account, nodal_fields(account.mesh)),
        "worst": sections.worst_section(account),
        "own": sections.own_tables(account),
        "figures": sections.figures_section(figures),
        "timings": sections.timing_section(figures.get("seconds") or {}),
        "laws": sections.law_section(account.laws),
        "run": sections.run_section(account),
    }


def _file(name: str) -> str:
    return resources.files("gpubspline.report.page").joinpath(name).read_text(encoding="utf-8")
