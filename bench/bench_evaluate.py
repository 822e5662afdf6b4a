"""A hyperpatch of x, y, z, HU on a grid of parameters.

Floors, a node of K = 4 channels: 4 K = 16 bytes written; the control points and the planes between the passes stay in
the caches. Operations: the last of the three passes contracts degree + 1 planes, 2 K (degree + 1) = 32 for a cubic, the
passes before it a small share of that. Held against ``fill``.
"""

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np

from gpubspline.bench.measure import Peer, Place, Row, best_of, cores, peer, time_peers
from gpubspline.bench.recorder import Recorder
from gpubspline.spline.hyperpatch import Hyperpatch, hyperpatch

PAPER = (20, 24, 46)
CASES = {  # control points, degree, nodes a direction
    "full": [(PAPER, 3, 200), (PAPER, 3, 460), *(((n,) * 3, p, 200) for n in (64, 128) for p in (1, 2, 3, 4, 5))],
    "quick": [(PAPER, 3, 128), ((64,) * 3, 1, 128), ((64,) * 3, 3, 128), ((64,) * 3, 5, 128), ((128,) * 3, 3, 128)],
    "tiny": [((5, 6, 7), 3, 9), ((4, 4, 4), 1, 8)],
}
FAST_CASE = (PAPER, 3, 700)
ROUNDING = 3e-7
"""For each control point along an axis: so much steeper is the basis over parameters, which float32 rounds by 6e-8."""


def random_patch(control: tuple[int, ...], degree: int) -> Hyperpatch:
    """A right-handed patch of about 100 mm with four random channels; its nodes are jittered by a fifth of a cell."""
    rng = np.random.default_rng(2)
    corners = np.stack(np.meshgrid(*(np.arange(n) for n in control), indexing="ij"), axis=-1)
    place = (corners + rng.uniform(-0.2, 0.2, corners.shape)) * (100 / (np.array(control) - 1))
    hu = rng.uniform(100, 2000, (*control, 1))
    return hyperpatch(np.concatenate([place, hu], axis=-1), degree)


def rows(place: Place) -> Iterator[Row]:
    """Time the kernels on buffers that stay on the device; the paper's patch against every peer, others scipy."""
    cases = CASES[place.scale] + [FAST_CASE] * (place.fast and place.scale == "full")
    for number, (control, degree, n) in enumerate(cases):
        patch, axes, recorder = random_patch(control, degree), [np.linspace(0, 1, n)] * 3, Recorder(place.device)
        planes = patch.evaluate_grid(axes, recorder).T
        peers: dict[str, Peer] = {"scipy": partial(_scipy, patch, axes)}
        if number == 0:
            peers |= {"scipy float64": partial(_scipy_rows, patch, axes)}
            peers |= {"splipy": partial(_splipy, patch, axes)}
            peers |= {"splinepy": partial(_splinepy, patch, axes)}
        others = time_peers("evaluate", planes, ROUNDING * max(control), peers)
        seconds, floor = best_of(recorder.replay), planes.nbytes / place.fill
        size = f"degree {degree}, control {'x'.join(map(str, control))}, {n}x{n}x{n} nodes"
        yield Row("evaluate", size, place.device.name, seconds, n**3, floor / seconds, others)


def _design(patch: Hyperpatch, axes: list[Any]) -> list[Any]:
    from scipy.interpolate import BSpline

    each = zip(axes, patch.knots, patch.degrees, strict=True)
    return [BSpline.design_matrix(t, knots, degree) for t, knots, degree in each]


def _scipy(patch: Hyperpatch, axes: list[Any]) -> tuple[Any, Any]:
    """Sparse design matrices, one axis at a time: float32, planes, and nothing transposed after the largest product."""
    u, v, w = (matrix.astype(np.float32) for matrix in _design(patch, axes))
    control = np.ascontiguousarray(patch.control, dtype=np.float32)
    n_u, n_v, n_w, channels = control.shape

    def run() -> Any:
        rows = (u @ control.reshape(n_u, -1)).reshape(-1, n_v, n_w, channels)
        rows = np.ascontiguousarray(rows.transpose(1, 2, 3, 0))  # v, w, channel, u
        planes = (v @ rows.reshape(n_v, -1)).reshape(len(axes[1]), n_w, channels, -1)
        planes = np.ascontiguousarray(planes.transpose(1, 2, 0, 3))  # w, channel, v, u
        return w @ planes.reshape(n_w, -1)

    def view(values: Any) -> Any:
        return values.reshape(len(axes[2]), channels, len(axes[1]), len(axes[0])).swapaxes(0, 1)

    return run, view


def _scipy_rows(patch: Hyperpatch, axes: list[Any]) -> tuple[Any, Any]:
    """The same as SciPy's matrices come, in float64, to an array of nodes."""
    matrices, control = _design(patch, axes), np.ascontiguousarray(patch.control)

    def run() -> Any:
        values = control
        for matrix in matrices:  # each axis comes to the front in turn
            values = np.moveaxis((matrix @ values.reshape(len(values), -1)).reshape(-1, *values.shape[1:]), 0, 2)
            values = np.ascontiguousarray(values)
        return values

    return run, lambda values: values.T


def _splipy(patch: Hyperpatch, axes: list[Any]) -> tuple[Any, Any]:
    splipy = peer("splipy")
    bases = [splipy.BSplineBasis(p + 1, knots) for p, knots in zip(patch.degrees, patch.knots, strict=True)]
    solid = splipy.Volume(*bases, controlpoints=patch.control.reshape(-1, patch.control.shape[-1], order="F"))
    return lambda: solid(*axes), lambda values: values.T


def _splinepy(patch: Hyperpatch, axes: list[Any]) -> tuple[Any, Any]:
    splinepy, counts = peer("splinepy"), [len(axis) for axis in axes]
    control = np.ascontiguousarray(patch.control.reshape(-1, patch.control.shape[-1], order="F"))
    solid = splinepy.BSpline(patch.degrees, [knots.tolist() for knots in patch.knots], control)
    return lambda: solid.sample(counts, nthreads=cores()), lambda values: values.T.reshape(-1, *counts[::-1])
