"""A window on a mesh, where there is a screen: turned by the mouse, cut by a plane that it drags."""

import os
import sys
from ctypes.util import find_library
from typing import Any

import numpy as np

from gpubspline.errors import BackendUnavailable
from gpubspline.mesh.mesh import Mesh
from gpubspline.report.camera import OBLIQUE, SUPERIOR
from gpubspline.report.quantity import quantity

DARK, PAPER = "#22252b", "white"
BAR = {
    **{"color": DARK, "vertical": True, "fmt": "%.4g", "n_labels": 5, "title_font_size": 18, "label_font_size": 15},
    **{"position_x": 0.82, "position_y": 0.25, "width": 0.07, "height": 0.5},
}


def has_screen() -> bool:
    """Whether a window can be opened: on Linux a display, and the GL library without which VTK ends the process."""
    if sys.platform in ("darwin", "win32"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")) and find_library("GL") is not None


def open_window(mesh: Mesh, field: str, *, clip: str | None = None, edges: bool | None = None) -> Any:
    """Make a window on a mesh coloured by a field as its pictures are; its ``show()`` returns when it is closed.

    Arguments
    ---------
    mesh, field: as for ``draw_picture``.
    clip: ``"x"``, ``"y"`` or ``"z"``, for a plane across it that the mouse drags.
    edges: whether edges of elements are drawn.

    Raises
    ------
    BackendUnavailable where PyVista is not installed.
    """
    try:
        import pyvista
    except ImportError:
        raise BackendUnavailable("PyVista is not installed: pip install 'gpubspline[view]'") from None
    look = quantity(field)
    scale, _ = look.scale(np.asarray((mesh.fields | mesh.cell_fields)[field]))
    plotter = pyvista.Plotter(title=f"gpubspline: {mesh.n_elements:,} {mesh.element_type}", window_size=[1100, 850])
    shown: dict[str, Any] = {
        "scalars": field,
        "cmap": scale.get_cmap(),
        "clim": scale.get_clim(),
        "log_scale": look.is_logarithmic(scale),
        "show_edges": bool(edges),
        "scalar_bar_args": BAR | {"title": " ".join(look.label.split())},
    }
    plotter.set_background(PAPER)
    grid = mesh.to_pyvista()
    if clip is None:
        plotter.add_mesh(grid, **shown)
    else:
        plotter.add_mesh_clip_plane(grid, normal=clip, crinkle=True, **shown)
    plotter.add_axes(xlabel="L", ylabel="P", zlabel="S", color=DARK)
    plotter.camera_position = [
        tuple(grid.center[a] + 4 * grid.length * OBLIQUE[a] for a in range(3)),
        grid.center,
        SUPERIOR,
    ]
    plotter.reset_camera()
    return plotter
