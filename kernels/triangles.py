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


@wp.func
def is_beyond(px: Any, py: Any, pz: Any, t: wp.int32, m: wp.int32, balls: wp.array(dtype=Any), best: Any):
    """Whether the ball round triangle t is farther from p than the square root of best."""
    dx = px - balls[t]
    dy = py - balls[m + t]
    dz = pz - balls[2 * m + t]
    away = wp.sqrt(best) + balls[3 * m + t]
    return dx * dx + dy * dy + dz * dz > away * away


@wp.kernel(enable_backward=False, module="unique")
def nearest(
    x: wp.array(dtype=Any),
    y: wp.array(dtype=Any),
    z: wp.array(dtype=Any),
    corners: wp.array(dtype=Any),
    balls: wp.array(dtype=Any),
    n_listed: wp.int32,
    start: wp.array(dtype=wp.int32),
    listed: wp.array(dtype=wp.int32),
    known: wp.array(dtype=wp.int32),
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

    Bins are cubes of edge ``size`` from (x0, y0, z0) on, i fastest; the triangles that pass through one are listed
    together, from start (n_i n_j n_k + 1) on: corners (9, n_listed) planes, x, y, z of each triangle's three; balls (4,
    n_listed), centre and radius, a little larger than the triangle; its number, ``listed``. known (n_i n_j n_k): where
    one is listed that counts for all points of a bin, or -1. Exact where it is no more than rings times size.
    """
    p = wp.tid() + first
    px = x[p]
    py = y[p]
    pz = z[p]
    i = wp.clamp(wp.int32(wp.floor((px - x0) / size)), 0, n_i - 1)
    j = wp.clamp(wp.int32(wp.floor((py - y0) / size)), 0, n_j - 1)
    k = wp.clamp(wp.int32(wp.floor((pz - z0) / size)), 0, n_k - 1)
    chosen = known[(k * n_j + j) * n_i + i]
    best = type(px)(-1.0)
    if chosen >= 0:
        best = triangle_squared(px, py, pz, chosen, n_listed, corners)
    ring = wp.int32(0)
    going = wp.int32(1)
    while going == 1:
        for c in range(wp.max(k - ring, 0), wp.min(k + ring, n_k - 1) + 1):
            for b in range(wp.max(j - ring, 0), wp.min(j + ring, n_j - 1) + 1):
                for a in range(wp.max(i - ring, 0), wp.min(i + ring, n_i - 1) + 1):
                    if outermost(a - i, b - j, c - k) == ring:
                        bin = (c * n_j + b) * n_i + a
                        for s in range(start[bin], start[bin + 1]):
                            if chosen < 0 or not is_beyond(px, py, pz, s, n_listed, balls, best):
                                squared = triangle_squared(px, py, pz, s, n_listed, corners)
                                if chosen < 0 or squared < best:
                                    best = squared
                                    chosen = s
        reach = type(px)(ring) * size
        ring = ring + 1
        if ring > rings or (chosen >= 0 and best <= reach * reach):
            going = 0
    distance[p] = wp.where(chosen >= 0, wp.sqrt(wp.max(best, type(px)(0.0))), type(px)(-1.0))
    triangle[p] = -1
    if chosen >= 0:
        triangle[p] = listed[chosen]
