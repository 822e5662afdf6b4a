"""Five matched hyperpatches through the points of all sections.

Patches that share a face have the same data points there and the same knots along it. An interpolating patch with
clamped knots has a face that is the interpolant of that face's data, so the patches meet.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpubspline.ct.region import Region
from gpubspline.ct.volume import Volume
from gpubspline.device import Device
from gpubspline.errors import InputError, NoSectionsError
from gpubspline.mesh.butterfly.contours import Sections, cut_sections
from gpubspline.mesh.butterfly.matching import match_loops
from gpubspline.mesh.butterfly.placement import Layout, corner_sines, harmonic, transfinite
from gpubspline.shown import brief
from gpubspline.spline.fit import FitError, fit
from gpubspline.spline.hyperpatch import Hyperpatch
from gpubspline.spline.lattice import ControlLattice, surface_hu

Floats = NDArray[np.float64]

CONTROL = (13, 13, 7)
"""Data points along the square's sides and from it to the contour."""

SMOOTHING = 1.5
"""Standard deviation, in data points, of the Gaussian that takes from contours what is finer than they are."""

STARTS = 16
"""Places tried for the square's first corner, over half a turn."""

PLACEMENTS = {"harmonic": harmonic, "transfinite": transfinite}


@dataclass(frozen=True, eq=False)
class Butterfly:
    """Five hyperpatches that meet, one round the axis and four between it and the surface.

    Attributes
    ----------
    patches: ``centre`` over (u, v, w), and ``v0``, ``u1``, ``v1``, ``u0`` over (outwards, along the side, w).
    placement: ``"harmonic"`` or ``"transfinite"``: how points inside the sections were placed.
    worst_corner: least sine of a corner of the data's quads within the sections.
    sections: what the patches run through.
    error: distance of the patches from their data.
    has_hu: whether HU is that of a CT.
    """

    patches: dict[str, Hyperpatch]
    placement: str
    worst_corner: float
    sections: Sections
    error: FitError
    has_hu: bool

    __repr__ = brief

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """Control points along the square's sides, outwards and along the axis."""
        u, v, w = self.patches["centre"].shape
        return u, v, self.patches["u0"].shape[0], w


def butterfly(
    region: Region,
    volume: Volume | None = None,
    *,
    control: tuple[int, int, int, int] | None = None,
    axis: str = "z",
    degree: int = 3,
    placement: str | None = None,
    smoothing: float = SMOOTHING,
    interpolation: str = "linear",
    partial_volume: str = "fold",
    device: Device,
) -> Butterfly:
    """Lay five hyperpatches through a region whose every section is one part without holes.

    Arguments
    ---------
    region: mask and signed distance.
    volume: the CT that HU is taken from; on any grid. Without it HU is 0 and no field.
    control: data points along the square's two sides, outwards, and along the axis.
    axis: that sections are stacked along, ``"x"``, ``"y"``, ``"z"`` or ``"long"``.
    degree: of the patches; lower where there are fewer points.
    placement: of points inside the sections: ``"harmonic"``, ``"transfinite"``, or None for the better of the two.
    smoothing: of the contours, in data points; 0 leaves them.
    interpolation, partial_volume: of HU, as ``control_lattice`` has them.

    Raises
    ------
    NoSectionsError where a section has several parts or a hole, saying where, or points fold; InputError where counts
    are too few or an option is unknown.
    """
    if placement is not None and placement not in PLACEMENTS:
        raise InputError(f"expected the placement {' or '.join(PLACEMENTS)}, got {placement!r}")
    if control is not None and (len(control) != 4 or min(control) < 2):
        raise InputError(f"expected 4 control counts U,V,R,W of at least 2, got {control}")
    sections = cut_sections(region, None if control is None else control[3], axis)
    layout = Layout(*(CONTROL if control is None else control[:3]))
    names = list(PLACEMENTS) if placement is None else [placement]
    worst, name, placed = _best(layout, sections, names, smoothing)
    if worst <= 0:
        found = "a section so far from round that points fold in it"
        raise NoSectionsError(
            f"expected sections that five patches can fill, got {found}: blocks mesh any shape (--method blocks)", found
        )
    points = sections.to_mm(placed)
    hu = np.zeros(points.shape[:-1])
    if volume is not None:
        hu = surface_hu(volume, region, points, interpolation, partial_volume, device)
    data = np.concatenate([points, hu[..., None]], axis=-1)
    made = {key: _patch(data[numbers], degree, device) for key, numbers in layout.blocks.items()}
    errors = [error for _, error in made.values()]
    most = FitError(*(max(getattr(e, part) for e in errors) for part in ("mean_mm", "max_mm", "mean_hu", "max_hu")))
    return Butterfly({k: p for k, (p, _) in made.items()}, name, worst, sections, most, volume is not None)


def _best(layout: Layout, sections: Sections, names: list[str], smoothing: float) -> tuple[float, str, Floats]:
    """Place the points in every way asked for and from several first corners, and keep the best worst corner."""
    found: list[tuple[float, str, Floats]] = []
    for turn in 0.5 * np.arange(STARTS) / STARTS:
        border = match_loops(sections.loops, layout.around, 0.5 + float(turn), smoothing)
        for name in names:
            placed = PLACEMENTS[name](layout, border)
            found.append((float(corner_sines(layout, placed).min()), name, placed))
    return max(found, key=lambda one: one[0])


def _patch(data: Floats, degree: int, device: Device) -> tuple[Hyperpatch, FitError]:
    degrees = tuple(min(degree, n - 1) for n in data.shape[:-1])
    made = fit(ControlLattice(data), "interpolate", degree=degrees, device=device)
    return made.patch, made.error
