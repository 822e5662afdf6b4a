"""The demo's femur under stance, solved by CalculiX too: displacements, reactions and stress at integration points."""

import os
import re
import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gpubspline.analysis.elasticity import solve
from gpubspline.analysis.gauss import gauss_stress, von_mises
from gpubspline.analysis.loads import AssembledLoads, assemble, load_case
from gpubspline.ct.phantom import phantom
from gpubspline.ct.region import otsu_threshold, region_from_threshold
from gpubspline.device import Device, open_device
from gpubspline.material.mapping import apply_material
from gpubspline.mesh.mesh import Mesh
from gpubspline.mesh.sample import sample
from gpubspline.spline.fit import fit
from gpubspline.spline.lattice import control_lattice

KINDS = {"C3D8": (1, (14, 24, 46)), "C3D20": (2, (7, 9, 18))}
"""Order and nodes: the demo's own mesh, and a coarser one, since curved elements take its direct solver longer."""


@dataclass(frozen=True, eq=False)
class Femur:
    """A loaded femur, and what CalculiX finds: (n, 3) mm, (n, 3) N, (g, m) MPa."""

    mesh: Mesh
    loads: AssembledLoads
    displacement_mm: Any
    reactions_n: Any
    von_mises_mpa: Any


@pytest.fixture(params=KINDS)
def femur(request: pytest.FixtureRequest) -> Femur:
    if shutil.which("ccx") is None:
        if os.environ.get("CI"):
            pytest.fail("CI needs CalculiX: apt-get install calculix-ccx")
        pytest.skip("CalculiX is not installed: apt-get install calculix-ccx")
    return loaded(request.param)


@cache
def loaded(kind: str) -> Femur:
    (order, nodes), device, volume = KINDS[kind], open_device(), phantom("adult-femur").scan()
    lattice = control_lattice(volume, region_from_threshold(volume, otsu_threshold(volume)), (14, 24, 46))
    mesh = sample(fit(lattice, degree=3, device=device).patch, nodes, order=order, device=device)
    mesh, _ = apply_material(mesh, device=device)
    loads = assemble(load_case("stance"), mesh)
    with tempfile.TemporaryDirectory() as folder:
        return Femur(mesh, loads, *calculix(mesh, loads, kind, Path(folder)))


def calculix(mesh: Mesh, loads: AssembledLoads, kind: str, folder: Path) -> tuple[Any, Any, Any]:
    """Each element of a material of its own; numbers of at most twenty characters, all that it reads."""
    lines = ["*NODE, NSET=all"]
    lines += [f"{i + 1},{x:.12E},{y:.12E},{z:.12E}" for i, (x, y, z) in enumerate(mesh.points)]
    lines.append(f"*ELEMENT, TYPE={kind}, ELSET=body")
    for number, row in enumerate(mesh.cells + 1):
        words = [str(number + 1), *map(str, row)]
        lines += [",".join(words[i : i + 12]) + ("," if i + 12 < len(words) else "") for i in range(0, len(words), 12)]
    for number, row in enumerate(mesh.cells):
        modulus, nu = (mesh.fields[name][row].astype(np.float64).mean() for name in ("E_MPa", "nu"))
        lines += [f"*ELSET, ELSET=e{number}", str(number + 1), f"*MATERIAL, NAME=m{number}", "*ELASTIC"]
        lines += [f"{modulus:.12E},{nu:.12E}", f"*SOLID SECTION, ELSET=e{number}, MATERIAL=m{number}"]
    lines += [
        "*BOUNDARY",
        *(f"{node + 1},{d + 1}" for node, d in np.argwhere(loads.fixed)),
        "*STEP",
        "*STATIC",
        "*CLOAD",
    ]
    lines += [f"{node + 1},{d + 1},{loads.forces_n[node, d]:.12E}" for node, d in np.argwhere(loads.forces_n)]
    lines += ["*NODE PRINT, NSET=all", "U,RF", "*EL PRINT, ELSET=body", "S", "*END STEP", ""]
    (folder / "femur.inp").write_text("\n".join(lines))
    done = subprocess.run(["ccx", "-i", "femur"], cwd=folder, capture_output=True, text=True, timeout=500, check=False)
    assert done.returncode == 0 and "*ERROR" not in done.stdout, done.stdout[-2000:]
    parts = re.split(r"\n ([a-z]+) \(.*\n", (folder / "femur.dat").read_text())
    tables = {name: rows(text) for name, text in zip(parts[1::2], parts[2::2], strict=True)}
    nodal = [np.zeros((mesh.n_nodes, 3)) for _ in range(2)]
    for values, name in zip(nodal, ("displacements", "forces"), strict=True):
        values[tables[name][:, 0].astype(int) - 1] = tables[name][:, 1:]
    n = 1 + mesh.element.order
    stress = tables["stresses"][:, 2:].T.reshape(6, mesh.n_elements, n, n, n)  # u fastest; ours has w fastest
    xx, yy, zz, xy, xz, yz = stress.transpose(0, 4, 3, 2, 1).reshape(6, n**3, mesh.n_elements)
    return *nodal, von_mises(np.stack([xx, yy, zz, xy, yz, xz]))


def rows(text: str) -> Any:
    return np.array([[float(word) for word in line.split()] for line in text.splitlines() if line.strip()])


def test_the_femur_under_stance_is_calculixs(femur: Femur, device64: Device) -> None:
    """Of the largest: displacements and reactions 1e-6, von Mises stress at every integration point 1e-5."""
    loads = femur.loads
    how: dict[str, Any] = {"modulus": "element", "device": device64, "tolerance": 1e-10}
    found = solve(femur.mesh, loads.fixed, loads.forces_n, **how)
    stress = von_mises(gauss_stress(femur.mesh, found.displacement_mm, modulus="element").stress)
    held = loads.fixed.any(axis=1)
    for ours, theirs, tolerance in (
        (found.displacement_mm, femur.displacement_mm, 1e-6),
        (found.reactions_n[held], femur.reactions_n[held], 1e-6),
        (stress, femur.von_mises_mpa, 1e-5),
    ):
        assert np.abs(ours - theirs).max() < tolerance * np.abs(theirs).max()
    np.testing.assert_allclose(found.reactions_n.sum(axis=0), -loads.applied_n, atol=1e-6 * 1500)
