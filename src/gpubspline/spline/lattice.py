"""The paper's control lattice: evenly spaced rows of each slice, evenly spaced points of each row."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from gpubspline.ct.partial_volume import check_treatment, folding
from gpubspline.ct.region import Region
from gpubspline.ct.volume import Volume
from gpubspline.device import Device
from gpubspline.errors import InputError, expect
from gpubspline.shown import brief
from gpubspline.spline.reformat import Stack, stack
from gpubspline.spline.spans import Floats, blend, fill_gaps, inset, row_spans, tips

DEFAULT_SHAPE = (20, 24, 46)
DEFAULT_SLICE_SHAPE = (60, 60)
INSET = 0.01  # of the extent, and one voxel at most
SMOOTHING = 1.5  # rows
MOST_SMOOTHING = 100.0  # rows; beyond it nothing of a body's shape is left, and the filter takes for ever
SLICE_SMOOTHING = 2 / 3  # of the rows' smoothing, in slices: they lie further apart
LARGEST_DATA = 8e6  # points to fit to: 256 MB of x, y, z, HU
ORDERS = {"linear": 1, "cubic": 3}
CUBIC_MARGIN = 12  # voxels; the cubic prefilter forgets by 0.27 a voxel, so 1e-7 is left


@dataclass(frozen=True, eq=False)
class ControlLattice:
    """Control points of a hyperpatch.

    Attributes
    ----------
    points: (n_u, n_v, n_w, 3 + C) float64, or (n_u, n_v, 3 + C) for one slice: x, y, z in LPS mm, then the material
        channels. Fortran-ordered, so that each component is a plane with u fastest.
    channels: names of the C material channels, the first of them HU.
    """

    points: Floats
    channels: tuple[str, ...] = ("HU",)

    __repr__ = brief

    def __post_init__(self) -> None:
        """Check the shape once and settle the memory order."""
        points = np.asfortranarray(self.points, dtype=np.float64)
        if points.ndim not in (3, 4) or points.shape[-1] != 3 + len(self.channels) or min(points.shape[:-1]) < 2:
            expected = f"(n_u, n_v[, n_w], {3 + len(self.channels)}) with at least 2 points a direction"
            raise InputError(f"expected control points of shape {expected}, got {points.shape}")
        object.__setattr__(self, "points", points)

    @property
    def shape(self) -> tuple[int, ...]:
        """(n_u, n_v, n_w), or (n_u, n_v) for one slice."""
        return self.points.shape[:-1]


def control_lattice(
    volume: Volume,
    region: Region,
    shape: tuple[int, ...],
    *,
    axis: str = "z",
    slice_index: int | None = None,
    interpolation: str = "linear",
    smoothing: float = SMOOTHING,
    partial_volume: str = "fold",
) -> ControlLattice:
    """Lay a control lattice through the region by row spans (section 3.1 and Fig. 2 of the paper).

    In each of n_w slices, evenly between the first and the last that hit the region, lie n_v rows evenly between the
    first and the last row that hit it; on each row n_u points evenly between its first entry into the region and its
    last exit. All four ends are found between voxels. Slices and rows between voxels blend their neighbours' distance;
    a row in between that misses the region takes its span from its neighbours. The first and last row and slice lie
    one per cent of the extent inside the tips, and one voxel at most, where a row has length, unless the scan itself
    ends there.

    Arguments
    ---------
    shape: (n_u, n_v, n_w), or (n_u, n_v) for the one slice ``slice_index``.
    axis: stacking axis, ``"x"``, ``"y"``, ``"z"`` (image axis i, j, k) or ``"long"`` (the region's principal axis);
        (u, v, w) follow cyclically, so that rows run along i where slices are stacked along k.
    slice_index: voxel index along ``axis`` of the slice to take alone.
    interpolation: ``"linear"`` or ``"cubic"``, of HU at the points.
    smoothing: standard deviation, in rows of the lattice (two thirds of it in slices), of the Gaussian that takes from
        the row ends what is finer than the lattice (an ear that one row meets and the next does not); 0 leaves them.
    partial_volume: ``"fold"`` gives HU near the surface what the scan spread outside of it (``ct.partial_volume``);
        ``"none"`` leaves HU as they lie, as the paper does: at row ends they are half of what lies outside.

    Raises
    ------
    InputError where the lattice asks for more points than the data have, for fewer than 2 in a direction, or for
    slices, axes or interpolations that are not there.
    """
    expect(volume, Volume, "read_volume reads one, Volume(hu, affine) makes one of an array")
    expect(region, Region, "region_from_threshold or region_from_mask finds one")
    if volume.hu.shape != region.distance_mm.shape:
        raise InputError(f"expected a region on the volume's grid {volume.hu.shape}, got {region.distance_mm.shape}")
    if not 0 <= smoothing <= MOST_SMOOTHING:
        raise InputError(f"expected a smoothing of 0 to {MOST_SMOOTHING:g} rows, got {smoothing:g}")
    slices = _slices(stack(region, axis), len(shape), axis, slice_index)
    _check_limits(shape, _limits(slices))
    points = slices.to_points(_lattice_indices(slices.distance_mm, shape, smoothing))
    hu = surface_hu(volume, region, points, interpolation, partial_volume)
    lattice = np.concatenate([points, hu[..., None]], axis=-1)
    return ControlLattice(lattice if len(shape) == 3 else lattice[:, :, 0])


def default_shape(region: Region, axis: str = "z", slice_index: int | None = None) -> tuple[int, ...]:
    """Give control counts that suit the region and that its data allow.

    Returns: (n_u, n_v, n_w), or (n_u, n_v) where one slice is asked for.

    Raises InputError where the region is one voxel thin.
    """
    default = DEFAULT_SHAPE if slice_index is None else DEFAULT_SLICE_SHAPE
    limits = _limits(_slices(stack(region, axis), len(default), axis, slice_index))
    if min(limits[: len(default)]) < 2:
        raise InputError(f"expected a body of 2 voxels or more each way, got {_spelled(limits)}: too small to mesh")
    return tuple(min(count, limit) for count, limit in zip(default, limits, strict=False))


def data_shape(region: Region, axis: str = "z", slice_index: int | None = None) -> tuple[int, ...]:
    """Give the most points that the data allow: the widest row's samples, the rows and the slices that hit the region.

    Where that is more than ``LARGEST_DATA`` points, every direction gives up its share.

    Returns: (n_u, n_v, n_w), or (n_u, n_v) where one slice is asked for.
    """
    directions = 3 if slice_index is None else 2
    limits = _limits(_slices(stack(region, axis), directions, axis, slice_index))[:directions]
    share = min(1.0, (LARGEST_DATA / float(np.prod(limits))) ** (1 / directions))
    return tuple(max(int(limit * share), min(limit, 2)) for limit in limits)


def _slices(whole: Stack, directions: int, axis: str, slice_index: int | None) -> Stack:
    """Give the stack that the lattice is laid in: all of it, or one slice."""
    if directions not in (2, 3):
        raise InputError(f"expected 2 or 3 control counts, got {directions}")
    if directions == 3:
        if slice_index is not None:
            raise InputError("expected two control counts for one slice, got three")
        if whole.slices == 1:
            raise InputError(
                f"expected several slices along {axis} for a solid, got one: ask for a surface of slice 0 (--slice 0)"
            )
        return whole
    if whole.slices is None:
        raise InputError("expected the axis x, y or z for one slice, got long, whose slices are no voxels'")
    if slice_index is None and whole.slices > 1:
        raise InputError(f"expected a slice of the {whole.slices} along {axis} for two control counts, got none")
    return _one_slice(whole, slice_index or 0, axis)


def _one_slice(whole: Stack, index: int, axis: str) -> Stack:
    if not 0 <= index < (whole.slices or 0):
        raise InputError(f"expected a slice of 0 to {(whole.slices or 0) - 1} along {axis}, got {index}")
    at = index - whole.first
    inside = whole.distance_mm < 0
    if not 0 <= at < len(inside) or not inside[at].any():
        hits = np.flatnonzero(inside.any(axis=(1, 2))) + whole.first
        raise InputError(f"expected a slice that hits the region ({hits[0]} to {hits[-1]} along {axis}), got {index}")
    affine = whole.affine.copy()
    affine[:3, 3] = whole.to_points(np.array([0.0, 0.0, at]))
    return Stack(whole.distance_mm[at : at + 1], affine, index, 1)


def _limits(slices: Stack) -> tuple[int, int, int]:
    """Most samples of a row between its ends, most rows of a slice between its ends, slices between the ends."""
    inside = np.asarray(slices.distance_mm < 0)
    rows = np.asarray(inside.any(axis=2))
    return _extent(inside), _extent(rows), _extent(np.any(rows, axis=1, keepdims=True).T)


def _extent(inside: NDArray[np.bool_]) -> int:
    first, beyond = inside.argmax(axis=-1), inside.shape[-1] - inside[..., ::-1].argmax(axis=-1)
    return int((beyond - first)[inside.any(axis=-1)].max())


def _check_limits(shape: tuple[int, ...], limits: tuple[int, int, int]) -> None:
    if min(shape) < 2:
        raise InputError(f"expected at least 2 control points a direction, got {_spelled(shape)}")
    most = limits[: len(shape)]
    if len(shape) == 3 and limits[2] < 2:
        raise InputError(
            "expected a region of several slices for a solid, got one slice: ask for a surface of it (--slice)"
        )
    if any(count > limit for count, limit in zip(shape, most, strict=True)):
        raise InputError(
            f"expected at most {_spelled(most)} control points, the widest row's samples, the rows and the slices that "
            f"hit the region; got {_spelled(shape)}"
        )


def _spelled(shape: tuple[Any, ...]) -> str:
    return ",".join(str(int(n)) for n in shape)


def _lattice_indices(distance_mm: NDArray[Any], shape: tuple[int, ...], smoothing: float) -> Floats:
    """(n_u, n_v, n_w, 3) fractional indices (u, v, w) of the lattice in the stack."""
    n_u, n_v, n_w = (*shape, 1)[:3]
    w = np.zeros(1) if n_w == 1 else _slice_positions(distance_mm, n_w)
    slabs = blend(distance_mm, w, axis=0)
    first, final = (fill_gaps(end[None])[0] for end in inset(*tips(slabs), slabs.shape[1] - 1, INSET))
    v = np.linspace(first, final, n_v, axis=1)  # (n_w, n_v)
    enter, leave = (fill_gaps(end) for end in row_spans(blend(slabs, v, axis=1)))
    enter, leave = _smooth([enter, leave], smoothing)
    u = np.linspace(enter, leave, n_u)  # (n_u, n_w, n_v)
    return np.asarray(np.stack(np.broadcast_arrays(u, v, w[:, None]), axis=-1).swapaxes(1, 2))


def _slice_positions(distance_mm: NDArray[Any], n_w: int) -> Floats:
    first, final = inset(*tips(distance_mm[None]), len(distance_mm) - 1, INSET)
    return np.linspace(first[0], final[0], n_w)


def _smooth(ends: list[Floats], sigma: float) -> list[Floats]:
    if sigma <= 0:
        return ends
    across = SLICE_SMOOTHING * sigma
    return [
        np.asarray(ndimage.gaussian_filter(end, (across, sigma)[: end.ndim], mode="nearest"))  # (slices[, rows])
        for end in ends
    ]


def surface_hu(
    volume: Volume,
    region: Region,
    points: Floats,
    interpolation: str = "linear",
    partial_volume: str = "fold",
    device: Device | None = None,
) -> Floats:
    """HU (...) at LPS points (..., 3) of a body, by its treatment of the partial volume at the surface."""
    check_treatment(partial_volume)
    hu = sample_hu(volume, points, interpolation)
    if partial_volume == "none":
        return hu
    flat = points.reshape(-1, 3)
    return hu + folding(volume, region, flat, device).correction(flat).reshape(hu.shape)


def sample_hu(volume: Volume, points: Floats, interpolation: str = "linear") -> Floats:
    """HU (...) at LPS points (..., 3), ``"linear"`` or ``"cubic"``, from the part of the volume around them; outside
    of it that of the nearest place on its boundary.

    Raises InputError for another interpolation.
    """
    if interpolation not in ORDERS:
        raise InputError(f"expected the interpolation {' or '.join(ORDERS)}, got {interpolation!r}")
    order = ORDERS[interpolation]
    indices = volume.to_indices(points)
    others = tuple(range(indices.ndim - 1))
    last = np.array(volume.shape) - 1  # points may lie outside, all of them beyond one end too
    low = np.clip(np.floor(np.minimum(indices.min(axis=others), last)).astype(int) - CUBIC_MARGIN, 0, last)
    high = np.clip(np.ceil(np.maximum(indices.max(axis=others), 0)).astype(int) + CUBIC_MARGIN + 1, 1, last + 1)
    window = tuple(slice(int(a), int(b)) for a, b in zip(low[::-1], high[::-1], strict=True))
    coordinates = np.moveaxis((indices - low)[..., ::-1], -1, 0)
    part = volume.hu[window] if order == 1 else volume.hu[window].astype(np.float64)
    return np.asarray(ndimage.map_coordinates(part, coordinates, np.float64, order=order, mode="nearest"))
