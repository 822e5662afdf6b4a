"""What a notebook shows of a volume, a mesh and its quality; ``shown.py`` finds it by name."""

import base64
from dataclasses import dataclass
from html import escape
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.image import imsave
from numpy.typing import NDArray

from gpubspline.ct.volume import Volume
from gpubspline.files import whole_file
from gpubspline.mesh.mesh import Mesh
from gpubspline.mesh.quality import Quality
from gpubspline.report.histogram import draw_histogram
from gpubspline.report.page.slices import views
from gpubspline.report.picture import draw_picture
from gpubspline.report.quantity import find_field
from gpubspline.report.sheet import check_png, png

DRAWN_ELEMENTS = 400_000
"""A mesh of more is told of, but not drawn unasked."""

SAMPLED_VOXELS = 1_000_000
"""So many of them tell the grey window of a volume."""

SLICE_PIXELS = 200
"""Longest side of a slice in a notebook."""


@dataclass(frozen=True, eq=False)
class Picture:
    """A picture that a notebook shows and ``save`` writes.

    Attributes
    ----------
    png: bytes of the file.
    """

    png: bytes

    def _repr_png_(self) -> bytes:
        return self.png

    def save(self, path: str | Path) -> None:
        """Write it to a ``.png``, whole or not at all; raises InputError where it cannot be written."""
        path = Path(path)
        check_png(path)
        with whole_file(path) as temporary:
            temporary.write_bytes(self.png)


def picture(mesh: Mesh, field: str | None = None, **how: Any) -> Picture:
    """Draw a mesh; see ``picture.draw_picture``, whose field may be short here."""
    return Picture(png(draw_picture(mesh, field=find_field([*mesh.fields, *mesh.cell_fields], field), **how)))


def mesh_html(mesh: Mesh) -> str:
    """The mesh's picture and a table of its fields."""
    ranges = [(name, values) for fields in (mesh.fields, mesh.cell_fields) for name, values in fields.items()]
    rows = [("elements", f"{mesh.n_elements:,} {mesh.element_type}"), ("nodes", f"{mesh.n_nodes:,}")]
    rows += [(name, f"{values.min():.5g} to {values.max():.5g}") for name, values in ranges if len(values)]
    drawn = ""
    if ranges and 0 < mesh.n_elements <= DRAWN_ELEMENTS:
        drawn = _image(picture(mesh).png, "the mesh", "max-width: 640px; width: 100%")
    return drawn + _table(rows)


def quality_html(quality: Quality) -> str:
    """The histogram of the scaled Jacobians."""
    return _image(png(draw_histogram(quality)), "histogram of scaled Jacobians", "max-width: 480px; width: 100%")


def volume_html(volume: Volume) -> str:
    """Three slices through the middle, as radiology has them, and the volume's size."""
    step = max(volume.hu.size // SAMPLED_VOXELS, 1)
    low, high = np.percentile(volume.hu.ravel()[::step], [0.5, 99.8])
    window = (float(low), float(high if high > low else low + 1))
    shown = "".join(_slice(volume.hu, view, volume.spacing_mm, window) for view in views(volume.affine))
    size = " x ".join(map(str, volume.shape)) + " of " + " x ".join(f"{mm:.4g}" for mm in volume.spacing_mm) + " mm"
    rows = [("source", volume.source), ("voxels", size), ("HU", f"{volume.hu.min():g} to {volume.hu.max():g}")]
    return f'<div style="display: flex; gap: 8px; align-items: flex-end">{shown}</div>' + _table(rows)


def _slice(hu: NDArray[Any], view: dict[str, Any], spacing_mm: NDArray[np.float64], window: tuple[float, float]) -> str:
    """One slice of a block (k, j, i), turned to the picture and as large as it is in the patient."""
    across, right, up = view["across"], view["right"], view["up"]
    turned = np.moveaxis(hu, (2 - across, 2 - up, 2 - right), (0, 1, 2))[hu.shape[2 - across] // 2]
    turned = turned[:: -1 if view["flipUp"] else 1, :: -1 if view["flipRight"] else 1].astype(np.float32)
    picture = np.clip((turned - window[0]) * (255 / (window[1] - window[0])), 0, 255).astype(np.uint8)
    size = np.array([picture.shape[1] * spacing_mm[right], picture.shape[0] * spacing_mm[up]])
    wide, high = np.maximum(np.round(SLICE_PIXELS * size / size.max()), 1).astype(int)
    file = BytesIO()
    imsave(file, np.repeat(picture[..., None], 3, axis=2), format="png")
    return _image(file.getvalue(), str(view["name"]), f"width: {wide}px; height: {high}px; background: #000")


def _image(data: bytes, words: str, style: str) -> str:
    return f'<img alt="{escape(words)}" style="{style}" src="data:image/png;base64,{base64.b64encode(data).decode()}">'


def _table(rows: list[tuple[str, str]]) -> str:
    cells = "".join(f"<tr><th>{escape(name)}</th><td>{escape(value)}</td></tr>" for name, value in rows)
    return f"<table>{cells}</table>"
