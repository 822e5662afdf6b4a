"""Where a surface passes through itself.

Two triangles that are not in one plane pass through each other where, and only where, an edge of one passes through the
other. Every edge is tried against the triangles in its bins that share no point with it.
"""

import warnings

import numpy as np

from gpubspline.errors import GpubsplineWarning, InputError
from gpubspline.surface.bins import Bins, bin_triangles
from gpubspline.surface.boxes import CHUNK, walk_boxes
from gpubspline.surface.inside import SAMPLED, doubtful_share
from gpubspline.surface.surface import Floats, Integers, Surface, spelled, unique_edges

ROUNDING = 1e-12
"""Of the cube of the surface's extent. An end of an edge that makes a smaller tetrahedron with a triangle lies in its
plane: the edge touches it and does not pass through."""

DOUBTFUL = 2e-3
"""Of the volume: as much may be held twice or inside out."""


def check_apart(surface: Surface, name: str = "the surface") -> None:
    """Refuse a surface that passes through itself, unless what is inside is hardly in doubt: then warn.

    Raises
    ------
    InputError, with a place, where more than ``DOUBTFUL`` of the volume is held twice or inside out.
    """
    places = self_crossings(surface)
    if not len(places):
        return
    share, where = doubtful_share(surface), f"the first at {spelled(places[0])}"
    if share > DOUBTFUL:
        raise InputError(
            f"expected {name} not to pass through itself, got {len(places):,} edges that pass through triangles, "
            f"{where}, and {100 * share:.2g} % of the volume held twice or inside out: mend it, for example with "
            "MeshLab or pymeshfix"
        )
    warnings.warn(
        f"{name} passes through itself at {len(places):,} edges, {where}: what it holds twice, at most "
        f"{100 * max(share, 1 / SAMPLED):.2g} % of the volume, is taken as inside",
        GpubsplineWarning,
        stacklevel=3,
    )


def self_crossings(surface: Surface) -> Floats:
    """Places (n, 3), mm, at which an edge passes through the inside of a triangle, one for each such edge."""
    bins = bin_triangles(surface)
    edges = unique_edges(surface.triangles)
    ends = surface.points[edges]
    low, high = bins.index_of(ends.min(axis=1)), bins.index_of(ends.max(axis=1))
    crossed, places = [], []
    for edge, cell in walk_boxes(low, high):
        for one, triangle in _listed(bins, edge, cell):
            one, triangle = _boxes_meet(surface, ends, one, triangle)
            apart = (surface.triangles[triangle][:, :, None] != edges[one][:, None, :]).all(axis=(1, 2))
            one, triangle = one[apart], triangle[apart]
            hit, place = _pass_through(ends[one], surface.corners[triangle], surface)
            crossed.append(one[hit])
            places.append(place)
    if not crossed:
        return np.zeros((0, 3))
    _, unique = np.unique(np.concatenate(crossed), return_index=True)
    return np.asarray(np.concatenate(places)[unique])


def _listed(bins: Bins, edge: Integers, cell: Integers) -> list[tuple[Integers, Integers]]:
    """Every edge with every triangle of its bin, in parts that fit the memory."""
    number = (cell[:, 2] * bins.shape[1] + cell[:, 1]) * bins.shape[0] + cell[:, 0]
    first, count = bins.start[number].astype(np.int64), np.diff(bins.start)[number].astype(np.int64)
    parts = np.searchsorted(np.cumsum(count), np.arange(CHUNK, int(count.sum()), CHUNK))
    found = []
    for part in np.split(np.arange(len(number)), parts):
        total = count[part]
        rank = np.arange(total.sum()) - np.repeat(np.cumsum(total) - total, total)
        found.append((np.repeat(edge[part], total), bins.listed[np.repeat(first[part], total) + rank].astype(np.int64)))
    return found


def _boxes_meet(surface: Surface, ends: Floats, edge: Integers, triangle: Integers) -> tuple[Integers, Integers]:
    """Only the pairs whose boxes meet."""
    low, high = surface.corners.min(axis=1), surface.corners.max(axis=1)
    for axis in range(3):
        a, b = ends[edge, 0, axis], ends[edge, 1, axis]
        meet = (np.minimum(a, b) <= high[triangle, axis]) & (np.maximum(a, b) >= low[triangle, axis])
        edge, triangle = edge[meet], triangle[meet]
    return edge, triangle


def _pass_through(ends: Floats, corners: Floats, surface: Surface) -> tuple[Integers, Floats]:
    """Which segments (n, 2, 3) pass through triangles (n, 3, 3), and where."""
    p, q = ends[:, 0], ends[:, 1]
    a, b, c = np.moveaxis(corners, 1, 0)
    none = ROUNDING * float(np.ptp(surface.points, axis=0).max()) ** 3
    normal = np.cross(b - a, c - a)
    at_p, at_q = (np.einsum("ij,ij->i", end - a, normal) for end in (p, q))
    sides = [np.einsum("ij,ij->i", q - p, np.cross(e - p, f - p)) for e, f in ((a, b), (b, c), (c, a))]
    within = np.all([side >= 0 for side in sides], axis=0) | np.all([side <= 0 for side in sides], axis=0)
    parted = (at_p * at_q < 0) & (np.minimum(np.abs(at_p), np.abs(at_q)) > none)
    hit = np.flatnonzero(within & parted)
    share = (at_p[hit] / (at_p[hit] - at_q[hit]))[:, None]
    return hit, p[hit] + share * (q[hit] - p[hit])
