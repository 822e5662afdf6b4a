"""Painting quadrilaterals far to near: the hidden ones culled, the rest lit, coloured and outlined."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from numpy.typing import NDArray

from gpubspline.report.camera import Camera, Floats

DOTS_PER_INCH = 150
"""Of the finished picture."""

EDGE_PIXELS = 3.0, 9.0
"""Edges of elements that look smaller than the first are left out, as they would cover them, and from there to the
second they fade in.
"""

PATCHES = 60_000
"""Quadrilaterals are split until about so many patches carry the colour smoothly."""

AMBIENT, LAMP = 0.66, (-0.35, 0.55, 0.76)
"""Light from everywhere, and the lamp's direction along the camera's right, up and toward."""

DARK_EDGE, LIGHT_EDGE = np.array([0.06, 0.06, 0.09, 0.4]), np.array([1.0, 1.0, 1.0, 0.22])
"""Edges on light and on dark faces."""


@dataclass(frozen=True, eq=False)
class Shell:
    """Quadrilaterals in space with a value at each corner.

    Attributes
    ----------
    corners: (m, 4, 3) float, mm in LPS, counter-clockwise seen from outside.
    values: (m, 4) float, the field at the corners.
    """

    corners: Floats
    values: Floats

    @property
    def normals(self) -> Floats:
        """(m, 3) unit normals, outwards; zero for a collapsed quadrilateral."""
        normal = np.cross(self.corners[:, 2] - self.corners[:, 0], self.corners[:, 3] - self.corners[:, 1])
        length = np.linalg.norm(normal, axis=1, keepdims=True)
        return np.asarray(np.divide(normal, length, out=np.zeros_like(normal), where=length > 0))


def paint(
    axes: Axes, shell: Shell, camera: Camera, scale: ScalarMappable, *, flat: bool = False, edges: bool | None = None
) -> None:
    """Paint a shell.

    Arguments
    ---------
    axes: in mm of the camera's picture.
    shell: what to paint.
    camera: where it is seen from.
    scale: values to colours.
    flat: a plane mesh: seen from both sides, and not lit.
    edges: whether edges of elements are drawn; where their size lets them be seen unless told.
    """
    normals = shell.normals
    seen = np.full(len(normals), True) if flat else normals @ camera.toward > 0
    picture, near = camera.project(shell.corners[seen])
    order = np.argsort(near.mean(axis=1), kind="stable")
    light = np.ones(len(order)) if flat else _light(normals[seen], camera)
    strength = _edge_strength(axes, picture) if edges is None else float(edges)
    _add(axes, picture[order], shell.values[seen][order], light[order], scale, strength)


def _light(normals: Floats, camera: Camera) -> Floats:
    lamp = np.array([camera.right, camera.up, camera.toward]).T @ np.array(LAMP)
    return np.asarray(AMBIENT + (1 - AMBIENT) * np.clip(normals @ lamp / np.linalg.norm(lamp), 0, 1))


def _add(axes: Axes, corners: Floats, values: Floats, light: Floats, scale: ScalarMappable, strength: float) -> None:
    """Add the polygons in painting order; an outline follows the patches of its quadrilateral and is hidden too."""
    splits = int(np.clip(np.sqrt(PATCHES / max(len(corners), 1)), 1, 12))
    patches, tints = _split(corners, splits), _split(values[..., None], splits)[..., 0].mean(axis=2)
    colours = scale.to_rgba(tints)
    colours[..., :3] *= light[:, None, None]
    outlines, smooth = np.zeros_like(colours), np.zeros(tints.shape, dtype=bool)
    if strength > 0:
        patches = np.concatenate([patches, corners[:, None]], axis=1)
        outlines = np.concatenate([outlines, _edge_colours(colours, strength)[:, None]], axis=1)
        colours = np.concatenate([colours, np.zeros((len(corners), 1, 4))], axis=1)
        smooth = np.concatenate([smooth, np.ones((len(corners), 1), dtype=bool)], axis=1)
    polygons: Any = patches.reshape(-1, 4, 2)  # an array is taken as a whole, a list of polygons one by one
    axes.add_collection(
        PolyCollection(
            polygons,
            facecolors=colours.reshape(-1, 4),
            edgecolors=outlines.reshape(-1, 4),
            linewidths=np.where(smooth, 0.4, 0.0).ravel(),
            antialiaseds=smooth.ravel(),  # smoothed patches would leave seams of background between them
            joinstyle="round",
        ),
        autolim=False,
    )


def _edge_strength(axes: Axes, corners: Floats) -> float:
    """How strongly to draw edges, 0..1, by the size of the typical element on the finished picture."""
    if len(corners) == 0:
        return 0.0
    size_mm = np.median(np.linalg.norm(corners[:, [2, 3]] - corners[:, [0, 1]], axis=2).min(axis=1))
    inches = axes.get_window_extent().width / axes.figure.dpi
    left, right = axes.get_xlim()
    return float(np.interp(size_mm * inches * DOTS_PER_INCH / (right - left), EDGE_PIXELS, (0.0, 1.0)))


def _edge_colours(colours: Floats, strength: float) -> Floats:
    """Edge colour (m, 4) of faces painted (m, patches, 4): dark lines on light faces, light lines on dark ones."""
    lightness = colours[..., :3].mean(axis=1) @ np.array([0.3, 0.59, 0.11])
    on_light = np.interp(lightness, (0.25, 0.45), (0.0, 1.0))[:, None]
    colour = on_light * DARK_EDGE + (1 - on_light) * LIGHT_EDGE
    return np.asarray(colour * (1.0, 1.0, 1.0, strength))


def _split(corners: Floats, splits: int) -> NDArray[np.float64]:
    """Split corner data (m, 4, c) bilinearly into splits**2 patches: (m, splits**2, 4, c)."""
    ends = np.linspace(0, 1, splits + 1)
    s, t = np.meshgrid(ends, ends, indexing="ij")
    weights = np.stack([(1 - s) * (1 - t), s * (1 - t), s * t, (1 - s) * t], axis=-1)
    around = [weights[:-1, :-1], weights[1:, :-1], weights[1:, 1:], weights[:-1, 1:]]
    table = np.stack(around, axis=2).reshape(splits * splits, 4, 4)
    return np.asarray(np.einsum("pqk,mkc->mpqc", table, corners))
