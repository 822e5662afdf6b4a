"""Distance of points from triangles, found through a grid of bins that list the triangles that pass through them.

The nearest point of a triangle lies on its plane, where the foot of the perpendicular is within the triangle, or else
on one of its edges.
"""

from typing import Any

import warp as wp


@wp.func
def segment_squared(px: Any, py: Any, pz: Any, ex: Any, ey: Any, ez: Any):
    """Squared distance of p from the segment from the origin to e, which may have no length."""
    none = type(px)(0.0)
    length = ex * ex + ey * ey + ez * ez
    along = px * ex + py * ey + pz * ez
    share = wp.where(length > none, wp.clamp(along / length, none, type(px)(1.0)), none)
    dx = px - share * ex
    dy = py - share * ey
    dz = pz - share * ez
    return dx * dx + dy * dy + dz * dz


@wp.func
def leftward(px: Any, py: Any, pz: Any, ex: Any, ey: Any, ez: Any, nx: Any, ny: Any, nz: Any):
    """Positive where p is on the inner side of the edge e of a triangle with the normal n."""
    return px * (ny * ez - nz * ey) + py * (nz * ex - nx * ez) + pz * (nx * ey - ny * ex)


@wp.func
def triangle_squared(px: Any, py: Any, pz: Any, t: wp.int32, m: wp.int32, corners: wp.array(dtype=Any)):
    """Squared distance of p from triangle t."""
    ax = px - corners[t]
    ay = py - corners[m + t]
    az = pz - corners[2 * m + t]
    bx = px - corners[3 * m + t]
    by = py - corners[4 * m + t]
    bz = pz - corners[5 * m + t]
    cx = px - corners[6 * m + t]
    cy = py - corners[7 * m + t]
    cz = pz - corners[8 * m + t]
    ux = ax - bx
    uy = ay - by
    uz = az - bz
    vx = bx - cx
    vy = by - cy
    vz = bz - cz
    wx = cx - ax
    wy = cy - ay
    wz = cz - az
    nx = uy * vz - uz * vy
    ny = uz * vx - ux * vz
    nz = ux * vy - uy * vx
    square = nx * nx + ny * ny + nz * nz
    height = ax * nx + ay * ny + az * nz
    none = type(px)(0.0)
    first = leftward(ax, ay, az, ux, uy, uz, nx, ny, nz)
    second = leftward(bx, by, bz, vx, vy, vz, nx, ny, nz)
    third = leftward(cx, cy, cz, wx, wy, wz, nx, ny, nz)
    edges = wp.min(
        segment_squared(ax, ay, az, ux, uy, uz),
        wp.min(segment_squared(bx, by, bz, vx, vy, vz), segment_squared(cx, cy, cz, wx, wy, wz)),
    )
    above = square > none and first >= none and second >= none and third >= none
    return wp.where(above, height / wp.where(square > none, square, type(px)(1.0)) * height, edges)


@wp.func
def outermost(a: wp.int32, b: wp.int32, c: wp.int32):
    return wp.max(wp.abs(a), wp.max(wp.abs(b), wp.abs(c)))


@wp.kernel(enable_backward=False, module="unique")
def nearest(
    x: wp.array(dtype=Any),
    y: wp.array(dtype=Any),
    z: wp.array(dtype=Any),
    corners: wp.array(dtype=Any),
    n_triangles: wp.int32,
    start: wp.array(dtype=wp.int32),
    listed: wp.array(dtype=wp.int32),
    n_i: wp.int32,
    n_j: wp.int32,
    n_k: wp.int32,
    x0: Any,
    y0: Any,
    z0: Any,
    size: Any,
    rings: wp.int32,
    n_points: wp.int32,
    distance: wp.array(dtype=Any),
    triangle: wp.array(dtype=wp.int32),
    first: wp.int32,
):
    """Distance from the nearest triangle and its number; -1 and -1 where none is listed within ``rings`` bins.

    corners: (9, n_triangles) planes, x, y, z of each triangle's three. start (n_i n_j n_k + 1): where a bin's triangles
    begin in ``listed``; bins are cubes of edge ``size`` from (x0, y0, z0) on, i fastest. Exact where it is no more than
    rings times size.
    """
    p = wp.tid() + first
    px = x[p]
    py = y[p]
    pz = z[p]
    i = wp.clamp(wp.int32(wp.floor((px - x0) / size)), 0, n_i - 1)
    j = wp.clamp(wp.int32(wp.floor((py - y0) / size)), 0, n_j - 1)
    k = wp.clamp(wp.int32(wp.floor((pz - z0) / size)), 0, n_k - 1)
    best = type(px)(-1.0)
    chosen = wp.int32(-1)
    ring = wp.int32(0)
    going = wp.int32(1)
    while going == 1:
        for c in range(wp.max(k - ring, 0), wp.min(k + ring, n_k - 1) + 1):
            for b in range(wp.max(j - ring, 0), wp.min(j + ring, n_j - 1) + 1):
                for a in range(wp.max(i - ring, 0), wp.min(i + ring, n_i - 1) + 1):
                    if outermost(a - i, b - j, c - k) == ring:
                        bin = (c * n_j + b) * n_i + a
                        for s in range(start[bin], start[bin + 1]):
                            squared = triangle_squared(px, py, pz, listed[s], n_triangles, corners)
                            if chosen < 0 or squared < best:
                                best = squared
                                chosen = listed[s]
        reach = type(px)(ring) * size
        ring = ring + 1
        if ring > rings or (chosen >= 0 and best <= reach * reach):
            going = 0
    distance[p] = wp.where(chosen >= 0, wp.sqrt(wp.max(best, type(px)(0.0))), type(px)(-1.0))
    triangle[p] = chosen


@wp.kernel(enable_backward=False, module="unique")
def given(
    x: wp.array(dtype=Any),
    y: wp.array(dtype=Any),
    z: wp.array(dtype=Any),
    corners: wp.array(dtype=Any),
    n_triangles: wp.int32,
    triangle: wp.array(dtype=wp.int32),
    n_points: wp.int32,
    distance: wp.array(dtype=Any),
    first: wp.int32,
):
    """Distance of each point from the triangle given for it."""
    p = wp.tid() + first
    distance[p] = wp.sqrt(triangle_squared(x[p], y[p], z[p], triangle[p], n_triangles, corners))
