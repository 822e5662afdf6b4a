"""Pictures: what is near hides what is far, colours are those of the bar, and no display is asked for."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread

from gpubspline.errors import InputError
from gpubspline.mesh.mesh import Mesh
from gpubspline.report.camera import Camera
from gpubspline.report.painter import Shell, _split, paint
from gpubspline.report.picture import draw_picture, write_picture
from gpubspline.report.quantity import DISTINCT, Quantity, quantity


def box(counts: tuple[int, ...] = (4, 5, 6)) -> Mesh:
    """Unit elements; the nodal field is the height, the element field the number along u."""
    grid = np.meshgrid(*(np.arange(float(n)) for n in counts), indexing="ij")
    points = np.stack([a.ravel(order="F") for a in grid], axis=1)
    mesh = Mesh(points, "hex8", structure=counts, fields={"HU": 100 * points[:, 2], "E_MPa": 10 * 4 ** points[:, 2]})
    return mesh.with_cell_fields({"scaled_jacobian": np.linspace(0, 1, mesh.n_elements)})


def slice_mesh(hu: float) -> Mesh:
    """Axial quads of one HU, 0..3 by 0..3 mm."""
    x, y = np.meshgrid(np.arange(4.0), np.arange(4.0), indexing="ij")
    points = np.stack([x.ravel(order="F"), y.ravel(order="F"), np.full(16, 7.0)], axis=1)
    return Mesh(points, "quad4", structure=(4, 4), fields={"HU": np.full(16, hu)})


def drawn(shell: Shell, camera: Camera, low: float, high: float) -> np.ndarray:
    """Pixels (100, 100, 3) of a shell painted alone on -1..1 mm, in grey."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure = Figure(figsize=(1, 1), dpi=100)
    canvas = FigureCanvasAgg(figure)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set_axis_off()
    axes.set_xlim(-1, 1)
    axes.set_ylim(-1, 1)
    paint(axes, shell, camera, Quantity("", "gray", (low, high)).scale(shell.values)[0], flat=True)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].astype(float) / 255


def square(height: float, half: float = 1.0) -> np.ndarray:
    return np.array([[-half, -half, height], [half, -half, height], [half, half, height], [-half, half, height]])


def test_near_hides_far_whatever_the_order() -> None:
    camera = Camera.looking((0, 0, 1))
    corners, values = np.stack([square(0.0), square(1.0, 0.5)]), np.repeat([[0.2], [0.9]], 4, axis=1)
    for order in ([0, 1], [1, 0]):
        pixels = drawn(Shell(corners[order], values[order]), camera, 0.0, 1.0)
        np.testing.assert_allclose(pixels[50, 45], 0.9, atol=0.01)
        np.testing.assert_allclose(pixels[50, 10], 0.2, atol=0.01)


def test_colour_runs_smoothly_across_an_element() -> None:
    values = np.array([[0.0, 1.0, 1.0, 0.0]])  # rises with x: to the left of the picture when seen with anterior up
    camera = Camera.looking((0, 0, -1))
    row = drawn(Shell(square(0.0)[None], values), camera, 0.0, 1.0)[50, 5:95, 0]
    np.testing.assert_allclose(row, np.linspace(0.05, 0.95, 90), atol=0.06)  # twelve steps


def test_split_is_a_partition() -> None:
    corners = np.random.default_rng(1).normal(size=(6, 4, 2)) * 0.2 + square(0.0)[:, :2]
    patches = _split(corners, 5)
    assert patches.shape == (6, 25, 4, 2)

    def area(quads: np.ndarray) -> np.ndarray:
        (x0, y0), (x1, y1) = (
            np.moveaxis(quads[..., 2, :] - quads[..., 0, :], -1, 0),
            np.moveaxis(quads[..., 3, :] - quads[..., 1, :], -1, 0),
        )
        return (x0 * y1 - y0 * x1) / 2

    np.testing.assert_allclose(area(patches).sum(axis=1), area(corners), rtol=1e-12)
    np.testing.assert_allclose(_split(corners, 1)[:, 0], corners, rtol=1e-15)


@pytest.mark.parametrize("field", ["HU", "E_MPa", "scaled_jacobian"])
def test_picture_of_hexes(tmp_path: Path, field: str) -> None:
    write_picture(box(), tmp_path / "box.png", field=field)
    pixels = imread(tmp_path / "box.png")
    assert min(pixels.shape[:2]) >= 600
    assert np.mean(np.any(pixels[..., :3] < 0.9, axis=2)) > 0.1  # a good part of the sheet is body
    assert np.all(pixels[0] == 1.0) and np.all(pixels[:, 0] == 1.0)  # and nothing runs over its border
    assert [path.name for path in tmp_path.iterdir()] == ["box.png"]


def test_picture_of_a_slice_has_the_colour_of_its_value(tmp_path: Path) -> None:
    write_picture(slice_mesh(300.0), tmp_path / "slice.png")
    pixels = imread(tmp_path / "slice.png")
    expected = quantity("HU").scale(np.array([300.0]))[0].to_rgba(300.0)
    body = np.all(np.abs(pixels[..., :3] - expected[:3]) < 0.02, axis=2)
    assert np.mean(body) > 0.3


def test_one_clip_does_not_darken_the_rest() -> None:
    values = np.append(np.linspace(0, 1000, 10_000), 30_000.0)
    scale, extend = quantity("HU").scale(values)
    assert scale.get_clim()[1] < 1001 and extend == "max"
    assert quantity("scaled_jacobian").scale(np.array([-0.4, 0.9]))[1] == "min"
    assert quantity("HU").scale(np.full(3, 7.0))[0].get_clim() == (6.5, 7.5)


def test_each_label_has_a_colour_of_its_own_however_few_elements_it_has() -> None:
    labels = np.repeat([22, 7, 50], [4000, 3, 900])
    scale = quantity("label").by_number(labels)
    colours = scale.to_rgba(np.array([7, 22, 50]))[:, :3]
    assert np.allclose(colours, DISTINCT[:3]) and np.allclose(scale.norm.boundaries, [6.5, 21.5, 49.5, 50.5])
    mesh = box().with_cell_fields({"label": np.repeat([7, 22, 50], 20)})
    figure = draw_picture(mesh, field="label")
    assert [tick.get_text() for tick in figure.axes[-1].get_yticklabels()] == ["7", "22", "50"]


def test_modulus_over_decades_is_shown_by_its_logarithm() -> None:
    scale, _ = quantity("E_MPa").scale(np.geomspace(50, 5000, 1000))
    middle = scale.norm(500.0)
    assert middle == pytest.approx(0.5, abs=0.01)
    narrow, _ = quantity("E_MPa").scale(np.linspace(1000, 3000, 1000))
    assert narrow.norm(2000.0) == pytest.approx(0.5, abs=0.01)
    assert quantity("E_MPa").scale(np.array([0.0, 5000.0]))[0].norm(2500.0) == pytest.approx(0.5, abs=0.01)


def test_degenerate_elements_are_drawn(tmp_path: Path) -> None:
    mesh = box((2, 2, 2))
    flat = Mesh(mesh.points * (1.0, 1.0, 0.0), "hex8", structure=(2, 2, 2), fields=mesh.fields)
    write_picture(flat, tmp_path / "flat.png", title="flat", view=(1, 0, 1))
    assert (tmp_path / "flat.png").stat().st_size > 1000


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("box.png", {"field": "stress"}, r"field of the mesh \(HU, E_MPa, scaled_jacobian\) .*, got 'stress'"),
        ("box.jpg", {}, r"ends in \.png, got box\.jpg"),
        ("none/box.png", {}, "does not exist"),
        ("box.png", {"view": (0, 0, 0)}, "three numbers that are not all 0"),
        ("box.png", {"view": (1, 0)}, "three numbers"),
    ],
)
def test_bad_input_leaves_nothing_behind(tmp_path: Path, name: str, options: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        write_picture(box(), tmp_path / name, **options)
    assert not list(tmp_path.iterdir())


def test_neither_a_display_nor_vtk_is_asked_for() -> None:
    program = (
        "import sys; import gpubspline.report.picture, gpubspline.report.histogram; "
        "print([name for name in ('matplotlib.pyplot', 'tkinter', 'vtkmodules', 'pyvista') if name in sys.modules])"
    )
    finished = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert finished.stdout.strip() == "[]"
