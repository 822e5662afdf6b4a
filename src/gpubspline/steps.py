"""From CT to a hyperpatch in three lines of Python: each step a plain function, its progress shown where one looks on.

The rest of the way are ``sample``, ``apply_material``, ``assess`` and ``write``.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.ct.image import read_volume
from gpubspline.ct.masks import read_mask
from gpubspline.ct.region import Region, otsu_threshold, region_from_mask, region_from_threshold
from gpubspline.ct.volume import Volume
from gpubspline.device import Device, open_device
from gpubspline.errors import InputError
from gpubspline.progress import ShownClock, is_watched
from gpubspline.spline.fit import fit
from gpubspline.spline.hyperpatch import Hyperpatch
from gpubspline.spline.lattice import control_lattice, data_shape, default_shape


def read(source: str | Path | Sequence[str | Path], **how: Any) -> Volume:
    """Read a CT; see ``read_volume`` for what it reads and ``how``."""
    with ShownClock(is_watched()) as clock, clock.stage("read"):
        return read_volume(source, progress=clock.advance, **how)


def region(
    volume: Volume,
    threshold_hu: float | None = None,
    *,
    mask: str | Path | NDArray[np.bool_] | None = None,
    label: int | None = None,
    **how: Any,
) -> Region:
    """Find the body: by a threshold, by a mask, or by Otsu's threshold where neither is given.

    Arguments
    ---------
    volume: the CT.
    threshold_hu: what lies at or above it is body.
    mask: (n_k, n_j, n_i) bool, or a mask or label file on the volume's grid.
    label: in a label file; all but 0 unless told.
    how: see ``region_from_threshold`` or ``region_from_mask``.

    Raises
    ------
    InputError where both a threshold and a mask are given, a label without a file, or nothing is found.
    """
    if mask is not None and threshold_hu is not None:
        raise InputError("expected a threshold or a mask, got both")
    if label is not None and not isinstance(mask, str | Path):
        raise InputError("expected a label together with a mask file, got a label alone")
    with ShownClock(is_watched()) as clock, clock.stage("region"):
        if mask is not None:
            inside = read_mask(Path(mask), volume, label) if isinstance(mask, str | Path) else mask
            return region_from_mask(volume, inside, **how)
        return region_from_threshold(volume, otsu_threshold(volume) if threshold_hu is None else threshold_hu, **how)


def patch(
    volume: Volume,
    region: Region,
    control: Sequence[int] | None = None,
    *,
    method: str = "control",
    degree: int | Sequence[int] = 3,
    device: Device | None = None,
    **how: Any,
) -> Hyperpatch:
    """Lay a control lattice through the body and make the hyperpatch.

    Arguments
    ---------
    volume, region: the CT and the body in it.
    control: control points per parameter, (n_u, n_v, n_w), or (n_u, n_v) for one slice; by the data unless told.
    method: ``"control"``, ``"interpolate"`` or ``"least-squares"``; see ``fit``.
    degree: one, or one per parameter.
    device: where to compute; ``open_device()`` unless told.
    how: ``axis``, ``slice_index``, ``interpolation``, ``smoothing``; see ``control_lattice``.

    Raises
    ------
    InputError where the counts, degrees or method do not fit the data.
    """
    axis, only = how.get("axis", "z"), how.get("slice_index")
    with ShownClock(is_watched()) as clock:
        with clock.stage("lattice"):
            shape = default_shape(region, axis, only) if control is None else tuple(control)
            laid = data_shape(region, axis, only) if method == "least-squares" else shape
            lattice = control_lattice(volume, region, laid, **how)
        with clock.stage("fit"):
            return fit(lattice, method, degree=degree, control=shape, device=device or open_device()).patch
