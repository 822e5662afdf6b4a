"""Every figure of the guide, made from the code: ``python docs/scripts/figures.py FOLDER`` writes them all."""

import io
import sys
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np

import gpubspline as gb
from gpubspline.spline.knots import clamped_uniform

matplotlib.use("Agg")

import matplotlib.pyplot as plt

INK, LINE, DOT = "#22252b", "#9aa1ad", "#3b6ea5"


@cache
def _scan() -> tuple[Any, Any]:
    volume = gb.phantom("child-femur").scan()
    return volume, gb.region_from_threshold(volume, gb.otsu_threshold(volume))


@cache
def _femur() -> Any:
    volume, region = _scan()
    device = gb.open_device()
    patch = gb.fit(gb.control_lattice(volume, region, (11, 18, 34)), degree=3, device=device).patch
    mesh, _ = gb.apply_material(gb.sample(patch, (11, 18, 34), device=device), device=device)
    return gb.assess(mesh, device)[0]


def _svg(figure: Any) -> str:
    text = io.StringIO()
    figure.savefig(text, format="svg", bbox_inches="tight", metadata={"Date": None})
    plt.close(figure)
    return text.getvalue()


def _png(mesh: Any, **how: Any) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "figure.png"
        gb.write_picture(mesh, path, **how)
        return path.read_bytes()


def _bare(axes: Any, title: str) -> None:
    axes.set_title(title, fontsize=10, color=INK)
    axes.set_aspect("equal")
    axes.axis("off")


def lattice() -> str:
    """From a slice to its quads: samples, rows cut at the boundary, control points, mesh."""
    volume, region = _scan()
    device, k = gb.open_device(), 26
    control = gb.control_lattice(volume, region, (11, 14), slice_index=k).points
    patch = gb.fit(gb.control_lattice(volume, region, (11, 14), slice_index=k), degree=3, device=device).patch
    mesh = gb.sample(patch, (16, 20), device=device)
    x, y = control[..., 0], control[..., 1]
    box = (x.min() - 6, x.max() + 6, y.max() + 6, y.min() - 6)
    hu, (ni, nj, _) = volume.hu[k], volume.shape
    corner, far = volume.to_points(np.array([[-0.5, -0.5, k], [ni - 0.5, nj - 0.5, k]]))
    image: dict[str, Any] = {"cmap": "gray", "extent": (corner[0], far[0], far[1], corner[1])}
    figure, panels = plt.subplots(1, 4, figsize=(11, 2.9))
    panels[0].imshow(hu, **image)
    panels[1].imshow(hu, alpha=0.35, **image)
    panels[1].plot(x[[0, -1]], y[[0, -1]], color=DOT, lw=1)
    panels[1].plot(x[[0, -1]].ravel(), y[[0, -1]].ravel(), "o", ms=3, color=DOT)
    panels[2].scatter(x, y, c=control[..., 3], s=9, cmap="viridis")
    quads = mesh.points[mesh.cells][..., :2]
    values = mesh.fields["HU"][mesh.cells].mean(axis=1)
    faces = matplotlib.collections.PolyCollection(quads, array=values, cmap="viridis", edgecolors=INK, linewidths=0.3)
    panels[3].add_collection(faces)
    titles = ("CT slice", "rows, cut at the boundary", "control points: x, y, z, HU", "sampled: quads of any density")
    for panel, title in zip(panels, titles, strict=True):
        _bare(panel, title)
        panel.set_xlim(box[:2])
        panel.set_ylim(box[2:])
    return _svg(figure)


def patch() -> str:
    """Basis functions over clamped knots, and a cubic surface with its control net."""
    device = gb.open_device()
    n, degree = 7, 3
    knots, u = clamped_uniform(n, degree), np.linspace(0, 1, 400)
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.1), width_ratios=(1, 1.3))
    for i in range(n):
        control = np.zeros((n, 2, 4))
        control[i, :, 0] = 1
        values = gb.hyperpatch(control, (degree, 1)).evaluate_grid([u, np.zeros(1)], device)[..., 0].ravel()
        left.plot(u, values, lw=1.5)
    for knot in np.unique(knots):
        left.axvline(knot, color=LINE, lw=0.5, zorder=0)
    left.set_xlabel("u", color=INK)
    left.set_title("Cubic basis functions $N_{i,3}(u)$, clamped knots", fontsize=10, color=INK)
    left.spines[["top", "right"]].set_visible(False)
    rng = np.random.default_rng(4)
    i, j = np.mgrid[:6, :5].astype(float)
    control = np.stack(
        [i + 0.25 * rng.normal(size=i.shape), j + 0.25 * rng.normal(size=i.shape), 0 * i, 0 * i], axis=-1
    )
    surface = gb.hyperpatch(control, 3).evaluate_grid([np.linspace(0, 1, 19)] * 2, device)
    for net, style in ((control, {"color": LINE, "lw": 0.8}), (surface, {"color": DOT, "lw": 0.6})):
        right.plot(net[..., 0], net[..., 1], **style)
        right.plot(net[..., 0].T, net[..., 1].T, **style)
    right.plot(control[..., 0], control[..., 1], "o", ms=3.5, color=INK)
    _bare(right, "Control points and the patch that they shape")
    return _svg(figure)


def laws() -> str:
    """Young's modulus against HU, of every law."""
    figure, axes = plt.subplots(figsize=(8, 4.2))
    for number, (name, law) in enumerate(gb.laws().items()):
        for piece in law.pieces:
            hu = np.linspace(max(piece.lower_hu, 1), min(piece.upper_hu, 2200), 60)
            density = np.array([law.density.density_g_cm3(float(value)) for value in hu])
            modulus = [piece.modulus_mpa(float(value)) for value in density]
            style: dict[str, Any] = {"color": f"C{number % 10}", "ls": ("-", "--")[number // 10], "lw": 1.3}
            axes.plot(hu, modulus, label=name if piece is law.pieces[0] else None, **style)
    axes.set_yscale("log")
    axes.set_ylim(10, 40000)
    axes.set_xlim(0, 2200)
    axes.set_xlabel("HU")
    axes.set_ylabel("E, MPa")
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(fontsize=7, frameon=False, loc="center left", bbox_to_anchor=(1, 0.5))
    return _svg(figure)


def density() -> str:
    """Volume and distance from the region, and the least scaled Jacobian, against the number of elements."""
    volume, region = _scan()
    device, rows = gb.open_device(), []
    patch = gb.fit(gb.control_lattice(volume, region, (11, 18, 34)), degree=3, device=device).patch
    for factor in (0.3, 0.45, 0.65, 1.0, 1.5, 2.2):
        mesh = gb.sample(patch, tuple(max(3, round(factor * n)) for n in (11, 18, 34)), device=device)
        _, quality = gb.assess(mesh, device)
        off = gb.surface_distance(mesh, region, device).mean
        rows.append((mesh.n_elements, off, abs(mesh.volume_mm3 / region.volume_mm3 - 1), quality.fraction_above_0_5))
    n, off, lost, good = np.array(rows).T
    figure, panels = plt.subplots(1, 3, figsize=(10, 2.6), layout="constrained")
    titles = ("mean distance from the region, mm", "volume off by, %", "elements above 0.5, %")
    for panel, values, title in zip(panels, (off, 100 * lost, 100 * good), titles, strict=True):
        panel.plot(n, values, "o-", color=DOT, ms=4)
        panel.set_xscale("log")
        panel.set_xlabel("elements")
        panel.set_title(title, fontsize=10, color=INK)
        panel.spines[["top", "right"]].set_visible(False)
    panels[0].set_ylim(bottom=0)
    panels[1].set_ylim(bottom=0)
    return _svg(figure)


def blocks() -> bytes:
    """A ring as blocks, outside and cut."""
    k, j, i = np.mgrid[:24, :56, :56].astype(np.float32)
    off = np.hypot(np.hypot(i - 27.5, j - 27.5) - 17, k - 11.5) - 7
    volume = gb.Volume((-100 * off).astype(np.float32), np.eye(4))
    device = gb.open_device()
    made = gb.blocks_mesh(gb.region_from_threshold(volume, 0, fill="none"), 3.0, device=device)
    return _png(gb.assess(made.mesh, device)[0], field="scaled_jacobian")


def femur() -> bytes:
    """The child femur, coloured by Young's modulus."""
    return _png(_femur(), field="E_MPa")


def quality() -> bytes:
    """Histogram of the child femur's scaled Jacobians."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "figure.png"
        gb.write_histogram(gb.assess(_femur(), gb.open_device())[1], path)
        return path.read_bytes()


def stance() -> bytes:
    """The child femur in stance, coloured by von Mises stress."""
    from gpubspline.clock import Clock

    response = gb.respond(_femur(), gb.load_case("stance"), gb.open_device(), Clock())
    return _png(response.mesh, field="von_mises_mpa")


FIGURES: dict[str, Callable[[], str | bytes]] = {
    "lattice.svg": lattice,
    "patch.svg": patch,
    "laws.svg": laws,
    "density.svg": density,
    "blocks.png": blocks,
    "femur.png": femur,
    "quality.png": quality,
    "stance.png": stance,
}

if __name__ == "__main__":
    for name, draw in FIGURES.items():
        made = draw()
        Path(sys.argv[1], name).write_bytes(made if isinstance(made, bytes) else made.encode())
