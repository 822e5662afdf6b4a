"""A picture of a mesh coloured by a field, drawn without a display and without system graphics libraries."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from gpubspline.errors import InputError, expect
from gpubspline.mesh.mesh import Mesh
from gpubspline.report.camera import OBLIQUE, Camera, Floats, facing_a_plane
from gpubspline.report.painter import Shell, paint
from gpubspline.report.quantity import quantity
from gpubspline.report.sheet import FAINT, INK, check_png, draw_colour_bar, draw_patient_axes, draw_scale_bar, save
from gpubspline.report.skin import cut_skin, skin

PANEL_INCH, BAR_INCH, HEADING_INCH, CAPTION_INCH, FOOT_INCH = 5.6, 1.55, 0.5, 0.28, 0.85
"""Size of the drawing of a body, and of what stands right of, above and below it."""

AXES = "xyz"

Panel = tuple[Shell, Camera, str]
"""What is seen, from where, and its caption."""


def write_picture(mesh: Mesh, path: str | Path, **how: Any) -> None:
    """Write a PNG of a mesh coloured by a field, with a colour bar, a scale bar and the patient's axes.

    Arguments
    ---------
    mesh: with the field.
    path: a ``.png``, which appears whole or not at all.
    how: see ``draw_picture``.

    Raises
    ------
    InputError where the mesh has no such field, the view has no direction, or the file cannot be written as PNG.
    """
    expect(mesh, Mesh, "sample makes one, read_mesh reads one")
    path = Path(path)
    check_png(path)
    save(draw_picture(mesh, **how), path)


def draw_picture(
    mesh: Mesh,
    *,
    field: str = "HU",
    title: str | None = None,
    view: ArrayLike | None = None,
    clip: str | None = None,
    edges: bool | None = None,
) -> Figure:
    """Draw a mesh coloured by a field, with a colour bar, a scale bar and the patient's axes.

    A hex mesh is shown from outside and, beside it, cut through the middle; a quad mesh is shown flat.

    Arguments
    ---------
    mesh: with the field.
    field: a nodal field such as ``"HU"`` or ``"E_MPa"``, or an element field such as ``"scaled_jacobian"``.
    title: the counts of elements and nodes unless told.
    view: (3,) from the body to the viewer in LPS; from the front, left and above unless told.
    clip: ``"x"``, ``"y"`` or ``"z"``, to cut across it; along the greatest section unless told.
    edges: whether edges of elements are drawn; where they can be seen unless told.

    Raises
    ------
    InputError where the mesh has no such field, the view has no direction, or there is no such axis to cut across.
    """
    _check(mesh, field, view, clip)
    solid = mesh.element.dimension == 3
    outside = skin(mesh, field)
    # a cut shows what the outside does not have: both are coloured on the scale of all of the mesh
    look, values = quantity(field), np.asarray((mesh.fields | mesh.cell_fields)[field])
    labels = field == "label" and bool(np.isfinite(values).all())
    scale, extend = (look.by_number(values), "neither") if labels else look.scale(values)
    panels = _solid_panels(mesh, field, outside, view, clip) if solid else [_flat_panel(outside, view)]
    heading = title if title is not None else f"{mesh.n_elements:,} {mesh.element_type} · {mesh.n_nodes:,} nodes"
    figure = draw_panels(panels, heading, scale, flat=not solid, edges=edges)
    draw_colour_bar(figure, scale, extend, look.label)
    return figure


def _check(mesh: Mesh, field: str, view: ArrayLike | None, clip: str | None) -> None:
    if field not in mesh.fields and field not in mesh.cell_fields:
        known = ", ".join([*mesh.fields, *mesh.cell_fields]) or "none"
        raise InputError(f"expected a field of the mesh ({known}) to colour it by, got {field!r}")
    if view is not None and (np.shape(view) != (3,) or not 0 < float(np.linalg.norm(view)) < np.inf):
        raise InputError(f"expected a view of three numbers that are not all 0, got {view!r}")
    check_clip(mesh, clip)


def check_clip(mesh: Mesh, clip: str | None) -> None:
    """Raise InputError where ``clip`` is not an axis to cut hexes across, or None."""
    if clip is not None and (clip not in tuple(AXES) or mesh.element.dimension == 2):
        raise InputError(f"expected a cut of hexes across x, y or z, got {clip!r} for {mesh.element_type}")


def _solid_panels(mesh: Mesh, field: str, outside: Shell, view: ArrayLike | None, clip: str | None) -> list[Panel]:
    camera = Camera.looking(OBLIQUE if view is None else view)
    half, normal = cut_skin(mesh, field, camera.toward, None if clip is None else AXES.index(clip))
    # the section nearly face-on, but turned a little to where the other panel is seen from, so that it has depth
    inside = Camera.looking(normal + 0.35 * (camera.toward - (camera.toward @ normal) * normal))
    return [
        (outside, camera, "surface"),
        (half, inside, "cut through the middle" if clip is None else f"cut across {clip} at its middle"),
    ]


def _flat_panel(shell: Shell, view: ArrayLike | None) -> Panel:
    normals = np.cross(shell.corners[:, 2] - shell.corners[:, 0], shell.corners[:, 3] - shell.corners[:, 1])
    total = normals.sum(axis=0)
    if view is None and not np.linalg.norm(total) > 0:
        total = np.array([0.0, 0.0, 1.0])
    return shell, Camera.looking(facing_a_plane(total) if view is None else view), ""


def draw_panels(
    panels: list[Panel],
    heading: str,
    scale: ScalarMappable,
    *,
    flat: bool = False,
    edges: bool | None = None,
    right_inch: float = BAR_INCH,
) -> Figure:
    """Lay the panels out side by side, all on one scale and only as wide as the body needs, with room right of them."""
    frames = [_frame(shell, camera) for shell, camera, _ in panels]
    sizes = np.array([size for _, size in frames]).max(axis=0)
    body_inch = float(np.clip(PANEL_INCH * sizes[0] / sizes[1], 0.6 * PANEL_INCH, 1.1 * PANEL_INCH))
    mm_per_inch = 1.06 * max(sizes[0] / body_inch, sizes[1] / PANEL_INCH)
    panel_inch = np.array([body_inch + 0.3, FOOT_INCH + PANEL_INCH])
    above_inch = HEADING_INCH + (CAPTION_INCH if panels[0][2] else 0.0)
    figure = Figure(figsize=(panel_inch[0] * len(panels) + right_inch, panel_inch[1] + above_inch), facecolor="white")
    for number, (panel, (centre, _)) in enumerate(zip(panels, frames, strict=True)):
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        _place(axes, centre, panel_inch, mm_per_inch, left_inch=number * panel_inch[0])
        _draw_panel(axes, panel, scale, flat=flat, edges=edges)
        draw_patient_axes(figure, panel[1], corner_inch=(number * panel_inch[0] + 0.3, 0.25))
    draw_scale_bar(figure, mm_per_inch, right_inch=float(panel_inch[0] * len(panels) - 0.3))
    figure.text(0.5, 1 - 0.15 / figure.get_figheight(), heading, ha="center", va="top", fontsize=13, color=INK)
    return figure


def _place(axes: Axes, centre: Floats, panel_inch: Floats, mm_per_inch: float, left_inch: float) -> None:
    """Put a panel on the sheet, with the body's centre in its middle, above the foot."""
    extent = axes.get_window_extent()  # of all of the sheet, until now
    sheet_inch = np.array([extent.width, extent.height]) / axes.figure.dpi
    axes.set_position((left_inch / float(sheet_inch[0]), 0.0, *(panel_inch / sheet_inch)))
    low = centre - np.array([panel_inch[0] / 2, FOOT_INCH + PANEL_INCH / 2]) * mm_per_inch
    high = low + panel_inch * mm_per_inch
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])


def _draw_panel(axes: Axes, panel: Panel, scale: ScalarMappable, *, flat: bool, edges: bool | None) -> None:
    shell, camera, caption = panel
    axes.set_axis_off()
    paint(axes, shell, camera, scale, flat=flat, edges=edges)
    axes.text(0.5, 1.0, caption, transform=axes.transAxes, ha="center", va="bottom", fontsize=10, color=FAINT)


def _frame(shell: Shell, camera: Camera) -> tuple[Floats, Floats]:
    """Centre (2,) of a shell in the picture, and its width and height (2,), mm."""
    picture, _ = camera.project(shell.corners.reshape(-1, 3))
    low, high = picture.min(axis=0), picture.max(axis=0)
    return (low + high) / 2, np.maximum(high - low, 1e-6)
