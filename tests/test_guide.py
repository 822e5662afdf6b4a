"""The guide keeps its word: its pages name commands, options and files that exist; pages are made from the code."""

import importlib.util
import re
import shlex
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
import SimpleITK as sitk
import typer

import gpubspline as gb
from gpubspline.analysis.load_case import _PARTS, read_load_case
from gpubspline.bench import bench_blocks
from gpubspline.cli.entry import app

ROOT = Path(__file__).resolve().parents[1]
PAGES = sorted((ROOT / "docs").glob("*.md"))


@pytest.fixture(scope="module")
def pages() -> ModuleType:
    """The script that makes pages from the code."""
    found = importlib.util.spec_from_file_location("guide_pages", ROOT / "docs" / "scripts" / "pages.py")
    assert found is not None and found.loader is not None
    module = importlib.util.module_from_spec(found)
    sys.modules[found.name] = module
    found.loader.exec_module(module)
    return module


def options() -> dict[str, set[str]]:
    group: Any = typer.main.get_command(app)
    return {name: {o for p in command.params for o in p.opts} for name, command in group.commands.items()}


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.stem)
def test_every_command_and_option_exists(page: Path) -> None:
    text, known = page.read_text(), options()
    for line in re.findall(
        r"gpubspline (\w+(?: [^\n`]*)?)", " ".join(re.findall(r"```bash\n.*?```|`[^`\n]+`", text, re.S))
    ):
        command, *words = line.split()
        if command in ("COMMAND", "follows"):
            continue
        assert command in known, line
        assert {word for word in words if re.match(r"--?[a-z]", word)} <= known[command] | {"--help"}, line
    everywhere = set().union(*known.values()) | {"--install-completion"}
    assert set(re.findall(r"`(--[a-z-]+)", text)) <= everywhere


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.stem)
def test_links_and_included_files_are_there(page: Path, pages: ModuleType) -> None:
    text = page.read_text()
    for name in re.findall(r"^include (\S+)$", text, re.M):
        assert (ROOT / name).is_file()
    for link in re.findall(r"\]\(([\w./-]+)", text):
        made = link.startswith("figures/") or link in pages.PAGES
        assert made or (ROOT / "docs" / link).is_file(), link


def test_made_pages_are_of_the_code(pages: ModuleType) -> None:
    commands, laws = pages.commands(), pages.laws()
    for name, known in options().items():
        assert f"\n## {name}\n" in commands
        assert all(f"`{option}`" in commands for option in known if option.startswith("--") and option != "--help")
    assert all(f"\n## {name}\n" in laws for name in gb.laws())
    assert pages.examples().count('```python title="examples/') == len(list((ROOT / "examples").glob("*.py")))
    assert "**0.4.0**" in pages.changelog()


def test_load_case_of_the_guide_is_read() -> None:
    """Its table has every condition that a region may have."""
    text = (ROOT / "docs" / "loads.md").read_text()
    case = read_load_case(re.findall(r"```toml .*?\n(.*?)```", text, re.S)[0], "press.toml")
    assert case.title == "A vertebra pressed from above" and len(case.forces[0].region.parts) == 2
    assert set(re.findall(r"^\| `(\w+) = ", text, re.M)) == {"side", *_PARTS}


def test_ablations_of_the_guide_are_those_of_the_bench() -> None:
    """Its two tables have a row for each step, in the order in which the bench prints them."""
    text = (ROOT / "docs" / "mathematics.md").read_text()
    rows = [name for name in re.findall(r"^\| ([^|]+) \|", text, re.M) if not name.startswith("way")]
    assert rows == [*bench_blocks.WAYS, *bench_blocks.OF_THIN]


def test_law_of_the_guide_is_read(tmp_path: Path) -> None:
    text = (ROOT / "docs" / "start.md").read_text()
    (tmp_path / "my_law.toml").write_text(re.findall(r"```toml\n(.*?)```", text, re.S)[0])
    law = gb.law(tmp_path / "my_law.toml")
    assert law.name == "my-femur" and law.range_hu == (50.0, 1600.0)


def test_the_first_model_as_printed(run: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The steps of "First model", typed as they stand, on a scan as a user has it: a NIfTI file."""
    volume = gb.phantom("child-femur").scan()
    image = sitk.GetImageFromArray(np.ascontiguousarray(volume.hu[:, ::2, ::2]))
    image.SetSpacing([2 * volume.spacing_mm[0], 2 * volume.spacing_mm[1], volume.spacing_mm[2]])
    sitk.WriteImage(image, str(tmp_path / "scan.nii.gz"))
    text = (ROOT / "docs" / "start.md").read_text()
    (tmp_path / "my_law.toml").write_text(re.findall(r"```toml\n(.*?)```", text, re.S)[0])
    monkeypatch.chdir(tmp_path)
    commands = [line for block in re.findall(r"```bash\n(.*?)```", text, re.S) for line in block.splitlines()]
    assert [shlex.split(command)[1] for command in commands] == ["info", "preview", "mesh", "mesh", "solve", "view"]
    for command in commands:
        status, _, err = run(*shlex.split(command)[1:])
        assert status == 0, f"{command}: {err}"
    made = {"model.vtu", "model.html", "stressed.vtu", "stressed.html", "strain.png"}
    assert made <= {path.name for path in tmp_path.iterdir()}
    moduli = gb.read_mesh(tmp_path / "model.vtu").fields["E_MPa"]
    assert moduli.min() >= 6850 * (0.00116 * 50) ** 1.49 * 0.999
