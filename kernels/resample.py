"""Trilinear sampling of a volume at points in patient millimetres, or of bricks of a lattice."""

from typing import Any

import warp as wp

from gpubspline.kernels.lanes import element, set_element

TILE = wp.constant(256)  # of a GPU: points that a group of threads takes at once
AHEAD = wp.constant(64)  # points whose samples are asked for before they are read: waiting for them is most of the time


@wp.func_native("""
#if !defined(__CUDA_ARCH__)
    __builtin_prefetch(values.data + at);
#endif
""")
def fetch(values: wp.array(dtype=Any), at: wp.int32):
    """Begin to bring a number to the caches of a CPU; what a GPU waits for, its other threads hide."""
    ...


@wp.func
def grid_line(t: Any, size: wp.int32):
    """The lower of the two samples round index t, and the share of the upper one."""
    inside = wp.clamp(t, type(t)(0.0), type(t)(size - 1))
    low = wp.min(wp.int32(inside), wp.max(size - 2, 0))
    return low, inside - type(t)(low)


@wp.func
def beyond(t: Any, size: wp.int32):
    """Whether index t lies more than half a voxel outside the outermost centres."""
    return t < type(t)(-0.5) or t > type(t)(size) - type(t)(0.5)


@wp.func
def between(low: Any, high: Any, share: Any):
    """As OpenCL's mix rounds, which ``wp.lerp`` does not."""
    return low + (high - low) * share


@wp.func
def bilinear(
    volume: wp.array(dtype=Any), corner: wp.int32, step_i: wp.int32, step_j: wp.int32, share_i: Any, share_j: Any
):
    low = between(element(volume, corner), element(volume, corner + step_i), share_i)
    high = between(element(volume, corner + step_j), element(volume, corner + step_j + step_i), share_i)
    return between(low, high, share_j)


@wp.func
def find_place(n_i: wp.int32, n_j: wp.int32, n_k: wp.int32, t_i: Any, t_j: Any, t_k: Any):
    """The lowest of the eight samples round a place, and the shares of the upper ones."""
    i, share_i = grid_line(t_i, n_i)
    j, share_j = grid_line(t_j, n_j)
    k, share_k = grid_line(t_k, n_k)
    return i + n_i * (j + n_j * k), share_i, share_j, share_k


@wp.func
def fetch_samples(
    volume: wp.array(dtype=Any), n_i: wp.int32, n_j: wp.int32, n_k: wp.int32, t_i: Any, t_j: Any, t_k: Any
):
    corner, _i, _j, _k = find_place(n_i, n_j, n_k, t_i, t_j, t_k)
    fetch(volume, corner)
    fetch(volume, corner + n_i)
    fetch(volume, corner + n_i * n_j)
    fetch(volume, corner + n_i * n_j + n_i)


@wp.func
def interpolated(
    volume: wp.array(dtype=Any), n_i: wp.int32, n_j: wp.int32, n_k: wp.int32, t_i: Any, t_j: Any, t_k: Any
):
    corner, share_i, share_j, share_k = find_place(n_i, n_j, n_k, t_i, t_j, t_k)
    step_i = wp.where(n_i > 1, 1, 0)
    step_j = wp.where(n_j > 1, n_i, 0)
    step_k = wp.where(n_k > 1, n_i * n_j, 0)
    near = bilinear(volume, corner, step_i, step_j, share_i, share_j)
    far = bilinear(volume, corner + step_k, step_i, step_j, share_i, share_j)
    return between(near, far, share_k)


@wp.func
def indices_of(
    to_index: wp.array(dtype=Any),
    x: wp.array(dtype=Any),
    y: wp.array(dtype=Any),
    z: wp.array(dtype=Any),
    p: wp.int32,
):
    x_p = element(x, p)
    y_p = element(y, p)
    z_p = element(z, p)
    t_i = element(to_index, 0) * x_p + element(to_index, 1) * y_p + element(to_index, 2) * z_p + element(to_index, 3)
    t_j = element(to_index, 4) * x_p + element(to_index, 5) * y_p + element(to_index, 6) * z_p + element(to_index, 7)
    t_k = element(to_index, 8) * x_p + element(to_index, 9) * y_p + element(to_index, 10) * z_p + element(to_index, 11)
    return t_i, t_j, t_k


@wp.kernel(enable_backward=False, module="unique")
def trilinear(
    volume: wp.array(dtype=Any),
    n_i: wp.int32,
    n_j: wp.int32,
    n_k: wp.int32,
    to_index: wp.array(dtype=Any),
    x: wp.array(dtype=Any),
    y: wp.array(dtype=Any),
    z: wp.array(dtype=Any),
    outside: Any,
    clamp_outside: wp.int32,
    run: wp.int32,
    n_points: wp.int32,
    out: wp.array(dtype=Any),
    first: wp.int32,
):
    """to_index: row-major 3x4 map from millimetres to the index (i, j, k).

    A work item takes ``run`` points, TILE apart; on a CPU 1.

    Up to half a voxel beyond the outermost centres the border voxel's value goes on; farther out it does so where
    ``clamp_outside`` is 1, and is ``outside`` where it is 0.
    """
    item = wp.tid() + first
    p = item // TILE * (TILE * run) + item % TILE
    end = wp.min(p + TILE * run, n_points)
    while p < end:
        l_i, l_j, l_k = indices_of(to_index, x, y, z, wp.min(p + AHEAD, n_points - 1))
        fetch_samples(volume, n_i, n_j, n_k, l_i, l_j, l_k)
        t_i, t_j, t_k = indices_of(to_index, x, y, z, p)
        value = interpolated(volume, n_i, n_j, n_k, t_i, t_j, t_k)
        if clamp_outside == 0 and (beyond(t_i, n_i) or beyond(t_j, n_j) or beyond(t_k, n_k)):
            value = outside
        set_element(out, p, value)
        p = p + TILE


@wp.func
def out_of(t: Any, size: wp.int32, gap: Any):
    """How far index t lies outside the outermost centres, ``gap`` apart, negative inside."""
    return gap * wp.max(-t, t - type(t)(size - 1))


@wp.kernel(enable_backward=False, module="unique")
def bricks(
    volume: wp.array(dtype=Any),
    n_i: wp.int32,
    n_j: wp.int32,
    n_k: wp.int32,
    to_index: wp.array(dtype=Any),
    gap: wp.array(dtype=Any),
    corners: wp.array(dtype=wp.int32),
    edge: wp.int32,
    out: wp.array(dtype=Any),
    first: wp.int32,
):
    """A distance at the samples of bricks of a lattice, launched over their rows and ``edge``.

    The border's value goes on outside, but no less than the distance from the planes of the outermost voxel centres,
    ``gap`` (3) apart along each axis. to_index maps indices of the lattice to those of the volume; ``corners`` (bricks,
    3) are the indices i, j, k of the first sample of each.
    """
    tid_row, i = wp.tid()
    row = tid_row + first
    brick = row // (edge * edge)
    x = volume.dtype(i + corners[3 * brick])
    y = volume.dtype(row % edge + corners[3 * brick + 1])
    z = volume.dtype(row // edge % edge + corners[3 * brick + 2])
    t_i = to_index[0] * x + (to_index[1] * y + to_index[2] * z + to_index[3])
    t_j = to_index[4] * x + (to_index[5] * y + to_index[6] * z + to_index[7])
    t_k = to_index[8] * x + (to_index[9] * y + to_index[10] * z + to_index[11])
    off = wp.max(wp.max(out_of(t_i, n_i, gap[0]), out_of(t_j, n_j, gap[1])), out_of(t_k, n_k, gap[2]))
    at = wp.int64(row) * wp.int64(edge) + wp.int64(i)
    out[at] = wp.max(interpolated(volume, n_i, n_j, n_k, t_i, t_j, t_k), off)
