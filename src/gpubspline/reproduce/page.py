"""The page that puts the paper's results beside those made here: one file that needs nothing else."""

import base64
from collections.abc import Iterator, Sequence
from html import escape
from importlib import resources
from pathlib import Path
from typing import Any

from gpubspline.files import whole_file
from gpubspline.reproduce.markup import beside, percent, table
from gpubspline.reproduce.paper import FIGURES, STUDY, TABLE, Figure
from gpubspline.reproduce.study_section import study_section

TITLE = "The paper's results on the phantoms"
PAPER = (
    "Pise, Bhatt, Srivastava, Finite Element Mesh Generation of Human Body Segment in 2-D and 3-D Using B-spline Method"
)


def write_page(numbers: dict[str, Any], folder: Path, path: Path) -> None:
    """Write the page of the figures that are there, with their pictures inside; whole or not at all.

    Arguments
    ---------
    numbers: as ``reproduce`` collects them.
    folder: where the pictures are.
    path: of the page, ``.html``.
    """
    style = resources.files("gpubspline.reproduce").joinpath("page.css").read_text(encoding="utf-8")
    page = (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{TITLE}</title>\n<style>\n{style}</style>\n</head>\n<body>\n"
        + "\n".join(_body(numbers, folder))
        + "\n</body>\n</html>\n"
    )
    with whole_file(path) as temporary:
        temporary.write_text(page, encoding="utf-8")


def _body(numbers: dict[str, Any], folder: Path) -> Iterator[str]:
    found = numbers["figures"]
    yield f"<h1>{TITLE}</h1>"
    yield (
        f"<p>Source: {escape(PAPER)}. Its scans do not come with this package; here the same method runs on analytic "
        "phantoms of as many slices: an anatomy of the same kind, not the same patient. Numbers are therefore to be "
        "met or beaten where they judge the method, and to be of the same kind where they tell of the patient.</p>"
    )
    yield f'<p class="faint">gpubspline {escape(numbers["version"])}, {escape(numbers["device"])}.</p>'
    shown = [figure for figure in FIGURES if figure.name in found]
    links = [(figure.name, f"Fig. {figure.number}") for figure in shown] + [(STUDY, "Fig. 13")] * (STUDY in found)
    yield "<nav>" + " ".join(f'<a href="#{name}">{words}</a>' for name, words in links) + "</nav>"
    yield from _table(found)
    for figure in shown:
        yield from _figure(figure, found[figure.name], folder)
    if STUDY in found:
        yield from study_section(found[STUDY]["study"], _images(found[STUDY]["pictures"], folder, "Fig. 13"))
    missing = [f"Fig. {figure.number}" for figure in FIGURES if figure.name not in found]
    missing += ["Fig. 13"] * (STUDY not in found)
    if missing:
        yield f"<section><p>Not made yet: {', '.join(missing)}.</p></section>"


def _table(found: dict[str, Any]) -> Iterator[str]:
    models = {model["name"]: model for part in found.values() for model in part.get("models", ())}
    rows = [_row(models[name]) for name in TABLE if name in models]
    if not rows:
        return
    heads = ("model", "samples", "elements, paper", "here", "% above 0.5, paper", "here", "% below 0.1, paper", "here")
    yield "<section><h2>Meshes: scaled Jacobians</h2>"
    yield table((*heads, "inverted, paper", "here", "minimum here"), rows)
    yield (
        '<p class="faint">A dash: the paper does not say. Row ends are smoothed here over 1.5 rows, which the paper '
        "does not do; it is part of why the elements are better.</p></section>"
    )


def _row(model: dict[str, Any]) -> tuple[str, ...]:
    paper = model["paper"]
    return (
        model["title"],
        " x ".join(str(n) for n in model["samples"]),
        _count(paper["elements"]),
        _count(model["elements"]),
        paper["percent_above_0.5"] or "-",
        percent(model["percent_above_0.5"]),
        paper["percent_below_0.1"] or "-",
        percent(model["percent_below_0.1"]),
        _count(paper["inverted"]),
        _count(model["inverted"]),
        f"{model['min_scaled_jacobian']:.3f}",
    )


def _count(value: int | None) -> str:
    return "-" if value is None else f"{value:,}"


def _figure(figure: Figure, part: dict[str, Any], folder: Path) -> Iterator[str]:
    yield f'<section id="{figure.name}"><h2>Fig. {figure.number}</h2>'
    yield beside(figure.caption, _here(figure, part["models"]))
    yield _images(part["pictures"], folder, f"Fig. {figure.number}")
    yield "</section>"


def _here(figure: Figure, models: Sequence[dict[str, Any]]) -> str:
    if figure.field == "":
        model = models[0]
        words = "all positive" if model["inverted"] == 0 else f"{model['inverted']:,} not positive"
        above, below = percent(model["percent_above_0.5"]), percent(model["percent_below_0.1"])
        return f"{words.capitalize()}, {above} % above 0.5, {below} % below 0.1; {model['elements']:,} elements."
    known = [f"{model['title']}: {model['elements']:,} elements" for model in models if model["elements"]]
    words = "; ".join(known)
    return words[:1].upper() + words[1:] + "."


def _images(files: Sequence[str], folder: Path, words: str) -> str:
    images = []
    for number, file in enumerate(files, start=1):
        data = base64.b64encode((folder / file).read_bytes()).decode("ascii")
        alt = f"{words}, picture {number} of {len(files)}"
        images.append(f'<figure><img src="data:image/png;base64,{data}" alt="{alt}" loading="lazy"></figure>')
    return f'<div class="pictures">{"".join(images)}</div>'
