"""The command 'solve': a bar against its closed form, the shipped stance from a CT, and what is refused."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gpubspline.analysis.loads import load_case
from gpubspline.analysis.response import respond
from gpubspline.clock import Clock
from gpubspline.ct.phantom_dicom import write_phantom
from gpubspline.device import Device, open_device
from gpubspline.export import read_mesh, write
from gpubspline.mesh.mesh import Mesh

SIZE = np.array([10.0, 8, 40])
PULL = """
title = "A bar pulled at its end"
[regions.foot]
halfspace = { point_mm = [0, 0, 0], normal = [0, 0, -1] }
[regions.left]
halfspace = { point_mm = [0, 0, 0], normal = [-1, 0, 0] }
[regions.back]
halfspace = { point_mm = [0, 0, 0], normal = [0, -1, 0] }
[regions.end]
cap = { towards = [0, 0, 1], depth_mm = 1, within_deg = 45 }
[[fixed]]
region = "foot"
components = "z"
[[fixed]]
region = "left"
components = "x"
[[fixed]]
region = "back"
components = "y"
[[force]]
region = "end"
force_n = [0, 0, 160]
"""

Command = Callable[..., tuple[int, str, str]]


def bar() -> Mesh:
    """A bar of 1000 MPa and nu 0.25."""
    grid = np.stack(np.meshgrid(*(np.linspace(0, s, n) for s, n in zip(SIZE, (3, 3, 9), strict=True)), indexing="ij"))
    points = grid.reshape(3, -1, order="F").T
    material = {"E_MPa": np.full(len(points), 1000.0), "nu": np.full(len(points), 0.25)}
    return Mesh(points, "hex8", structure=(3, 3, 9), fields=material)


@pytest.fixture
def pulled(tmp_path: Path) -> list[Path]:
    """The bar as a file, and its load case."""
    files = [tmp_path / "bar.vtu", tmp_path / "pull.toml"]
    write(bar(), files[0])
    files[1].write_text(PULL)
    return files


@pytest.mark.parametrize("options", [(), ("--formulation", "incompatible"), ("--modulus", "element")], ids=str)
def test_a_pulled_bar_is_its_closed_form(
    run: Command, pulled: list[Path], tmp_path: Path, options: tuple[str, ...]
) -> None:
    """Stress F / A = 2 MPa, strain 2e-3 along the bar and -5e-4 across it, energy F u / 2."""
    out, summary = tmp_path / "out.vtu", tmp_path / "out.json"
    status, said, err = run("solve", pulled[0], "--load", pulled[1], "-o", out, "--summary", summary, *options)
    assert (status, err) == (0, "")
    found, figures = read_mesh(out), json.loads(summary.read_text())
    moved = np.stack([found.fields[f"displacement_mm_{axis}"] for axis in "xyz"], axis=1)
    np.testing.assert_allclose(moved, found.points * [-5e-4, -5e-4, 2e-3], atol=1e-7)
    np.testing.assert_allclose(found.fields["von_mises_mpa"], 2, rtol=1e-6)
    np.testing.assert_allclose(found.fields["principal_1_mpa"], 2, rtol=1e-6)
    np.testing.assert_allclose(found.fields["principal_3_mpa"], 0, atol=1e-6)
    np.testing.assert_allclose(found.fields["strain_energy_density"], 2e-3, rtol=1e-6)
    strain = [found.fields[f"strain_{name}"] for name in ("xx", "yy", "zz", "xy", "yz", "xz")]
    np.testing.assert_allclose(np.transpose(strain), np.tile([-5e-4, -5e-4, 2e-3, 0, 0, 0], (81, 1)), atol=1e-8)
    principal = [found.fields[f"principal_strain_{n}"] for n in (1, 2, 3)]
    np.testing.assert_allclose(np.transpose(principal), np.tile([2e-3, -5e-4, -5e-4], (81, 1)), atol=1e-8)
    assert {"stress_xx_mpa", "principal_2_mpa", "E_MPa"} <= found.fields.keys()
    assert found.structure == (3, 3, 9)  # known from its numbering
    assert figures["unknowns"] == 3 * 81 - 9 - 27 - 27 and 0 < figures["iterations"] < 243
    assert figures["residual"] <= 1e-8 and figures["seconds"]["total"] > 0
    assert figures["max_von_mises_mpa"] == pytest.approx(2, rel=1e-6)
    assert figures["p99_von_mises_mpa"] == pytest.approx(2, rel=1e-6)
    assert figures["max_displacement_mm"] == pytest.approx(np.linalg.norm(SIZE * [-5e-4, -5e-4, 2e-3]), rel=1e-6)
    assert figures["strain_energy_nmm"] == pytest.approx(160 * 0.08 / 2, rel=1e-6)
    np.testing.assert_allclose(figures["applied_n"], [0, 0, 160], atol=1e-9)
    np.testing.assert_allclose(figures["reaction_n"], [0, 0, -160], atol=1e-5)
    assert figures["regions"][-1]["area_mm2"] == pytest.approx(80)
    assert "pull.toml: A bar pulled at its end" in said and "Gauss points of all elements" in said


def test_stance_from_a_ct(run: Command, tmp_path: Path) -> None:
    """The left child femur: its head goes down and to the middle, and what is applied is what is held."""
    write_phantom("child-femur", tmp_path / "ct")
    out, summary = tmp_path / "out.vtu", tmp_path / "out.json"
    meshing = ("--control", "9,9,20", "--nodes", "6,6,12")
    status, said, err = run("solve", tmp_path / "ct", *meshing, "--load", "stance", "-o", out, "--summary", summary)
    assert status == 0 and "method     tensor: --control is for it" in said
    assert "the tensor mesh fills 14% less" in err and err.count("\n") == err.count("gpubspline: warning:") == 2
    figures, found = json.loads(summary.read_text()), read_mesh(out)
    assert figures["elements"] == 5 * 5 * 11 and figures["unknowns"] == 3 * 36 * 11
    np.testing.assert_allclose(figures["applied_n"], [0, 0, -328], atol=1e-9)
    np.testing.assert_allclose(figures["reaction_n"], [0, 0, 328], atol=1e-3)
    top = found.points[:, 2].argmax()
    assert found.fields["displacement_mm_z"][top] < 0 and found.fields["displacement_mm_x"][top] < 0
    assert figures["max_von_mises_mpa"] < figures["max_von_mises_at_point_mpa"] <= figures["max_von_mises_anywhere_mpa"]
    assert "over balls of 3 mm" in figures["max_von_mises_is"] and figures["max_von_mises_is"][:30] in said
    assert [part["region"] for part in figures["regions"]] == ["distal end", "femoral head", "greater trochanter"]


@pytest.mark.parametrize(("method", "elements"), [("butterfly", "8000"), ("blocks", "3000")])
def test_stance_by_the_other_methods(run: Command, tmp_path: Path, method: str, elements: str) -> None:
    """Elements of either bear the load of the tensor method's, and the femur gives way as much, within a third."""
    write_phantom("child-femur", tmp_path / "ct")
    moved = {}
    how = {method: ("--method", method, "--elements", elements), "tensor": ("--nodes", "11,14,20")}
    for name, meshing in how.items():
        out, summary = tmp_path / f"{name}.vtu", tmp_path / f"{name}.json"
        status, said, _ = run("solve", tmp_path / "ct", *meshing, "--load", "stance", "-o", out, "--summary", summary)
        assert status == 0 and f"method     {name}" in said
        figures = json.loads(summary.read_text())
        np.testing.assert_allclose(figures["reaction_n"], [0, 0, 328], atol=1e-3)
        moved[name] = figures["max_displacement_mm"]
    assert moved[method] == pytest.approx(moved["tensor"], rel=1 / 3)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["model.npz", "--method", "blocks"], "no options of a method with model.npz"),
        (["model.npz", "--elements", "900"], "no options of a method with model.npz"),
        (["bone.stl", "--method", "blocks"], "--ct, which the material of bone.stl comes from"),
        (["ct.nii.gz", "--method", "blocks", "--nodes", "9,9,9"], "no --nodes, which is for tensor"),
        (["bar.vtu", "--method", "blocks"], "without options that make a mesh"),
    ],
)
def test_methods_that_do_not_go_with_the_input_are_refused(
    run: Command, pulled: list[Path], tmp_path: Path, words: list[str], message: str
) -> None:
    before = sorted(tmp_path.iterdir())
    status, out, err = run("solve", tmp_path / words[0], *words[1:], "--load", pulled[1], "-o", tmp_path / "o.vtu")
    assert (status, out) == (2, "") and message in err and err.count("\n") == 1
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.parametrize("formulation", ["full", "incompatible", "bbar"])
def test_stress_holds_the_energy_of_the_solution(tmp_path: Path, formulation: str, device64: Device) -> None:
    """Integrated from the stress of the Gauss points, and half the work of the loads: two codes, any formulation."""
    mesh = bar()
    bent = PULL.replace('components = "z"', "").replace("[0, 0, 160]", "[30, -20, 10]")
    (tmp_path / "bent.toml").write_text(bent)
    mesh = mesh.with_fields({"E_MPa": 500 + 30 * mesh.points[:, 2], "nu": 0.2 + 0.02 * mesh.points[:, 0]})
    made = respond(mesh, load_case(tmp_path / "bent.toml"), device64, Clock(), formulation=formulation, tolerance=1e-12)
    work = float(np.sum(made.loads.forces_n * made.solution.displacement_mm)) / 2
    assert made.solution.strain_energy_nmm == pytest.approx(work, rel=1e-9)
    assert made.stress.figures.strain_energy_nmm == pytest.approx(work, rel=1e-9)


def test_the_clock_hears_the_residual(pulled: list[Path]) -> None:
    class Heard(Clock):
        def __init__(self) -> None:
            super().__init__()
            self.words: list[str] = []
            self.done: list[int] = []

        def tell(self, words: str) -> None:
            self.words.append(words)

        def advance(self, done: int, total: int) -> None:
            self.done.append(done)

    heard = Heard()
    made = respond(bar(), load_case(pulled[1]), open_device(), heard)
    assert len(heard.words) == made.solution.iterations and heard.words[-1].startswith("residual ")
    assert heard.done[-1] == 100 and min(heard.done) >= 0


BROKEN = {
    "region": (PULL.replace("depth_mm = 1,", "depth_mm = 1, colour = 2,"), "'colour' which is unknown"),
    "empty": (PULL.replace("point_mm = [0, 0, 0], normal = [0, 0, -1]", "point_mm = [0, 0, -9], normal = [0, 0, -1]"),
              "the region 'foot' to catch a part of the surface"),
    "floating": (PULL.replace('"z"', '"x"'), "supports that hold the mesh"),
    "free": (PULL.replace("[[fixed]]", "[[pressure]]").replace('components = "', 'pressure_mpa = 1 #'), "one support"),
    "broken": (PULL + "[", "expected TOML"),
    "side": (PULL.replace('region = "end"', 'region = "top"'), "one of surface, u0, u1, v0, v1, w0, w1, got 'top'"),
}  # fmt: skip


@pytest.mark.parametrize("name", BROKEN)
def test_bad_load_cases_are_one_line_and_write_nothing(
    run: Command, pulled: list[Path], tmp_path: Path, name: str
) -> None:
    text, message = BROKEN[name]
    pulled[1].write_text(text)
    refused(run(*command(pulled, tmp_path)), message, tmp_path)


def command(pulled: list[Path], folder: Path) -> list[Any]:
    return ["solve", pulled[0], "--load", pulled[1], "-o", folder / "o.vtu", "--summary", folder / "o.json"]


def refused(result: tuple[int, str, str], message: str, folder: Path) -> None:
    status, out, err = result
    assert (status, out) == (2, "") and message in err and err.count("\n") == 1
    assert sorted(path.name for path in folder.iterdir()) == ["bar.vtu", "pull.toml"]


MATERIALS = {
    "none": ({}, "E_MPa and nu"),
    "zero": ({"E_MPa": 0.0, "nu": 0.3}, "positive moduli"),
    "negative": ({"E_MPa": -5.0, "nu": 0.3}, "positive moduli, got a least of -5 MPa"),
    "incompressible": ({"E_MPa": 1.0, "nu": 0.5}, "below 0.5"),
}


@pytest.mark.parametrize("name", MATERIALS)
def test_bad_materials_are_one_line_and_write_nothing(
    run: Command, pulled: list[Path], tmp_path: Path, name: str
) -> None:
    material, message = MATERIALS[name]
    mesh = bar()
    fields = {key: np.full(mesh.n_nodes, value) for key, value in material.items()}
    write(Mesh(mesh.points, "hex8", structure=mesh.structure, fields=fields), pulled[0])
    refused(run(*command(pulled, tmp_path)), message, tmp_path)


def test_bad_options_are_one_line_and_write_nothing(run: Command, pulled: list[Path], tmp_path: Path) -> None:
    given = command(pulled, tmp_path)
    mesh = bar()
    for words, message in [
        (["solve", *given[1:3], "jump", *given[4:]], "expected a load case of stance, or a .toml file, got 'jump'"),
        ([*given[:5], tmp_path / "o.inp", *given[6:]], "a file that holds displacement and stress, such as .vtu"),
        ([*given, "--formulation", "reduced"], "full, incompatible, bbar, got 'reduced'"),
        ([*given, "--modulus", "mean"], "'mean'"),
        ([*given, "--tolerance", "0"], "positive tolerance"),
        ([*given, "--nodes", "3,3,3"], "one mesh file, without options that make a mesh"),
        ([*given[:5], pulled[0], *given[6:]], "a file of its own for each output"),
        ([*given[:7], pulled[1]], "a file of its own for each output"),
    ]:
        refused(run(*words), message, tmp_path)
    moved = mesh.points.copy()
    moved[40] += [0, 0, 12]  # the node in the middle, past its neighbour
    write(Mesh(moved, "hex8", structure=mesh.structure, fields=mesh.fields), pulled[0])
    refused(run(*given), "inverted", tmp_path)
