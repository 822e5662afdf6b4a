"""Laws side by side on a bar whose stiffness is known."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from gpubspline.analysis.law_comparison import compare_laws, long_axis
from gpubspline.device import Device
from gpubspline.errors import InputError
from gpubspline.export import write
from gpubspline.material.laws import DensityRelation, Law, Piece
from gpubspline.mesh.mesh import Mesh
from gpubspline.report.law_comparison import modulus_curve

Command = Callable[..., tuple[int, str, str]]
TURN = np.array([[0.6, 0.0, 0.8], [0.0, 1.0, 0.0], [-0.8, 0.0, 0.6]])


def bar(n: int = 11) -> Mesh:
    """4 x 5 x 30 mm, lying obliquely, of 500 HU."""
    axes = [np.linspace(0, s, k) for s, k in zip((4.0, 5.0, 30.0), (3, 3, n), strict=True)]
    points = np.stack([a.ravel(order="F") for a in np.meshgrid(*axes, indexing="ij")], axis=1) @ TURN.T
    return Mesh(points, "hex8", structure=(3, 3, n), fields={"HU": np.full(len(points), 500.0)})


def straight(name: str, factor: float, poisson: float, top: float = 3000.0) -> Law:
    return Law(name, "E = factor rho", DensityRelation("ash", 0.001), (Piece(1.0, top, factor, 1.0, 0.0, poisson),))


def test_stiffness_of_a_bar(device: Device) -> None:
    """Without Poisson's effect E A / L: 500 MPa times 20 mm2 over 30 mm; with it, held ends are stiffer."""
    laws = [straight("one", 1000.0, 0.0), straight("twice", 2000.0, 0.0), straight("wide", 1000.0, 0.3, 400.0)]
    one, twice, wide = compare_laws(bar(), laws, device)
    assert one.stiffness_n_mm == pytest.approx(500 * 20 / 30, rel=1e-4)
    assert one.mean_modulus_mpa == pytest.approx(500, rel=1e-5)
    assert twice.stiffness_n_mm == pytest.approx(2 * 500 * 20 / 30, rel=1e-4)
    assert wide.outside == 1.0 and wide.mean_modulus_mpa == pytest.approx(400, rel=1e-5)
    assert wide.stiffness_n_mm is not None and 400 * 20 / 30 < wide.stiffness_n_mm < 1.1 * 400 * 20 / 30
    assert abs(long_axis(bar()) @ TURN[:, 2]) == pytest.approx(1)


def test_what_cannot_be_compared(device: Device) -> None:
    quad = Mesh(np.eye(4, 3), "quad4", structure=(2, 2), fields={"HU": np.zeros(4)})
    with pytest.raises(InputError, match="hexes with the nodal field HU"):
        compare_laws(quad, [straight("one", 1.0, 0.0)], device)
    hexes = bar()
    wild = hexes.with_fields({"HU": np.where(np.arange(hexes.n_nodes) == 3, np.nan, 100.0)})
    with pytest.raises(InputError, match="finite HU"):
        compare_laws(wild, [straight("one", 1.0, 0.0)], device)


def test_a_curve_breaks_where_the_law_jumps() -> None:
    two = (Piece(0.0, 100.0, 1000.0, 1.0, 1.0), Piece(100.0, 200.0, 3000.0, 1.0))
    hu, modulus = modulus_curve(Law("two", "two", DensityRelation("ash", 0.001), two), 3)
    assert hu.tolist() == [0, 50, 100, 100, 100, 150, 200, 200]
    np.testing.assert_allclose(modulus, [1, 51, 101, np.nan, 300, 450, 600, np.nan])


def test_the_command(run: Command, tmp_path: Path) -> None:
    model, picture, figures = tmp_path / "bar.vtu", tmp_path / "laws.png", tmp_path / "laws.json"
    write(bar(), model)
    status, out, err = run("laws", "--compare", model, "-o", picture, "--summary", figures, "--no-stiffness")
    assert (status, err) == (0, "")
    assert "wirtz-2000 " in out and "unconfirmed in part" in out and picture.stat().st_size > 20_000
    assert "stiffness" not in out
    assert '"law": "keyak-1998"' in figures.read_text()
    for options, message in (
        (["-o", picture], "expected --compare MODEL"),
        (["--compare", model, "-o", tmp_path / "p.jpg"], "ends in .png"),
        (["--compare", tmp_path / "none.vtu"], "none.vtu"),
    ):
        status, _, err = run("laws", *options)
        assert status == 2 and message in err and err.count("\n") == 1
