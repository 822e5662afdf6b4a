"""What is shipped, and what importing it costs."""

import re
import subprocess
import sys
from pathlib import Path

import gpubspline

ROOT = Path(__file__).resolve().parents[1]


def test_every_package_of_the_tree_is_named() -> None:
    named = set(
        re.findall(r'^  "(gpubspline[\w.]*)",$', (ROOT / "pyproject.toml").read_text().split("package-dir")[0], re.M)
    )
    source = ROOT / "src"
    found = {".".join(path.parent.relative_to(source).parts) for path in source.rglob("__init__.py")}
    assert named == found | {"gpubspline.bench", "gpubspline.kernels"}


def test_import_loads_no_backend() -> None:
    code = "import gpubspline, sys; print([m for m in ('warp', 'pyopencl', 'scipy', 'SimpleITK') if m in sys.modules])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"


def test_help_loads_no_backend() -> None:
    code = (
        "import sys; from gpubspline.cli.entry import app; app(['mesh', '--help'], standalone_mode=False);"
        "sys.exit([m for m in ('warp', 'pyopencl', 'scipy', 'SimpleITK', 'matplotlib') if m in sys.modules] != [])"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, check=False).returncode == 0


def test_public_names_resolve() -> None:
    text = (ROOT / "src/gpubspline/__init__.py").read_text()
    typed = set(re.findall(r"^    from gpubspline\.[\w.]+ import \w+ as (\w+)$", text, re.M))
    assert typed == set(gpubspline._MODULE_OF)
    assert all(getattr(gpubspline, name) is not None for name in typed)
    assert typed <= set(dir(gpubspline))
