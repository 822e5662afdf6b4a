"""Integrals over elements: where the quadrature points lie, nodal fields at them, and means over each element.

``nodes`` is (k, m): plane a holds the number of vertex a of each element, in VTK's order. What belongs to quadrature
points is (points, m). ``shape`` (points, k) and ``slopes`` (points, k, 3) are the shape functions and their
derivatives; the third of quads is 0.
"""

from typing import Any

import warp as wp


@wp.kernel(enable_backward=False, module="unique")
def places(
    points: wp.array(dtype=Any),
    n: wp.int32,
    nodes: wp.array(dtype=wp.int32),
    k: wp.int32,
    m: wp.int32,
    flat: wp.int32,
    shape: wp.array(dtype=Any),
    slopes: wp.array(dtype=Any),
    weights: wp.array(dtype=Any),
    n_points: wp.int32,
    x: wp.array(dtype=Any),
    y: wp.array(dtype=Any),
    z: wp.array(dtype=Any),
    volume: wp.array(dtype=Any),
    first: wp.int32,
):
    """Place of each point and the volume that it stands for, of quads (``flat`` 1) the area."""
    e = wp.tid() + first
    origin = nodes[e]
    corner = wp.vector(points[origin], points[n + origin], points[2 * n + origin])
    for g in range(n_points):
        place = corner - corner
        u = place
        v = place
        w = place
        for a in range(1, k):  # from vertex 0, so that the digits of the place are not lost in the differences
            node = nodes[a * m + e]
            edge = wp.vector(points[node], points[n + node], points[2 * n + node]) - corner
            at = g * k + a
            place = place + shape[at] * edge
            u = u + slopes[3 * at] * edge
            v = v + slopes[3 * at + 1] * edge
            w = w + slopes[3 * at + 2] * edge
        out = g * m + e
        x[out] = corner[0] + place[0]
        y[out] = corner[1] + place[1]
        z[out] = corner[2] + place[2]
        normal = wp.cross(u, v)
        volume[out] = weights[g] * wp.where(flat == 1, wp.length(normal), wp.dot(normal, w))


@wp.kernel(enable_backward=False, module="unique")
def interpolate(
    field: wp.array(dtype=Any),
    nodes: wp.array(dtype=wp.int32),
    k: wp.int32,
    m: wp.int32,
    shape: wp.array(dtype=Any),
    out: wp.array(dtype=Any),
    first: wp.int32,
):
    """A nodal field at each point, within what it is at the element's own nodes; over (points, m)."""
    tid_g, e = wp.tid()
    g = tid_g + first
    value = field[nodes[e]]
    low = value
    high = value
    total = shape[g * k] * value
    for a in range(1, k):
        value = field[nodes[a * m + e]]
        low = wp.min(low, value)
        high = wp.max(high, value)
        total = total + shape[g * k + a] * value
    out[g * m + e] = wp.clamp(total, low, high)


@wp.kernel(enable_backward=False, module="unique")
def shares(
    values: wp.array(dtype=Any),
    volume: wp.array(dtype=Any),
    shape: wp.array(dtype=Any),
    n_points: wp.int32,
    k: wp.int32,
    m: wp.int32,
    out: wp.array(dtype=Any),
    first: wp.int32,
):
    """Integral (k, m) of values (points, m) times the shape function of each vertex, over each element."""
    e = wp.tid() + first
    for a in range(k):
        total = out.dtype(0.0)
        for g in range(n_points):
            at = g * m + e
            total = total + shape[g * k + a] * wp.abs(volume[at]) * values[at]
        out[a * m + e] = total


@wp.kernel(enable_backward=False, module="unique")
def means(
    values: wp.array(dtype=Any),
    volume: wp.array(dtype=Any),
    n_points: wp.int32,
    m: wp.int32,
    out: wp.array(dtype=Any),
    first: wp.int32,
):
    """Mean (m) of values (points, m) over each element, by the size of the volume that each point stands for."""
    e = wp.tid() + first
    total = out.dtype(0.0)
    size = out.dtype(0.0)
    plain = out.dtype(0.0)
    for g in range(n_points):
        at = g * m + e
        part = wp.abs(volume[at])
        size = size + part
        total = total + part * values[at]
        plain = plain + values[at]
    out[e] = wp.where(size > out.dtype(0.0), total / size, plain / out.dtype(n_points))
