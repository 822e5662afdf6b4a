"""Trilinear sampling of a CT at points in millimetres.

Floors, a point: 3 coordinates read and one value written, 16 bytes; besides, each of the 4 cache lines that hold its 8
voxels, once for all the points near by where points come in the order of a mesh, for each point where they come in
none: a gather is held against ``moving`` by its 16 bytes alone, on a GPU in no order against four gathers (see
``bench_bandwidth``). Operations: 18 for the index, 9 for the place in the
voxel, 14 for the 7 mixes, about 45 with the limits.

Neither bounds it on a CPU, but the wait for voxels that are in no near cache: asked for some vectors of points ahead,
for which the index is worked out twice, they come in 0.5 times the time in the order of a mesh, 0.4 times in none.

On a GPU ``CuPy`` is its ``map_coordinates`` and ``PyTorch`` its ``grid_sample``; both are given indices, not
millimetres.
"""

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.bench import gpu_peers
from gpubspline.bench.measure import Peer, Place, Row, best_of, check, time_beside
from gpubspline.bench.recorder import Recorder
from gpubspline.ct.region import Region
from gpubspline.mesh.distance import sample_distance

SIZES = {  # voxels (k, j, i), points (w, v, u)
    "full": ((200, 512, 512), (250, 200, 200)),
    "quick": ((200, 512, 512), (250, 200, 200)),
    "tiny": ((6, 7, 8), (5, 6, 7)),
}
FAST_POINTS = (500, 500, 400)
BYTES = 16
ROWS = 4  # of voxels side by side that a point reads two of


def _region(shape: tuple[int, ...]) -> Region:
    """Noise on a grid turned by 0.2 about z, with voxels of 0.7 x 0.7 x 1.25 mm."""
    distance = np.random.default_rng(5).standard_normal(shape, dtype=np.float32)
    turn, affine = np.array([[np.cos(0.2), -np.sin(0.2)], [np.sin(0.2), np.cos(0.2)]]), np.diag([0.7, 0.7, 1.25, 1.0])
    affine[:2, :2] = turn * 0.7
    return Region(distance < 0, distance, affine)


def _indices(voxels: tuple[int, ...], points: tuple[int, ...]) -> NDArray[np.float32]:
    """(n, 3) indices (k, j, i) in the order of a mesh, spread over the volume, each moved by up to half its cell."""
    rng, step = np.random.default_rng(6), (np.array(voxels) - 1) / np.array(points)
    cells = np.indices(points).reshape(3, -1).T + rng.random((int(np.prod(points)), 3))
    return np.asarray(cells * step, dtype=np.float32)


def grid_and_points(
    voxels: tuple[int, ...], points: tuple[int, ...], order: NDArray[Any] | None = None
) -> tuple[Region, NDArray[np.float32], NDArray[Any]]:
    """A distance on a grid, and where it is asked for: indices (n, 3) and places (n, 3), mm."""
    region, indices = _region(voxels), _indices(voxels, points)
    indices = indices if order is None else indices[order]
    return region, indices, indices[:, ::-1] @ region.affine[:3, :3].T + region.affine[:3, 3]


def rows(place: Place) -> Iterator[Row]:
    """Time points in the order of a mesh, and the same in none."""
    voxels, few = SIZES[place.scale]
    sizes = [few, FAST_POINTS] if place.fast and place.scale != "tiny" else [few]
    for points in sizes:
        shuffled = np.random.default_rng(7).permutation(int(np.prod(points)))
        for words, order in (("mesh order", None), ("random order", shuffled)):
            recorder, (region, indices, at) = Recorder(place.device), grid_and_points(voxels, points, order)
            values = sample_distance(region, at, recorder)
            if points == few:
                peers: dict[str, Peer] = {"scipy.ndimage": partial(_scipy, region, indices)}
                if not place.device.cores:
                    peers |= gpu_peers.samples(region.distance_mm, indices)
                seconds, others = time_beside("resample", recorder.replay, values, 2e-4, peers)
            else:
                run, view = _scipy(region, indices[::97])
                check("resample", values[::97], view(run()), 2e-4)
                seconds, others = best_of(recorder.replay), {}
            gathered = order is not None and place.gathers
            floor = ROWS * len(at) / place.gathers if gathered else BYTES * len(at) / place.moving
            size = f"{len(at):,} points in {words}, {'x'.join(map(str, voxels[::-1]))} voxels"
            yield Row("resample", size, place.device.name, seconds, len(at), floor / seconds, others)


def _scipy(region: Region, indices: NDArray[np.float32]) -> tuple[Any, Any]:
    from scipy import ndimage

    at = np.ascontiguousarray(indices.T)
    return lambda: ndimage.map_coordinates(region.distance_mm, at, np.float32, order=1, mode="nearest"), lambda v: v
