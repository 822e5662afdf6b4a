"""The command that makes the hexes of a mesh file better."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from gpubspline.export import read_mesh, write
from gpubspline.mesh.mesh import Mesh

Command = Callable[..., tuple[int, str, str]]


@pytest.fixture
def bent(tmp_path: Path) -> Path:
    """A block of 48 hexes whose inner nodes are moved, as a file."""
    counts = (5, 5, 4)
    at = np.stack(np.meshgrid(*[np.arange(n) for n in counts], indexing="ij"), axis=-1).reshape(-1, 3, order="F")
    inside = ((at > 0) & (at < np.array(counts) - 1)).all(axis=1, keepdims=True)
    points = at + 0.4 * np.random.default_rng(0).uniform(-1, 1, at.shape) * inside
    write(Mesh(points, "hex8", structure=counts, fields={"HU": 10 * points[:, 0]}), tmp_path / "bent.vtu")
    return tmp_path / "bent.vtu"


def test_optimize_writes_a_better_mesh(run: Command, bent: Path, tmp_path: Path) -> None:
    better, summary = tmp_path / "better.vtu", tmp_path / "s.json"
    status, out, err = run("optimize", bent, "-o", better, "--summary", summary)
    assert status == 0, err
    done = json.loads(summary.read_text())["optimized"]
    assert done["after"] > done["before"] + 0.1 and f"to {done['after']:.3f}" in out
    old, new = read_mesh(bent), read_mesh(better)
    assert np.array_equal(old.cells, new.cells)
    assert new.fields["HU"] == pytest.approx(10 * new.points[:, 0], abs=1e-3)
    assert new.volume_mm3 == pytest.approx(old.volume_mm3, rel=1e-4)


def test_optimize_refuses(run: Command, bent: Path, tmp_path: Path) -> None:
    for words, text in (
        ([tmp_path / "none.vtu"], "none.vtu"),
        ([bent, "--surface", "fly"], "slide or stay"),
        ([bent, "--summary", bent], "of its own"),
        ([bent, "--summary", tmp_path / "s.txt"], "a file of figures that ends in .json, got s.txt"),
    ):
        status, _, err = run("optimize", *words, "-o", tmp_path / "b.vtu")
        assert status == 2 and text in err and err.count("\n") == 1
        assert not (tmp_path / "b.vtu").exists()


def test_advice_names_what_the_command_has(run: Command, bent: Path, tmp_path: Path) -> None:
    """An element turned inside out, all of whose nodes are on the surface, stays so."""
    mesh = read_mesh(bent)
    points = mesh.points.copy()
    points[0] += 5
    write(Mesh(points, "hex8", connectivity=mesh.cells), tmp_path / "out.vtu")
    for words, advice in (
        (["--surface", "stay"], "try --surface slide, or ask"),
        ([], "try 'gpubspline mesh --method blocks', or ask"),
    ):
        status, _, err = run("optimize", tmp_path / "out.vtu", *words, "-o", tmp_path / "b.vtu")
        assert status == 2 and advice in err and "--optimize" not in err, err
