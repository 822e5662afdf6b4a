"""Linear elasticity of hex8 without structure on a CPU: K u by clusters of elements that its caches hold.

A cluster is ``size`` elements side by side in space, one after another in the table, the last of them fewer. It has
nodes of its own, copies ``of`` the mesh's, from starts[cluster] on: there it finds places and displacements near each
other, and sums what its elements give. The force on a node is the sum of its copies'. ``cells`` (8, m) are numbers
of copies, vertices as in ``trilinear.py``; all is in lanes, lane l being the element l further on.
"""

from typing import Any

import warp as wp

from gpubspline.kernels.lanes import FUSED, REGISTER_BYTES, IntLaneArray, LaneArray, fetch
from gpubspline.kernels.trilinear import WEIGHT, derivatives, no_derivatives, stressed, vertices

REGISTER = REGISTER_BYTES
AHEAD = wp.constant(256)  # what is read at random is fetched so far before it is needed


@wp.func
def lanes_of(plane: wp.array(dtype=Any), offset: wp.int32, cells: IntLaneArray, at: wp.int32, like: Any):
    """What a plane holds at one vertex of each element."""
    found = type(like)()
    copies = cells[at]
    for lane in range(len(like)):
        found[lane] = plane[offset + copies[lane]]
    return found


@wp.func
def along(
    plane: wp.array(dtype=Any),
    offset: wp.int32,
    cells: IntLaneArray,
    m: wp.int32,
    at: wp.int32,
    none: Any,
    like: Any,
):
    """Derivatives (12) of what a plane holds."""
    return derivatives(
        lanes_of(plane, offset, cells, at, like),
        lanes_of(plane, offset, cells, at + m, like),
        lanes_of(plane, offset, cells, at + 2 * m, like),
        lanes_of(plane, offset, cells, at + 3 * m, like),
        lanes_of(plane, offset, cells, at + 4 * m, like),
        lanes_of(plane, offset, cells, at + 5 * m, like),
        lanes_of(plane, offset, cells, at + 6 * m, like),
        lanes_of(plane, offset, cells, at + 7 * m, like),
        none,
    )


@wp.func
def add_lanes(given: Any, cells: IntLaneArray, at: wp.int32, offset: wp.int32, out: wp.array(dtype=Any)):
    """Add what each element gives one vertex."""
    copies = cells[at]
    for lane in range(len(given)):
        to = offset + copies[lane]
        out[to] = out[to] + given[lane]


@wp.func
def add_vertices(d: Any, cells: IntLaneArray, m: wp.int32, at: wp.int32, offset: wp.int32, out: wp.array(dtype=Any)):
    """Add what each element gives its vertices of one component."""
    f0, f1, f2, f3, f4, f5, f6, f7 = vertices(d)
    add_lanes(f0, cells, at, offset, out)
    add_lanes(f1, cells, at + m, offset, out)
    add_lanes(f2, cells, at + 2 * m, offset, out)
    add_lanes(f3, cells, at + 3 * m, offset, out)
    add_lanes(f4, cells, at + 4 * m, offset, out)
    add_lanes(f5, cells, at + 5 * m, offset, out)
    add_lanes(f6, cells, at + 6 * m, offset, out)
    add_lanes(f7, cells, at + 7 * m, offset, out)


@wp.kernel(enable_backward=False, module="unique", module_options={"max_unroll": 1, "cpu_compiler_flags": FUSED})
def cluster_forces(
    places: wp.array(dtype=Any),
    displacement: wp.array(dtype=Any),
    n: wp.int32,
    of: wp.array(dtype=wp.int32),
    starts: wp.array(dtype=wp.int32),
    count: wp.int32,
    cells: IntLaneArray,
    m: wp.int32,
    lam: LaneArray,
    mu: LaneArray,
    size: wp.int32,
    moved: wp.array(dtype=Any),
    out: wp.array(dtype=Any),
    first: wp.int32,
    lanes: wp.int32,
):
    """Forces (3, count) on the copies of nodes from their places (3, count) and the nodes' displacement (3, n).

    ``moved`` (3, count) gets copies of that. Launched over (clusters, size): the first work item of a cluster takes it
    all. m is a multiple of the lanes.
    """
    tid_cluster, item = wp.tid()
    cluster = tid_cluster + first
    if item > 0:
        return
    for i in range(starts[cluster], starts[cluster + 1]):
        node = of[i]
        for c in range(3):
            fetch(places, c * count + i + AHEAD)
            moved[c * count + i] = displacement[c * n + node]
            out[c * count + i] = out.dtype(0.0)
    weight = lam.dtype(out.dtype(WEIGHT))
    none = no_derivatives(weight)
    for e in range(cluster * size, wp.min(cluster * size + size, m), lanes):
        for g in range(8):
            fetch(lam, g * m + e + 4 * lanes)
            fetch(mu, g * m + e + 4 * lanes)
            fetch(cells, g * m + e + 8 * lanes)
        x = along(places, 0, cells, m, e, none, weight)
        y = along(places, count, cells, m, e, none, weight)
        z = along(places, 2 * count, cells, m, e, none, weight)
        hx = along(moved, 0, cells, m, e, none, weight)
        hy = along(moved, count, cells, m, e, none, weight)
        hz = along(moved, 2 * count, cells, m, e, none, weight)
        fx, fy, fz = stressed(x, y, z, hx, hy, hz, lam, mu, e, m, weight)
        add_vertices(fx, cells, m, e, 0, out)
        add_vertices(fy, cells, m, e, count, out)
        add_vertices(fz, cells, m, e, 2 * count, out)


@wp.kernel(enable_backward=False, module="unique")
def sum_copies(
    values: wp.array(dtype=Any),
    count: wp.int32,
    start: wp.array(dtype=wp.int32),
    slots: wp.array(dtype=wp.int32),
    free: wp.array(dtype=Any),
    n: wp.int32,
    out: wp.array(dtype=Any),
    first: wp.int32,
):
    """Forces (3, n) from those on copies (3, count), 0 where ``free`` (3, n) is 0.

    The copies of a node are slots[start[node] ...].
    """
    node = wp.tid() + first
    x = out.dtype(0.0)
    y = out.dtype(0.0)
    z = out.dtype(0.0)
    for s in range(start[node], start[node + 1]):
        slot = slots[s]
        x = x + values[slot]
        y = y + values[count + slot]
        z = z + values[2 * count + slot]
    out[node] = x * free[node]
    out[n + node] = y * free[n + node]
    out[2 * n + node] = z * free[2 * n + node]
