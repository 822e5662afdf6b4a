"""A hyperpatch of x, y, z, HU on a grid of parameters.

Floors, a node of K = 4 channels: 4 K = 16 bytes written; the control points and the planes between the passes stay in
the caches. Against ``writing``. Operations: 2 K (degree + 1) = 32 for a cubic in the pass along w, which makes every
node; those along v and u make n_w / N and n_v n_w / N^2 as many numbers of n control points and N nodes a direction:

    control       200^3 nodes                   460^3 nodes
    20 x 24 x 46  1 + 0.23 + 0.03 = 1.26        1 + 0.10 + 0.01 = 1.11
    64^3          1 + 0.32 + 0.10 = 1.42        1 + 0.14 + 0.02 = 1.16
    128^3         1 + 0.64 + 0.41 = 2.05        1 + 0.28 + 0.08 = 1.36

A cubic 128^3 at 200^3 thus costs 1.6 times the paper's control by operations alone, degree 5 half as much again, and
1.26 times by bytes, since its control points are a fourth of its nodes and lie in no cache. The paper's patch itself
goes near the speed of memory, 4.2 ms of processor for 200^3 on two cores of Zen 5 by PoCL, 3.1 of them its stores, so
that whatever another adds is seen. By processor time, degrees 1 to 5 (300^3: 1, 3, 4 and 5; 460^3: 1, 3 and 5), in turn
with the paper's patch on a busy machine:

    control  200^3 nodes                   300^3 nodes             460^3 nodes
    64^3     1.09, 1.11, 1.17, 1.20, 1.26
    128^3    1.50, 1.60, 1.66, 1.80, 1.85  1.19, 1.33, 1.38, 1.48  1.12, 1.16, 1.26

The last pass takes 3.5 ms at 200^3 whatever the degree and the control points: its stores hide the rest. What is before
it takes 0.7 ms for the paper's patch, 3.5 for degree 3 of 128^3 and 4.6 for degree 5. Of the 3.5 are 1.9 the 1.3
million vectors of 16 along v, 6 cycles each, 4 where nothing has to go to the second cache; and 1.6 the 0.9 million
along u, 15 instructions each and 8 for what their weights and rows take, and reading 34 MB, 0.7 ms were nothing
overlapped. Rows so short are not foreseen by the processor: 13 ms where calls do not ask for those of the next. The aim
of 1.6 leaves 2.5 ms for what is added; degree 5 meets it where nodes are many for their control points. The peer
``cubic 20x24x46`` is the paper's patch at as many nodes, timed in turn with each.

Peers: ``scipy float64`` is SciPy's sparse design matrices applied axis by axis as they come, 40 to 50 million nodes a
second of a core at best, 12 million where the machine is busy: it is this form that 16 to 24 million and the aim of 20
times are of. ``scipy`` is the same idea in the fastest form found, of our own devising: float32, component planes,
nothing transposed after the largest product, 140 million nodes a second of a core at 128^3 and 230 at 200^3. No
evaluation that writes its nodes to memory can be faster than a peer by more than the ratio over the share of bandwidth,
which the table gives after ``of``: about ten times the fast form on two cores, whatever the kernel, and a hundred times
the natural one. ``splinepy`` makes a million nodes a second of a core. On a GPU ``CuPy`` multiplies the design matrices
as dense ones by the vendor's own library, in float32.
"""

from collections.abc import Iterator
from functools import partial
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.bench import gpu_peers
from gpubspline.bench.measure import Peer, Place, Row, Run, best_in_turn, best_of, check, cores, peer, time_peers
from gpubspline.bench.recorder import Recorder
from gpubspline.spline.hyperpatch import Hyperpatch, hyperpatch

PAPER = (20, 24, 46)
CUBES = ((64, 64, 64), (128, 128, 128))
CASES = {  # control points, degree, nodes a direction
    "full": [(*case, nodes) for nodes in (200, 460) for case in [(PAPER, 3), *product(CUBES, (1, 2, 3, 4, 5))]],
    "quick": [(*case, 200) for case in [(PAPER, 3), *product(CUBES, (1, 2, 3, 4, 5))]],
    "tiny": [((5, 6, 7), 3, 9), ((4, 4, 4), 1, 8)],
}
FAST_CASES = {  # of a GPU, which less does not keep busy
    "full": [*CASES["full"], (PAPER, 3, 700)],
    "quick": [(PAPER, 3, 512), (CUBES[1], 3, 512), (PAPER, 3, 700)],
}
MOST_NODES = 600  # a direction, of which peers are timed
ROUNDS = 40  # of a case and the paper's patch in turn
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
    cases = (FAST_CASES if place.fast else CASES).get(place.scale, CASES["tiny"])
    cubic: dict[int, Run] = {}  # the paper's patch by nodes a direction
    for number, (control, degree, n) in enumerate(cases):
        patch, axes, recorder = random_patch(control, degree), [np.linspace(0, 1, n)] * 3, Recorder(place.device)
        planes = patch.evaluate_grid(axes, recorder).T
        peers: dict[str, Peer] = {"scipy": partial(_scipy, patch, axes)}
        if number == 0:
            peers |= {"scipy float64": partial(_scipy_rows, patch, axes)}
            peers |= {"splipy": partial(_splipy, patch, axes)}
            peers |= {"splinepy": partial(_splinepy, patch, axes)}
        if not place.device.cores:
            peers |= gpu_peers.contractions(patch.control, _design(patch, axes))
        if n <= MOST_NODES:
            others = time_peers("evaluate", planes, ROUNDING * max(control), peers)
        else:
            others = _check_some(patch, axes, planes)
        floor = planes.nbytes / place.writing
        if control != PAPER and n in cubic:
            seconds, others["cubic 20x24x46"] = best_in_turn(recorder.replay, cubic[n], rounds=ROUNDS)
        else:
            seconds, cubic[n] = best_of(recorder.replay), recorder.replay
        size = f"degree {degree}, control {'x'.join(map(str, control))}, {n}x{n}x{n} nodes"
        yield Row("evaluate", size, place.device.name, seconds, n**3, floor / seconds, others)


def _check_some(patch: Hyperpatch, axes: list[Any], planes: NDArray[Any]) -> dict[str, float | None]:
    """Compare some planes along w with SciPy's; of peers none."""
    some = np.arange(0, len(axes[2]), 97)
    run, view = _scipy(patch, [*axes[:2], axes[2][some]])
    ours = planes.reshape(len(planes), len(axes[2]), -1)[:, some].reshape(len(planes), -1)
    check("evaluate as scipy has it", ours, view(run()).reshape(len(planes), -1), ROUNDING * max(patch.control.shape))
    return {}


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
