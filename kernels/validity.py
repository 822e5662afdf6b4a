"""Bernstein coefficients of the Jacobian determinant inside hexes: samples, changes of basis, bounds.

Arrays have the element as their fastest index. Coefficients of degree n - 1 along u, v, w are (n, n, n, elements).
"""

from typing import Any

import warp as wp


@wp.kernel(enable_backward=False, module="unique")
def determinants(
    x: wp.array(dtype=Any),
    y: wp.array(dtype=Any),
    z: wp.array(dtype=Any),
    cells: wp.array(dtype=wp.int32),
    n_cells: wp.int32,
    n_nodes: wp.int32,
    gradients: wp.array(dtype=Any),
    n_samples: wp.int32,
    out: wp.array(dtype=Any),
    first: wp.int32,
):
    """Determinants (n_samples, n_cells) of hexes of n_nodes nodes; launched over both.

    gradients: (3, n_samples, n_nodes), of the shape functions along u, v, w; they add up to 0 over the nodes, so that
    coordinates may be taken from the first.
    """
    row, c = wp.tid()
    s = row + first
    k = c * n_nodes
    x0 = x[cells[k]]
    y0 = y[cells[k]]
    z0 = z[cells[k]]
    none = type(x0)(0.0)
    ux = none
    uy = none
    uz = none
    vx = none
    vy = none
    vz = none
    wx = none
    wy = none
    wz = none
    for n in range(1, n_nodes):
        node = cells[k + n]
        dx = x[node] - x0
        dy = y[node] - y0
        dz = z[node] - z0
        u = gradients[s * n_nodes + n]
        v = gradients[(n_samples + s) * n_nodes + n]
        w = gradients[(2 * n_samples + s) * n_nodes + n]
        ux = ux + u * dx
        uy = uy + u * dy
        uz = uz + u * dz
        vx = vx + v * dx
        vy = vy + v * dy
        vz = vz + v * dz
        wx = wx + w * dx
        wy = wy + w * dy
        wz = wz + w * dz
    out[s * n_cells + c] = ux * (vy * wz - vz * wy) + uy * (vz * wx - vx * wz) + uz * (vx * wy - vy * wx)


@wp.kernel(enable_backward=False, module="unique")
def along(
    values: wp.array(dtype=Any),
    length: wp.int32,
    after: wp.int32,
    matrix: wp.array(dtype=Any),
    n_rows: wp.int32,
    out: wp.array(dtype=Any),
    first: wp.int32,
):
    """Matrix (n_rows, length) times values (before, length, after) along their middle; launched over the result."""
    line, a = wp.tid()
    item = line + first
    before = item // n_rows
    row = item % n_rows
    total = type(values[0])(0.0)
    for n in range(length):
        total = total + matrix[row * length + n] * values[(before * length + n) * after + a]
    out[item * after + a] = total


@wp.kernel(enable_backward=False, module="unique")
def bounds(
    values: wp.array(dtype=Any),
    n: wp.int32,
    parts: wp.int32,
    n_cells: wp.int32,
    lower: wp.array(dtype=Any),
    upper: wp.array(dtype=Any),
    first: wp.int32,
):
    """Least coefficient, and least of the eight at the corners, which are values, of each of parts^3 blocks of n^3.

    values: (parts n, parts n, parts n, n_cells); lower, upper: (parts^3, n_cells), over which it is launched.
    """
    row, c = wp.tid()
    part = row + first
    size = parts * n
    start = ((part // (parts * parts)) * size + (part // parts) % parts) * size + part % parts
    low = values[n * start * n_cells + c]
    high = low
    for i in range(n):
        for j in range(n):
            for k in range(n):
                value = values[(n * start + (i * size + j) * size + k) * n_cells + c]
                low = wp.min(low, value)
                if (i == 0 or i == n - 1) and (j == 0 or j == n - 1) and (k == 0 or k == n - 1):
                    high = wp.min(high, value)
    lower[part * n_cells + c] = low
    upper[part * n_cells + c] = high
