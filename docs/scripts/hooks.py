"""What mkdocs is asked to do beside rendering pages: pages and figures made from the code, equations as MathML."""

import re
import sys
from pathlib import Path
from typing import Any

from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

sys.path.insert(0, str(Path(__file__).parent))

import figures
import pages

CODE = re.compile(r"(^```.*?^```|`[^`\n]+`)", re.M | re.S)
INCLUDE = re.compile(r"^include (\S+)$", re.M)
BLOCK, INLINE = re.compile(r"\$\$(.+?)\$\$", re.S), re.compile(r"(?<![\\$\w])\$([^$\n]+?)\$(?![\w$])")


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Leave out of the navigation what is not there: pages that other parts of the project write."""
    made = {*pages.PAGES, *(path.name for path in Path(config.docs_dir).glob("*.md"))}
    config.nav = [entry for entry in map(lambda entry: _kept(entry, made), config.nav or []) if entry]
    return config


def _kept(entry: Any, made: set[str]) -> Any:
    if isinstance(entry, str):
        return entry if entry in made else None
    ((title, below),) = entry.items()
    if isinstance(below, str):
        return entry if below in made else None
    return {title: [part for part in (_kept(part, made) for part in below) if part]}


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages and figures that are made from the code."""
    for name, page in pages.PAGES.items():
        files.append(File.generated(config, name, content=page()))
    for name, draw in figures.FIGURES.items():
        files.append(File.generated(config, f"figures/{name}", content=draw()))
    return files


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Put files where ``include PATH`` stands, and MathML where TeX, ``$..$`` or ``$$..$$``, does; not in code."""
    markdown = INCLUDE.sub(lambda found: pages.body(found[1]), markdown)
    parts = CODE.split(markdown)
    return "".join(part if number % 2 else _equations(part) for number, part in enumerate(parts))


def _equations(text: str) -> str:
    text = BLOCK.sub(lambda found: f"\n{convert(found[1].strip(), display='block')}\n", text)
    return INLINE.sub(lambda found: convert(found[1]), text)
