"""Sections of a region: the contour of each, between voxels."""

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.ct.region import Region
from gpubspline.errors import GpubsplineWarning, InputError, NoSectionsError
from gpubspline.spline.reformat import Stack, stack
from gpubspline.spline.spans import blend, inset, tips

Floats = NDArray[np.float64]

INSET = 0.01
"""Of the extent, one voxel at most, that the first and last section lie inside the tips, as in the tensor lattice."""

SPECK = 0.01
"""Of a section's area: smaller parts (the lobe of an ear) and holes are left out, with a word."""


@dataclass(frozen=True, eq=False)
class Sections:
    """Contours of sections along an axis.

    Attributes
    ----------
    loops: for each section the points (n, 2), mm, counter-clockwise, the last not the first again.
    w: (l,) fractional slice index of each section.
    frame: (2, 3) unit vectors of the sections' plane, in LPS; right-handed with the direction of stacking.
    stack: what the sections were cut from.
    """

    loops: list[Floats]
    w: Floats
    frame: Floats
    stack: Stack

    def to_mm(self, points: Floats) -> Floats:
        """LPS mm (..., l, 3) of points (..., l, 2) in the planes of the l sections."""
        foot = self.stack.affine[:3, 3] + self.w[:, None] * self.stack.affine[:3, 2]
        return np.asarray(points @ self.frame + foot)


def cut_sections(region: Region, count: int | None = None, axis: str = "z") -> Sections:
    """Cut a region into sections, evenly between its tips.

    Arguments
    ---------
    count: of sections; None takes as many as there are slices, 46 at most.
    axis: ``"x"``, ``"y"``, ``"z"`` or ``"long"``, as in ``control_lattice``.

    Raises
    ------
    NoSectionsError where a section has several parts or a hole, saying where, or the region is one slice.
    InputError where the count is too small.
    """
    whole = stack(region, axis)
    hits = int((whole.distance_mm < 0).any(axis=(1, 2)).sum())
    if hits < 2:
        found = "one slice"
        raise NoSectionsError(f"expected a region of several slices, got {found}: ask for a tensor surface", found)
    count = min(hits, 46) if count is None else count
    if count < 2:
        raise InputError(f"expected at least 2 sections, got {count}")
    first, final = inset(*tips(whole.distance_mm[None]), len(whole.distance_mm) - 1, INSET)
    w = np.linspace(first[0], final[0], count)
    frame = _frame(whole.affine)
    steps = frame @ whole.affine[:3, :2]  # (2, 2) mm of a step along u and v
    slices = blend(whole.distance_mm, w, axis=0)
    loops, left = zip(*(_loop(image, steps, whole, at) for image, at in zip(slices, w, strict=True)), strict=True)
    if max(left) > 1e-9:
        several, most = int(np.count_nonzero(np.array(left) > 1e-9)), 100 * max(left)
        warnings.warn(
            f"{several} of {count} sections have parts or holes of up to {most:.2g} % of their area, which a butterfly "
            "leaves out",
            GpubsplineWarning,
            stacklevel=2,
        )
    return Sections(list(loops), w, frame, whole)


def _frame(affine: Floats) -> Floats:
    """Unit vectors in the plane of u and v; the second turned so that contours run alike on mirrored grids."""
    one = affine[:3, 0] / np.linalg.norm(affine[:3, 0])
    other = affine[:3, 1] - (affine[:3, 1] @ one) * one
    other = other / np.linalg.norm(other)
    if np.cross(one, other) @ affine[:3, 2] < 0:
        other = -other
    return np.stack([one, other])


def _loop(image: NDArray[np.float32], steps: Floats, whole: Stack, at: float) -> tuple[Floats, float]:
    """The one contour of a section, counter-clockwise, and the area of what is left out over its own."""
    found = [loop[:-1] @ steps.T for loop in zero_lines(image)]
    areas = np.array([signed_area(loop) for loop in found])
    # contours run with the inside on one side: holes turn the other way than the outline does
    outline = int(np.argmax(np.abs(areas)))
    alike = np.sign(areas) == np.sign(areas[outline])
    share = np.abs(areas / areas[outline])
    large = share > SPECK
    parts, holes = int(np.sum(alike & large)), int(np.sum(~alike & large))
    if parts > 1 or holes:
        raise _several(parts, holes, whole, at, found[outline].mean(axis=0), steps)
    loop = found[outline]
    return loop if areas[outline] > 0 else loop[::-1], float(share.sum()) - 1


def _several(parts: int, holes: int, whole: Stack, at: float, middle: Floats, steps: Floats) -> NoSectionsError:
    u, v = np.linalg.solve(steps, middle)
    place = whole.to_points(np.array([u, v, at]))
    where = ", ".join(f"{x:.1f}" for x in place)
    what = [f"{parts} parts"] * (parts > 1) + ["a hole" if holes == 1 else f"{holes} holes"] * (holes > 0)
    found = f"a section with {' and '.join(what)} at ({where}) mm"
    return NoSectionsError(
        f"expected every section of a butterfly to be one part without holes, got {found}: blocks mesh any shape "
        "(--method blocks)",
        found,
    )


def zero_lines(image: NDArray[Any]) -> list[Floats]:
    """Closed polylines (n + 1, 2), in samples (u, v), of the zero level; what meets the border is closed along it."""
    from contourpy import contour_generator

    padded = np.pad(image.astype(np.float64), 1, constant_values=1e6)
    return [np.asarray(line) - 1.0 for line in contour_generator(z=padded, name="serial").lines(0.0)]


def signed_area(loop: Floats) -> float:
    """Area of a polygon (n, 2), positive where it runs counter-clockwise."""
    x, y = loop.T
    return float(0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))
