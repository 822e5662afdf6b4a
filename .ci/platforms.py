"""Whether the package installs without a compiler elsewhere: asks pip for wheels of everything, for each platform.

    python .ci/platforms.py

Prints a table for docs/installing.md; run by hand, since it asks the registry. Markers of this project's own
requirements are taken for the platform that is asked about, those of requirements' requirements by pip for this one.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

from packaging.requirements import Requirement

try:
    import tomllib
except ImportError:  # Python 3.10
    import tomli as tomllib

ROOT = Path(__file__).resolve().parents[1]
PYTHONS = ("3.10", "3.12", "3.13")
EXTRAS = ("view", "hdf", "cohort")
GLIBC = ("2014", "_2_17", "_2_27", "_2_28")
PLATFORMS = {
    "Linux x86-64": ("linux", "x86_64", [f"manylinux{v}_x86_64" for v in GLIBC]),
    "Linux ARM": ("linux", "aarch64", [f"manylinux{v}_aarch64" for v in (*GLIBC, "_2_34", "_2_35")]),
    "macOS ARM": ("darwin", "arm64", ["macosx_14_0_arm64"]),
    "macOS Intel": ("darwin", "x86_64", ["macosx_14_0_x86_64"]),
    "Windows x86-64": ("win32", "AMD64", ["win_amd64"]),
}


def requirements(sys_platform: str, machine: str, python: str, extra: str | None) -> list[str]:
    """Give the requirements of the package, or of one of its extras, on a platform."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    given = project["dependencies"] if extra is None else project["optional-dependencies"][extra]
    known = {"sys_platform": sys_platform, "platform_machine": machine, "python_version": python}
    needed = [r for r in map(Requirement, given) if r.marker is None or r.marker.evaluate(known)]
    return [f"{r.name}{'[' + ','.join(r.extras) + ']' if r.extras else ''}{r.specifier}" for r in needed]


def missing(tags: list[str], python: str, needed: list[str]) -> str:
    """What pip says where there is not a wheel of everything; empty where there is."""
    with tempfile.TemporaryDirectory() as scratch:
        words = ["--dry-run", "--ignore-installed", "--only-binary=:all:", "--quiet", "--target", scratch]
        words += ["--report", f"{scratch}/report.json", "--python-version", python, "--implementation", "cp"]
        words += [word for tag in tags for word in ("--platform", tag)]
        command = [sys.executable, "-m", "pip", "install", *words, *needed]
        run = subprocess.run(command, capture_output=True, text=True, check=False)
        if run.returncode == 0:
            return f"{len(json.loads(Path(scratch, 'report.json').read_text())['install'])} wheels"
        said = [line for line in run.stderr.splitlines() if "No matching distribution" in line or "conflict" in line]
        return "no: " + (said[0].removeprefix("ERROR: ") if said else run.stderr.strip().splitlines()[-1])


def main() -> None:
    """Print a row a platform, or those whose names are given."""
    print(f"| | {' | '.join('Python ' + python for python in PYTHONS)} | extras, Python {PYTHONS[1]} |")
    print("|---" * (len(PYTHONS) + 2) + "|")
    for name, (*system, tags) in PLATFORMS.items():
        if sys.argv[1:] and name not in sys.argv[1:]:
            continue
        cells = [missing(tags, python, requirements(*system, python, None)) for python in PYTHONS]
        found = {e: missing(tags, PYTHONS[1], requirements(*system, PYTHONS[1], e)) for e in EXTRAS}
        cells.append(", ".join(e if not said.startswith("no") else f"{e}: {said}" for e, said in found.items()))
        print(f"| {name} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
