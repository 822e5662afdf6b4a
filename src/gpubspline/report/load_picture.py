"""A picture of what a load case holds and pushes of a mesh, before anything is solved: from two sides, with arrows."""

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm, ListedColormap, to_rgba
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, Rectangle
from numpy.typing import ArrayLike

from gpubspline.analysis.load_case import Force, LoadCase, Pressure
from gpubspline.analysis.loads import Applied, assemble, patient_axes
from gpubspline.analysis.regions import Surface, surfaces
from gpubspline.mesh.mesh import Mesh
from gpubspline.report.camera import OBLIQUE, Camera, Floats
from gpubspline.report.page.figures import number, vector
from gpubspline.report.painter import Shell
from gpubspline.report.picture import Panel, draw_panels
from gpubspline.report.sheet import INK, check_png, save

BODY = "#d9dce1"
COLOURS = ("#1f6fd0", "#d4572a", "#3f9a4d", "#8a4fb5", "#c79a16", "#0f9aa8", "#c2417c", "#6b6f76")
"""Of what acts, in the order of the file, again from the first where there is more."""

SHADES = 8
"""Steps from a body's colour to a region's, by how much of a face is in it."""

ARROW = 0.1
"""Length of an arrow, of the body's extent."""

LEGEND_INCH, LETTERS = 3.6, 40
"""Width of what stands right of the drawing, and letters of its lines."""


@dataclass(frozen=True, eq=False)
class Acting:
    """What acts, and where.

    Attributes
    ----------
    applied: what became of it.
    share: (f,) of each face of the boundary, how much of it is in the region; of nodes for a support.
    outward: (3,) mean normal of the region.
    """

    applied: Applied
    share: Floats
    outward: Floats

    @property
    def words(self) -> str:
        """Region, kind, total force and area."""
        on = f"{number(self.applied.area_mm2)} mm², {self.applied.nodes:,} nodes"
        if self.applied.kind == "fixed":
            return f"{self.applied.region}: held, {on}"
        return f"{self.applied.region}: {self.applied.kind} {vector(self.applied.force_n.tolist())} N, {on}"


def write_load_picture(mesh: Mesh, case: LoadCase, path: str | Path, **how: Any) -> None:
    """Write a PNG of where a load case acts on a mesh of hexes.

    Arguments
    ---------
    path: a ``.png``, which appears whole or not at all.
    how: see ``draw_load_picture``.

    Raises
    ------
    InputError where the load case does not fit the mesh; see ``analysis.loads.assemble``.
    """
    path = Path(path)
    check_png(path)
    save(draw_load_picture(mesh, case, **how), path)


def draw_load_picture(
    mesh: Mesh, case: LoadCase, *, view: ArrayLike | None = None, edges: bool | None = None
) -> Figure:
    """Draw the boundary from a side and its opposite, each region in a colour, pale where it fills a part of a face.

    ``view`` and ``edges`` as of ``draw_picture``.
    """
    surface, acting = where_it_acts(mesh, case)
    values = np.zeros(len(surface.faces))
    for place in np.argsort([-each.share.sum() for each in acting], kind="stable"):  # small regions lie over large ones
        share = acting[place].share
        values = np.where(share > 0, place + np.clip(share, 0, 1), values)
    corners = mesh.points[surface.faces[:, :4]].astype(np.float64)
    shell = Shell(corners, np.repeat(values[:, None], 4, axis=1))
    toward = np.asarray(OBLIQUE if view is None else view, dtype=np.float64)
    cameras = [Camera.looking(toward), Camera.looking(-toward)]
    panels: list[Panel] = [(shell, cameras[0], "surface"), (shell, cameras[1], "from the opposite side")]
    heading = f"{case.title or case.name} · {mesh.n_elements:,} {mesh.element_type}"
    figure = draw_panels(panels, heading, _scale(len(acting)), edges=edges, right_inch=LEGEND_INCH)
    length = ARROW * float(np.ptp(corners, axis=(0, 1)).max())
    for axes, camera in zip(list(figure.axes), cameras, strict=True):
        for place, each in enumerate(acting):
            _draw_arrow(axes, camera, each, _colour(place), length)
    weight = [] if case.gravity_mm_s2 is None else [f"gravity {vector(case.gravity_mm_s2)} mm/s², axes {case.axes}"]
    _draw_legend(figure, [each.words for each in acting], weight)
    return figure


def where_it_acts(mesh: Mesh, case: LoadCase) -> tuple[Surface, list[Acting]]:
    """Put a load case on a mesh and find the faces that each of its supports and loads catches; but for gravity."""
    loads = assemble(case, mesh)
    loads.warn_of_held()
    at_gauss, at_nodes = surfaces(mesh, patient_axes(case.axes, mesh.points))
    normal = at_gauss.normals.mean(axis=1)
    found = []
    for support, applied in zip(case.supports, loads.report, strict=False):
        share = support.region.inside(at_nodes)[:, :4].mean(axis=1)
        found.append(Acting(applied, share, share @ normal))
    pushes: tuple[Force | Pressure, ...] = (*case.forces, *case.pressures)
    for load, applied in zip(pushes, loads.report[len(case.supports) :], strict=False):
        area = at_gauss.areas_mm2
        share = np.where(load.region.inside(at_gauss), area, 0.0).sum(axis=1) / np.maximum(area.sum(axis=1), 1e-300)
        found.append(Acting(applied, share, share @ normal))
    return at_gauss, found


def _colour(place: int) -> str:
    return COLOURS[place % len(COLOURS)]


def _scale(count: int) -> ScalarMappable:
    """Of values up to ``count``: from that of the body to the colour of a place between its number and the next."""
    steps = [to_rgba(BODY)]
    for place in range(count):
        pale, full = np.array(to_rgba(BODY)), np.array(to_rgba(_colour(place)))
        steps += [tuple(pale + (full - pale) * share) for share in (np.arange(SHADES) + 1) / SHADES]
    edges = np.concatenate([[-1.0], (np.arange(count * SHADES + 1) + 1e-9) / SHADES])
    return ScalarMappable(BoundaryNorm(edges, len(steps)), ListedColormap(steps))


def _draw_arrow(axes: Axes, camera: Camera, acting: Acting, colour: str, length_mm: float) -> None:
    """Draw a total force at the middle of its region: up to it where it pushes, from it where it pulls."""
    force = acting.applied.force_n
    size = float(np.linalg.norm(force))
    if not size > 0:
        return
    way, at = length_mm * force / size, acting.applied.centre_mm
    ends, _ = camera.project(np.stack([at - way, at] if force @ acting.outward <= 0 else [at, at + way]))
    start, end = tuple(ends[0].tolist()), tuple(ends[1].tolist())
    style: dict[str, Any] = {"arrowstyle": "-|>", "lw": 2.4, "mutation_scale": 16, "shrinkA": 0, "shrinkB": 0}
    behind = float(acting.outward @ camera.toward) < 0
    axes.add_patch(FancyArrowPatch(start, end, color=colour, alpha=0.35 if behind else 1.0, clip_on=False, **style))


def _draw_legend(figure: Figure, lines: Sequence[str], others: Sequence[str]) -> None:
    """Write what acts right of the drawing, each with its colour."""
    width, height = figure.get_size_inches()
    left, y, inches = width - LEGEND_INCH + 0.1, height - 0.9, figure.dpi_scale_trans
    for place, words in enumerate([*lines, *others]):
        if place < len(lines):
            swatch = Rectangle((left, y - 0.14), 0.16, 0.16, transform=inches, color=_colour(place))
            figure.add_artist(swatch)
        rows = textwrap.wrap(words, LETTERS)
        figure.text(left + 0.26, y, "\n".join(rows), transform=inches, va="top", fontsize=9, color=INK)
        y -= 0.17 * len(rows) + 0.12
