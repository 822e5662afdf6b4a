"""What a user gets: the wheel holds every file that the package reads, the source archive every file of the tree."""

import os
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

from gpubspline.tables import parse

ROOT = Path(__file__).resolve().parents[1]
PLACES = {"src/gpubspline": "gpubspline", "kernels": "gpubspline/kernels", "bench": "gpubspline/bench"}
"""Folders of the tree, and where they lie in the wheel."""

BUILD = "import sys; from setuptools import build_meta as b; out = sys.argv[1]; b.build_sdist(out); b.build_wheel(out)"
OURS = (".git", ".venv*", "build", "dist", "*.egg-info", "__pycache__", ".*_cache", "gpubspline-demo", "site")


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with a source archive and a wheel, made of a copy of the tree."""
    tree, out = tmp_path_factory.mktemp("tree") / "gpubspline", tmp_path_factory.mktemp("dist")
    shutil.copytree(ROOT, tree, ignore=shutil.ignore_patterns(*OURS))
    command = [sys.executable, "-c", BUILD, str(out)]
    made = subprocess.run(command, cwd=tree, capture_output=True, text=True, check=False)
    assert made.returncode == 0, made.stdout + made.stderr
    return out


def tracked() -> set[str]:
    """Files of the tree, as git knows them or, in an unpacked source archive, as they lie there."""
    if not (ROOT / ".git").exists():
        pytest.skip("not in a clone")
    command = ["git", "ls-files", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout.splitlines()
    return {name for name in listed if (ROOT / name).is_file()}


def test_wheel_holds_every_file_of_the_package(built: Path) -> None:
    (wheel,) = built.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        held = {name for name in archive.namelist() if ".dist-info/" not in name}
    wanted = set()
    for place, there in PLACES.items():
        wanted |= {there + name.removeprefix(place) for name in tracked() if name.startswith(f"{place}/")}
    assert held == wanted
    assert {"gpubspline/py.typed", "gpubspline/kernels/quality.cl", "gpubspline/batch/page.css"} <= held


def test_source_archive_holds_every_file_of_the_tree(built: Path) -> None:
    (source,) = built.glob("*.tar.gz")
    with tarfile.open(source) as archive:
        members = [member for member in archive.getmembers() if member.isfile()]
    held = {member.name.partition("/")[2] for member in members}
    made = {name for name in held if ".egg-info/" in name} | {"PKG-INFO", "setup.cfg"}
    assert held - made == tracked()
    script = next(member for member in members if member.name.endswith(".ci/run"))
    assert bool(script.mode & 0o100) == os.access(ROOT / ".ci/run", os.X_OK)


def test_wheel_names_its_licence_command_and_extras(built: Path) -> None:
    (wheel,) = built.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
        told = archive.read(next(n for n in names if n.endswith(".dist-info/METADATA"))).decode()
        points = archive.read(next(n for n in names if n.endswith(".dist-info/entry_points.txt"))).decode()
    assert any(name.endswith("licenses/LICENSE") for name in names)
    assert "License-Expression: Apache-2.0" in told and "gpubspline = gpubspline.cli:main" in points
    assert {f"Provides-Extra: {extra}" for extra in ("view", "hdf", "cohort", "docs")} <= set(told.splitlines())
    assert wheel.name.endswith("-py3-none-any.whl")  # no compiler is needed for it


def test_citation_names_the_paper_and_the_version() -> None:
    import yaml

    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    project = parse((ROOT / "pyproject.toml").read_text(), "pyproject.toml")["project"]
    assert cited["version"] == project["version"] and cited["license"] == project["license"]
    (paper,) = cited["references"]
    assert "Human Body Segment in 2-D and 3-D" in paper["title"]
    assert [author["family-names"] for author in paper["authors"]] == ["Pise", "Bhatt", "Srivastava"]


def test_module_runs_as_the_command() -> None:
    run = [sys.executable, "-m", "gpubspline", "laws"]
    assert "wirtz-2000" in subprocess.run(run, capture_output=True, text=True, check=True).stdout


def complete(words: str) -> list[str]:
    """What bash is offered for the last of the words, as the installed completion asks for it."""
    count = len(words.split(" ")) - 1
    told = {"_GPUBSPLINE_COMPLETE": "complete_bash", "COMP_WORDS": words, "COMP_CWORD": str(count)}
    command = [sys.executable, "-c", "from gpubspline.cli import main; import sys; sys.argv[0] = 'gpubspline'; main()"]
    run = subprocess.run(command, env={**os.environ, **told}, capture_output=True, text=True, check=True)
    return run.stdout.split()


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("gpubspline me", {"mesh"}),
        ("gpubspline mesh --out-of", {"--out-of-range"}),
        ("gpubspline mesh --backend ", {"auto", "warp", "opencl"}),
        ("gpubspline mesh --fit i", {"interpolate"}),
        ("gpubspline mesh --law wirtz-2000-tr", {"wirtz-2000-transverse"}),
        ("gpubspline mesh --law 22=wirtz-2000-tr", {"22=wirtz-2000-transverse"}),
        ("gpubspline mesh --mapping element", {"element-hu", "element-e"}),
        ("gpubspline mesh --element hex2", {"hex20", "hex27"}),
        ("gpubspline solve --device opencl:0", {"opencl:0:0"}),
        ("gpubspline phantom ad", {"adult-femur"}),
    ],
)
def test_shell_completion(words: str, expected: set[str]) -> None:
    assert set(complete(words)) == expected
