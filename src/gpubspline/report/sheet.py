"""The sheet that pictures are drawn on: ink, marks in inches from its lower left corner, and the file it becomes."""

from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm, LogNorm
from matplotlib.figure import Figure
from matplotlib.image import imsave
from matplotlib.lines import Line2D
from matplotlib.patches import FancyArrowPatch
from matplotlib.ticker import FuncFormatter, LogLocator
from numpy.typing import NDArray

from gpubspline.errors import InputError
from gpubspline.files import whole_file
from gpubspline.report.camera import Camera
from gpubspline.report.painter import DOTS_PER_INCH

INK, FAINT = "#22252b", "#8a8f98"

MOST_NUMBERS = 30
"""Labels written beside a colour bar."""


def check_png(path: Path) -> None:
    """Raise ``InputError`` where ``path`` is not the name of a PNG file."""
    if path.suffix.lower() != ".png":
        raise InputError(f"expected a picture file that ends in .png, got {path.name}")


def save(figure: Figure, path: Path) -> None:
    """Write a figure as a PNG, whole or not at all."""
    pixels = rendered(figure)
    with whole_file(path) as temporary:
        imsave(temporary, pixels)


def png(figure: Figure) -> bytes:
    """Give a figure as the bytes of a PNG."""
    file = BytesIO()
    imsave(file, rendered(figure), format="png")
    return file.getvalue()


def rendered(figure: Figure) -> NDArray[np.uint8]:
    """Pixels (h, w, 4) of a figure, drawn at twice the size and averaged, which smooths all of it."""
    figure.set_dpi(2 * DOTS_PER_INCH)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    pixels = np.asarray(canvas.buffer_rgba())
    height, width = pixels.shape[0] // 2, pixels.shape[1] // 2
    small = pixels[: 2 * height, : 2 * width].reshape(height, 2, width, 2, 4).mean(axis=(1, 3), dtype=np.float32)
    return np.asarray(np.round(small).astype(np.uint8))


def draw_patient_axes(figure: Figure, camera: Camera, corner_inch: tuple[float, float]) -> None:
    """Left, posterior and superior as arrows right of and above a corner; one nearly end-on is left out."""
    inches = figure.dpi_scale_trans
    shifts = 0.34 * np.stack([camera.right, camera.up], axis=1)
    origin = np.array(corner_inch) - np.minimum(shifts.min(axis=0), 0)
    for name, shift in zip("LPS", shifts, strict=True):
        if np.linalg.norm(shift) < 0.1:
            continue
        style: dict[str, Any] = {"arrowstyle": "-|>", "color": FAINT, "lw": 1.1, "mutation_scale": 8}
        start, end = tuple(origin.tolist()), tuple((origin + shift).tolist())
        figure.add_artist(FancyArrowPatch(start, end, transform=inches, shrinkA=0, shrinkB=0, **style))
        x, y = (origin + shift + 0.11 * shift / np.linalg.norm(shift)).tolist()
        figure.text(x, y, name, transform=inches, ha="center", va="center", fontsize=9, color=INK)


def draw_scale_bar(figure: Figure, mm_per_inch: float, right_inch: float) -> None:
    """Draw a bar of 1, 2 or 5 times a power of ten, mm, that ends at ``right_inch``."""
    steps = np.outer(10.0 ** np.arange(-6, 7), [1, 2, 5]).ravel()
    length = float(steps[steps <= 1.2 * mm_per_inch][-1])
    left, inches = right_inch - length / mm_per_inch, figure.dpi_scale_trans
    bar = Line2D([left, right_inch], [0.3, 0.3], transform=inches, color=INK, lw=2, solid_capstyle="butt")
    figure.add_artist(bar)
    middle = (left + right_inch) / 2
    figure.text(middle, 0.36, f"{length:g} mm", transform=inches, ha="center", va="bottom", fontsize=9, color=INK)


def draw_colour_bar(figure: Figure, scale: ScalarMappable, extend: str, label: str) -> None:
    """Draw the colour bar and its label at the right of the sheet; ``extend`` is matplotlib's."""
    width = figure.get_figwidth()
    bar = figure.colorbar(scale, cax=figure.add_axes((1 - 1.25 / width, 0.2, 0.2 / width, 0.58)), extend=extend)
    if isinstance(scale.norm, LogNorm):
        bar.ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        bar.ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        bar.minorticks_off()
    elif isinstance(scale.norm, BoundaryNorm):
        edges = np.asarray(scale.norm.boundaries)
        some = slice(None, None, -(-len(edges) // MOST_NUMBERS))
        bar.set_ticks(((edges[:-1] + edges[1:]) / 2)[some], labels=[f"{edge + 0.5:g}" for edge in edges[:-1][some]])
        bar.minorticks_off()
    bar.outline.set_visible(False)
    bar.ax.tick_params(labelsize=9, color=FAINT, labelcolor=INK, length=3)
    bar.ax.set_title(label, fontsize=10, color=INK, pad=10, loc="left")
