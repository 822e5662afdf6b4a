"""No mesh with an inverted element is written unless that is asked for by name."""

from collections.abc import Callable
from pathlib import Path

import meshio
import numpy as np
import pytest

from gpubspline.mesh.mesh import Mesh
from gpubspline.spline.hyperpatch import hyperpatch
from gpubspline.spline.model import save_model

Command = Callable[..., tuple[int, str, str]]

REFUSED = "elements are inverted, the worst at ("


@pytest.fixture
def folded(tmp_path: Path) -> Path:
    """A model file of a block of 50 mm, one of whose control points went through the opposite side of its cell."""
    axis = np.linspace(0, 50, 6)
    place = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1)
    place[3, 3, 3, 0] -= 40
    save_model(hyperpatch(np.concatenate([place, np.full((6, 6, 6, 1), 800.0)], axis=-1), 2), tmp_path / "folded.npz")
    return tmp_path / "folded.npz"


@pytest.mark.parametrize("name", ["m.vtu", "m.vts", "m.inp"])
def test_a_folded_solid_is_refused(run: Command, folded: Path, tmp_path: Path, name: str) -> None:
    asked = ["sample", folded, "-o", tmp_path / name, "--nodes", "21,21,21", "--summary", tmp_path / "s.json"]
    status, _, err = run(*asked)
    assert status == 2 and REFUSED in err and "--allow-inverted" in err and len(err.strip().splitlines()) == 1
    assert [path.name for path in tmp_path.iterdir()] == ["folded.npz"]
    status, out, _ = run(*asked, "--allow-inverted")
    assert status == 0 and " 0 inverted" not in out and (tmp_path / name).stat().st_size > 1000


def test_what_optimisation_cannot_mend_is_refused(run: Command, tmp_path: Path) -> None:
    corners = np.stack(np.meshgrid(*[[0.0, 1.0]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    turned = np.array([[0, 2, 6, 4, 1, 3, 7, 5]])  # left-handed, and every node of it is on the boundary
    path = tmp_path / "turned.vtu"
    mesh = Mesh(corners, "hex8", connectivity=turned.astype(np.int32))
    meshio.write_points_cells(path, mesh.points, [("hexahedron", mesh.cells)])
    status, _, err = run("optimize", path, "-o", tmp_path / "m.vtu", "--surface", "stay")
    assert status == 2 and "1 of 1 " + REFUSED in err and [each.name for each in tmp_path.iterdir()] == ["turned.vtu"]
    assert run("optimize", path, "-o", tmp_path / "m.vtu", "--surface", "stay", "--allow-inverted")[0] == 0
    assert (tmp_path / "m.vtu").exists()
