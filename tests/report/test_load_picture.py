"""The picture of a load case: regions have their areas and colours, arrows go as the forces do."""

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.image import imread

from gpubspline.analysis.load_case import read_load_case
from gpubspline.export import write
from gpubspline.mesh.mesh import Mesh
from gpubspline.report.load_picture import COLOURS, draw_load_picture, where_it_acts

CASE = """title = "A block pressed"
fixed = [{region = "w0"}]
force = [{region = "tip", force_n = [0, 0, -100]}, {region = "u1", force_n = [30, 0, 0]}]
pressure = [{region = "surface", pressure_mpa = 0.5}]
[regions.tip]
box = { low_mm = [-1, -1, 3.9], high_mm = [1.5, 9, 5] }
cap = { towards = [0, 0, 1], depth_mm = 1, within_deg = 45 }
"""


def block():
    axes = [np.arange(n) for n in (5, 4, 5)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3, order="F").astype(float)
    return Mesh(points, "hex8", structure=(5, 4, 5), fields={"HU": np.full(len(points), 500.0)})


def test_faces_have_their_share_of_a_region():
    mesh = block()
    surface, (held, tip, side, all_round) = where_it_acts(mesh, read_load_case(CASE, "press"))
    area = surface.areas_mm2.sum(axis=1)
    assert [each.applied.region for each in (held, tip, side, all_round)] == ["w0", "tip", "u1", "surface"]
    assert (tip.share * area).sum() == pytest.approx(tip.applied.area_mm2) == pytest.approx(1.5 * 3, rel=0.02)
    assert set(np.round(tip.share, 1)) == {0.0, 0.5, 1.0} and np.count_nonzero(tip.share > 0.99) == 3
    assert (side.share * area).sum() == pytest.approx(12) and np.all(all_round.share == pytest.approx(1))
    assert np.count_nonzero(held.share == 1) == 12 and np.count_nonzero(held.share) == 12 + 14  # those beside in half
    assert held.outward @ [0, 0, 1] < 0 < side.outward @ [1, 0, 0]


def test_colours_and_arrows():
    """A force that pushes ends at its region, one that pulls begins there; what faces away is pale."""
    figure = draw_load_picture(block(), read_load_case(CASE, "press"), view=(0, -1, 0))
    words = [text.get_text().replace("\n", " ") for text in figure.texts]
    assert "tip: force (0, 0, -100) N, 4.5 mm², 12 nodes" in words and "w0: held, 12 mm², 20 nodes" in words
    assert "surface: pressure (0, 0, 0) N, 80 mm², 82 nodes" in words
    push, pull = figure.axes[0].patches  # x to the right, z up
    np.testing.assert_allclose(push._posA_posB, [[0.75, 4 + 0.1 * 4], [0.75, 4]], atol=0.02)
    np.testing.assert_allclose(pull._posA_posB, [[4, 2], [4 + 0.1 * 4, 2]], atol=0.02)


def test_the_command(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write(block(), "m.vtu")
    (tmp_path / "press.toml").write_text(CASE)
    status, out, err = run("view", "m.vtu", "--load", "press.toml", "--from", "ALS", "-o", "p.png")
    assert (status, out, err) == (0, "wrote p.png, with the regions of A block pressed\n", "")
    pixels = imread("p.png")[..., :3]
    direction = pixels / np.maximum(np.linalg.norm(pixels, axis=2, keepdims=True), 1e-9)
    for place in range(4):  # also the small ones that lie in that of the whole surface
        colour = np.array(to_rgb(COLOURS[place]))
        assert np.mean(direction @ (colour / np.linalg.norm(colour)) > 0.999) > 0.008, place
    (tmp_path / "bad.toml").write_text(CASE.replace("3.9]", "7]").replace("5] }", "8] }"))
    for words in (["--load", "none.toml"], ["--load", "bad.toml"], ["--load", "press.toml", "--field", "HU"]):
        status, out, err = run("view", "m.vtu", *words, "-o", "q.png")
        assert (status, out) == (2, "") and err.count("\n") == 1 and not (tmp_path / "q.png").exists()
