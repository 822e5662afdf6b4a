"""The commands that write decks: 'export' on a mesh file, and 'mesh' with a load case."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from gpubspline.export import read_mesh, write
from gpubspline.mesh.elements import ELEMENTS
from gpubspline.mesh.mesh import Mesh

Command = Callable[..., tuple[int, str, str]]
PRESS = '[[fixed]]\nregion="surface"\ncomponents="x"\n[gravity]\nacceleration_mm_s2=[0,0,-9810]\n'


@pytest.fixture
def block(tmp_path: Path) -> Path:
    """A block of 12 hexes with a graded modulus, as a file."""
    axes = (np.linspace(0, size, n) for size, n in ((4, 3), (4, 3), (9, 4)))
    points = np.stack(np.meshgrid(*axes, indexing="ij")).reshape(3, -1, order="F").T
    hu = 200 + 100 * points[:, 2]
    fields = {"HU": hu, "E_MPa": 2 * hu, "nu": 0.3 + 0 * hu, "density_g_cm3": hu / 1000}
    write(Mesh(points, "hex8", structure=(3, 3, 4), fields=fields), tmp_path / "block.vtu")
    return tmp_path / "block.vtu"


def test_a_mesh_file_becomes_a_deck(run: Command, block: Path, tmp_path: Path) -> None:
    """What it says, what the summary says, and what the deck holds: weight of 1.1 g/cm3 on average in 144 mm3."""
    (tmp_path / "press.toml").write_text(PRESS)
    words = ("export", block, "-o", tmp_path / "a.k", "--load", tmp_path / "press.toml", "--modulus-bins", 3)
    status, out, err = run(*words, "--units", "m-N-Pa", "--summary", tmp_path / "a.json")
    assert (status, err) == (0, "")
    deck = json.loads((tmp_path / "a.json").read_text())["deck"]
    assert (deck["format"], deck["units"], deck["modulus"]["bins"]) == ("lsdyna", "m-N-Pa", 3)
    mass = 144 * np.mean([350, 650, 950]) * 1e-12
    np.testing.assert_allclose(deck["load"]["total_n"], [0, 0, -9810 * mass], rtol=1e-6, atol=1e-15)
    assert "lsdyna, m-N-Pa" in out and "modulus in 3 bins" in out and "press.toml" in out
    text = (tmp_path / "a.k").read_text()
    assert "*LOAD_BODY_Z" in text and "m, N, Pa, kg" in text


def test_a_format_by_name_and_quiet(run: Command, block: Path, tmp_path: Path) -> None:
    assert run("export", block, "-o", tmp_path / "a.dat", "--format", "nastran", "-q") == (0, "", "")
    assert (tmp_path / "a.dat").read_text().startswith("$ Units: mm, N, MPa")


def test_mesh_writes_the_load_case_that_solve_solves(run: Command, tmp_path: Path) -> None:
    from gpubspline.ct.phantom_dicom import write_phantom

    write_phantom("child-femur", tmp_path / "ct")
    wanted = ("mesh", tmp_path / "ct", "--control", "9,9,20", "--nodes", "6,6,12", "--load", "stance")
    status, out, err = run(*wanted, "-o", tmp_path / "femur.vtu", "--summary", tmp_path / "femur.json")
    assert status == 0 and "error" not in err
    assert "Single-legged stance: (0, 0, -328) N in all, 36 nodes held" in out
    fields = read_mesh(tmp_path / "femur.vtu").fields
    assert fields["force_n_z"].sum() == pytest.approx(-328) and fields["support_x"].sum() == 36
    status, out, err = run(*wanted, "-o", tmp_path / "femur.feb")
    assert status == 0 and "error" not in err and "febio, mm-N-MPa" in out


REFUSED = [
    (("-o", "a.inp", "--format", "patran"), "expected a format of abaqus"),
    (("-o", "a.inp", "--units", "inch"), "expected units of mm-N-MPa, m-N-Pa, got 'inch'"),
    (("-o", "a.txt"), "expected a mesh file of .inp, .vtu"),
    (("-o", "a.k", "--nodal-modulus"), "holds a modulus by node, got .k"),
    (("-o", "a.vtu", "--modulus-bins", "3"), "modulus bins with a deck"),
    (("-o", "a.cdb", "--modulus-bins", "0"), "--modulus-bins of 1 or more, got 0"),
    (("-o", "a.cdb", "--modulus-bins", "3", "--nodal-modulus"), "or modulus bins, got both"),
    (("-o", "a.su2", "--load", "stance"), "holds a load case, got .su2"),
    (("-o", "a.feb", "--load", "dance"), "a load case of stance"),
    (("-o", "block.vtu"), "a file of its own for each output"),
]


@pytest.mark.parametrize(("words", "message"), REFUSED)
def test_what_cannot_be_written_is_one_line(
    run: Command, block: Path, tmp_path: Path, words: tuple[str, ...], message: str
) -> None:
    status, out, err = run("export", block, "-o", tmp_path / words[1], *words[2:])
    assert (status, out) == (2, "") and message in err and err.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["block.vtu"]


def test_quadratic_elements_are_refused_where_there_are_none(run: Command, tmp_path: Path) -> None:
    vertices = np.array(ELEMENTS["hex20"].vertices, dtype=float)
    mesh = Mesh(vertices, "hex20", connectivity=np.arange(20, dtype=np.int32)[None])
    write(mesh, tmp_path / "one.vtu")
    for extension in (".k", ".vts", ".mdpa"):
        status, _, err = run("export", tmp_path / "one.vtu", "-o", tmp_path / f"a{extension}")
        assert status == 2 and f"for {extension}, got hex20" in err and err.count("\n") == 1
    for extension in (".feb", ".k"):
        status, _, err = run("export", tmp_path / "one.vtu", "-o", tmp_path / f"a{extension}")
        assert status == 2 and err.count("\n") == 1
