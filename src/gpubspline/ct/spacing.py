"""Where slices lie along their normal: missing ones, uneven ones, and the way back to even ones."""

from collections.abc import Sequence

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def is_uniform(along_mm: Floats) -> bool:
    """Whether positions are evenly spaced but for rounding.

    A slice may be off by 1 % of the step, or by what positions written to 0.1 mm make of it (0.05 mm at the slice, 0.05
    mm at the ends) where that stays below 10 % of the step.
    """
    if len(along_mm) < 3:
        return True
    even = np.linspace(along_mm[0], along_mm[-1], len(along_mm))
    step = float(even[1] - even[0])
    return bool(np.abs(along_mm - even).max() <= max(0.01 * step, min(0.1 * step, 0.101)))


def missing_slices(along_mm: Floats) -> list[int]:
    """Gaps (by the slice before them) in which slices are missing.

    A gap is a hole when it is about twice as wide, or wider, as the spacing around it. The spacing around a gap is the
    greatest value that three neighbouring gaps including it all reach (a morphological opening): it follows a series
    whose spacing changes on the way, since a new spacing holds for three gaps or more, but is not widened by one or
    two lost slices. It never falls below the finest spacing that occurs twice, so that one narrow gap where two scans
    meet does not turn its neighbours into holes.

    Arguments
    ---------
    along_mm: (n,) increasing positions.
    """
    gaps = np.diff(along_mm)
    if len(gaps) < 2:
        return []
    around = _opening(gaps, min(3, len(gaps)))
    ordered = np.sort(gaps)
    repeated = ordered[1:][np.diff(ordered) < 0.05 * ordered[:-1]]
    if len(repeated):
        around = np.maximum(around, repeated[0])
    return [int(i) for i in np.flatnonzero(gaps > 1.8 * around)]


def _opening(gaps: Floats, size: int) -> Floats:
    """Maximum, over the windows that hold a gap, of the window's minimum; no window passes the ends."""
    least = sliding_window_view(gaps, size).min(axis=1)
    return np.array([least[max(0, i - size + 1) : i + 1].max() for i in range(len(gaps))])


def uniform_positions(along_mm: Floats) -> Floats:
    """Evenly spaced positions from the first to the last slice.

    The step is the finest spacing that is not an exception (the 10th percentile of the gaps), adjusted to divide the
    length.
    """
    step = float(np.quantile(np.diff(along_mm), 0.1, method="nearest"))
    count = max(1, round(float(along_mm[-1] - along_mm[0]) / step))
    return np.linspace(along_mm[0], along_mm[-1], count + 1)


def resample_slices(hu: NDArray[np.generic], along_mm: Floats, target_mm: Floats) -> NDArray[np.generic]:
    """Interpolate linearly between slices at each pixel.

    Pixels keep their index, so where slices lie on a tilted line the result follows it.

    Arguments
    ---------
    hu: (n, rows, columns); along_mm: (n,) increasing; target_mm: (m,) within them.

    Returns: (m, rows, columns) of the type of ``hu``, rounded where that is an integer.
    """
    left = np.clip(np.searchsorted(along_mm, target_mm, side="right") - 1, 0, len(along_mm) - 2)
    weight = (target_mm - along_mm[left]) / (along_mm[left + 1] - along_mm[left])
    result = np.empty((len(target_mm), *hu.shape[1:]), dtype=hu.dtype)
    for k, (a, w) in enumerate(zip(left, weight, strict=True)):
        mixed = (1 - w) * hu[a] + w * hu[a + 1]
        result[k] = np.rint(mixed) if hu.dtype.kind == "i" else mixed
    return result


def describe_spacings(along_mm: Floats) -> str:
    """Gaps in words, as runs: ``13 x 4.002, 1 x 1.081, 13 x 6.999 mm``."""
    runs: list[tuple[float, int]] = []
    for gap in np.diff(along_mm):
        if runs and abs(gap - runs[-1][0]) < 0.01 * runs[-1][0]:
            runs[-1] = (runs[-1][0], runs[-1][1] + 1)
        else:
            runs.append((float(gap), 1))
    return _words(runs)


def _words(runs: Sequence[tuple[float, int]]) -> str:
    words = ", ".join(f"{count} x {gap:.4g}" for gap, count in runs[:6])
    return words + (" and so on mm" if len(runs) > 6 else " mm")
