"""Distance of points from triangles, found through a grid of bins that list the triangles that pass through them.

The nearest point of a triangle lies on its plane, where the foot of the perpendicular is within the triangle, or else
on one of its edges.
"""

from typing import Any

import warp as wp

NEAR = wp.constant(2)  # rings of single bins, after which they are looked at in blocks of so many a side:
BLOCK = wp.constant(8)  # of those that are left most are farther than what is found
SLACK = wp.constant(1e-3)  # of a bin, by which boxes are larger than theirs, for what is rounded


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
def is_beyond(px: Any, py: Any, pz: Any, t: wp.int32, m: wp.int32, balls: wp.array(dtype=Any), best: Any):
    """Whether the ball round triangle t is farther from p than the square root of best."""
    dx = px - balls[t]
    dy = py - balls[m + t]
    dz = pz - balls[2 * m + t]
    away = wp.sqrt(best) + balls[3 * m + t]
    return dx * dx + dy * dy + dz * dz > away * away


@wp.func
def look_through(
    px: Any,
    py: Any,
    pz: Any,
    begin: wp.int32,
    end: wp.int32,
    corners: wp.array(dtype=Any),
    balls: wp.array(dtype=Any),
    m: wp.int32,
    best: Any,
    chosen: wp.int32,
):
    """Least squared distance, and where it is listed, once what is listed from ``begin`` to ``end`` is seen too."""
    least = type(px)(best)
    where = wp.int32(chosen)
    for s in range(begin, end):
        if where < 0 or not is_beyond(px, py, pz, s, m, balls, least):
            squared = triangle_squared(px, py, pz, s, m, corners)
            if where < 0 or squared < least:
                least = squared
                where = s
    return least, where


@wp.func
def outside(at: Any, first: Any, bin: wp.int32, count: wp.int32, size: Any):
    """By how much a coordinate is outside of ``count`` bins, or 0."""
    low = first + (type(at)(bin) - type(at)(SLACK)) * size
    high = first + (type(at)(bin + count) + type(at)(SLACK)) * size
    return wp.max(wp.max(low - at, at - high), type(at)(0.0))


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
    off_x = outside(px, x0, 0, n_i, size)
    off_y = outside(py, y0, 0, n_j, size)
    off_z = outside(pz, z0, 0, n_k, size)
    off = off_x * off_x + off_y * off_y + off_z * off_z
    edge = wp.int32(1)
    rings_here = wp.min(rings, NEAR)
    ring = wp.int32(0)
    while ring <= rings_here:
        i_here = i // edge
        j_here = j // edge
        k_here = k // edge
        for c in range(wp.max(k_here - ring, 0), wp.min(k_here + ring, (n_k - 1) // edge) + 1):
            first_k = c * edge
            count_k = wp.min(edge, n_k - first_k)
            dz = outside(pz, z0, first_k, count_k, size)
            for b in range(wp.max(j_here - ring, 0), wp.min(j_here + ring, (n_j - 1) // edge) + 1):
                first_j = b * edge
                count_j = wp.min(edge, n_j - first_j)
                dy = outside(py, y0, first_j, count_j, size)
                step = wp.int32(1)
                if wp.max(wp.abs(c - k_here), wp.abs(b - j_here)) < ring:  # its two ends alone are of the ring
                    step = 2 * ring
                for a in range(i_here - ring, wp.min(i_here + ring, (n_i - 1) // edge) + 1, step):
                    first_i = a * edge
                    count_i = wp.min(edge, n_i - first_i)
                    dx = outside(px, x0, first_i, count_i, size)
                    if a >= 0 and (chosen < 0 or dx * dx + dy * dy + dz * dz <= best):
                        for row in range(count_j * count_k):
                            bin = ((first_k + row // count_j) * n_j + first_j + row % count_j) * n_i + first_i
                            begin = start[bin]
                            end = start[bin + count_i]
                            best, chosen = look_through(px, py, pz, begin, end, corners, balls, n_listed, best, chosen)
        reach = type(px)(ring * edge) * size
        ring = ring + 1
        if chosen >= 0 and best <= off + reach * reach:
            rings_here = -1
        elif ring > rings_here and edge == 1 and rings > NEAR:
            edge = BLOCK
            rings_here = rings // edge + 1
            ring = 0
    distance[p] = wp.where(chosen >= 0, wp.sqrt(wp.max(best, type(px)(0.0))), type(px)(-1.0))
    triangle[p] = -1
    if chosen >= 0:
        triangle[p] = listed[chosen]
