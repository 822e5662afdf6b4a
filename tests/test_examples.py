"""Every example runs as a script, prints the figures it is there for, and is headed by equation, source and figure."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from gpubspline.device import Device

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
DATA = Path(__file__).resolve().parents[2] / "shared" / "data" / "head" / "ct_example.nii.gz"
EXPECTED = {
    "head_2d": r"19,321 quads, 9[89]\.\d% above 0\.5, 0 inverted",
    "head_3d": r"40,527 hexes, 9[5-7]\.\d% above 0\.5, 0 inverted",
    "femur": r"13,455 hexes, 91\.0% above 0\.5, 0 inverted\nE 56 to 10\d{3} MPa",
    "own_law": r"my-femur: E 98 to 142\d\d MPa; unconfirmed: Poisson's ratio",
    "own_format": r"6,732 nodes, E from 56 to 96\d\d MPa",
    "own_kernel": r"31\d\d m/s in the cortex, within [1-9]e-0[67]",
    "calibration": r"404\.\d HU: known 0\.400, fitted 0\.400 g/cm3\noff by 0\.000\d g/cm3",
    "stance": r"moved 11\.\d\d mm at most, forces balance to \de-0[5-9] N",
    "study": r"640 elements: 8\d\.\d MPa\n.* 5,610 elements: \d{2,3}\.\d MPa",
    "any_topology": r"1,402 hexes, scaled Jacobian from 0\.7\d, Euler characteristic {'mesh': 0, 'region': 0}",
    "report": r"5,610 hexes, scaled Jacobian from 0\.15",
    "cohort": r"2 models, 1 failed; 0 of 3 kept[^$]*exit status 1\nand again:[^$]*3 of 3 kept",
}


def test_every_example_is_here() -> None:
    assert {path.stem for path in EXAMPLES.glob("*.py")} == EXPECTED.keys()


@pytest.mark.parametrize("name", EXPECTED)
def test_example(name: str, tmp_path: Path) -> None:
    words = [str(DATA)] if name.startswith("head") and DATA.exists() else []
    command = [sys.executable, "-W", "error::DeprecationWarning:__main__", str(EXAMPLES / f"{name}.py"), *words]
    run = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert run.returncode == 0 and run.stderr == "", run.stderr
    assert re.search(EXPECTED[name], run.stdout, re.S), run.stdout
    text = (EXAMPLES / f"{name}.py").read_text()
    made = [path.name for path in tmp_path.iterdir()]
    assert made and all(f'"{name}"' in text for name in made)


@pytest.mark.parametrize("name", EXPECTED)
def test_heading(name: str) -> None:
    heading = ast.get_docstring(ast.parse((EXAMPLES / f"{name}.py").read_text())) or ""
    assert re.search(r"^Equation:  \S.*^Source:    \S.*^Figure:    \S", heading, re.M | re.S)


def test_own_kernel_is_one_on_both_backends(any_device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(EXAMPLES)
    modulus, poisson, density = np.array([1e3, 17e3, 500.0]), np.array([0.3, 0.36, 0.0]), np.array([1.0, 1.9, 0.0])
    out = any_device.empty(3)
    inputs = [any_device.put(values) for values in (modulus, poisson, density)]
    any_device.launch("own_kernels.ultrasound.speed", 3, *inputs, 3, out)
    stiffness = 1e9 * modulus * (1 - poisson) / ((1 + poisson) * (1 - 2 * poisson)) / 1e6
    assert np.allclose(any_device.get(out)[:2], np.sqrt(stiffness[:2] / density[:2]), rtol=1e-6)
    assert any_device.get(out)[2] == 0
