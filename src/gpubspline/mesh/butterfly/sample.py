"""Five matched hyperpatches sampled to one conforming hex mesh of any density in each direction."""

from math import log, pi

import numpy as np
from numpy.typing import NDArray

from gpubspline.device import Device
from gpubspline.errors import InputError
from gpubspline.mesh.butterfly.contours import signed_area
from gpubspline.mesh.butterfly.patches import Butterfly
from gpubspline.mesh.butterfly.placement import Layout
from gpubspline.mesh.elements import Element, find_element
from gpubspline.mesh.mesh import Mesh
from gpubspline.mesh.sample import check_size

Counts = tuple[int, int, int, int]
_BY_ORDER = {1: "hex8", 2: "hex20"}

SQUARE = 2 * log(2) / pi
"""Rings of elements for each element along the square's side at which elements are as long as wide: the contour is then
twice the square, and rings that grow in proportion to their size grow by 2 in that many."""


def sample_butterfly(
    made: Butterfly,
    nodes: Counts | None = None,
    *,
    order: int = 1,
    element_type: str | None = None,
    device: Device,
) -> Mesh:
    """Sample the patches at evenly spaced parameters.

    Arguments
    ---------
    nodes: samples (u, v, r, w): along the square's two sides, from the square to the surface, along the axis; as many
        as control points where not given.
    order: 1 for hex8, 2 for hex20.
    element_type: instead of ``order``, ``"hex27"`` for instance.

    Returns
    -------
    Mesh with explicit cells; HU at nodes where there was a CT; node sets ``w0`` and ``w1`` (the two ends), ``side``
    (what is between them) and ``surface``; element sets ``body`` and the blocks ``centre``, ``v0``, ``u1``, ``v1``,
    ``u0``.

    Raises
    ------
    InputError where the counts or the element type do not fit, or the mesh does not fit the memory.
    """
    element = _element(order, element_type)
    nodes = made.shape if nodes is None else nodes
    if len(nodes) != 4 or min(nodes) < 2:
        raise InputError(f"expected 4 node counts U,V,R,W of at least 2 for a butterfly, got {nodes}")
    layout, n_w, count = _lattice(element, nodes)
    check_size(count * n_w)
    values = np.empty((count * n_w, 4), dtype=device.real)
    cells, blocks = [], {}
    for name, numbers in layout.blocks.items():
        every = numbers[:, :, None] + count * np.arange(n_w)
        at = [np.linspace(0, 1, n) for n in every.shape]
        values[every] = made.patches[name].evaluate_grid(at, device)
        cells.append(_cells(element, every))
        first = sum(map(len, cells[:-1]))
        blocks[name] = np.arange(first, first + len(cells[-1]), dtype=np.int32)
    levels = count * np.arange(n_w)
    ends = {"w0": np.arange(count), "w1": np.arange(count) + levels[-1]}
    sides = {**ends, "side": (layout.ring[:, -1:] + levels).ravel()}
    return _mesh(element, values, np.concatenate(cells), sides, blocks, made.has_hu)


def _element(order: int, element_type: str | None) -> Element:
    if element_type is None and order not in _BY_ORDER:
        raise InputError(f"expected elements of order 1 or 2, got {order}")
    element = find_element(_BY_ORDER[order] if element_type is None else element_type)
    if element.dimension != 3:
        raise InputError(f"expected hexes for a butterfly, got {element_type}")
    return element


def _lattice(element: Element, nodes: Counts) -> tuple[Layout, int, int]:
    """Layout of a section's lattice, lattice points along the axis and in a section."""
    u, v, r, w = (element.order * (n - 1) + 1 for n in nodes)
    layout = Layout(u, v, r)
    return layout, w, layout.count


def _cells(element: Element, numbers: NDArray[np.int64]) -> NDArray[np.int64]:
    """(m, k) lattice numbers of the elements of a block of lattice points (a, b, c)."""
    columns = []
    for vertex in element.vertices:
        start = [at * element.order // 2 for at in vertex]
        picked = tuple(
            slice(s, s + n - element.order, element.order) for s, n in zip(start, numbers.shape, strict=True)
        )
        columns.append(numbers[picked].ravel(order="F"))
    return np.stack(columns, axis=1)


def _mesh(
    element: Element,
    values: NDArray[np.floating],
    cells: NDArray[np.int64],
    sides: dict[str, NDArray[np.int64]],
    blocks: dict[str, NDArray[np.int32]],
    has_hu: bool,
) -> Mesh:
    """Drop lattice points that no element has, and name the sets."""
    number = np.full(len(values), -1, dtype=np.int32)
    used = np.unique(cells) if element.serendipity else np.arange(len(values))
    number[used] = np.arange(len(used), dtype=np.int32)
    sets = {name: np.sort(found[found >= 0]) for name, found in ((name, number[at]) for name, at in sides.items())}
    sets["surface"] = np.unique(np.concatenate(list(sets.values())))
    fields = {"HU": np.ascontiguousarray(values[used, 3])} if has_hu else {}
    body = {"body": np.arange(len(cells), dtype=np.int32)}
    return Mesh(
        values[used, :3],
        element.name,
        connectivity=number[cells],
        fields=fields,
        node_sets=sets,
        element_sets={**body, **blocks},
    )


def nodes_for(made: Butterfly, size_mm: float | None = None, elements: int | None = None) -> Counts:
    """Samples (u, v, r, w) for elements of a size, or for a number of elements, within what whole counts allow.

    Raises
    ------
    InputError where neither or both are given, or one is not positive.
    """
    if (size_mm is None) == (elements is None):
        raise InputError("expected an element size or a number of elements")
    wanted = size_mm if elements is None else elements
    if wanted is None or not (np.isfinite(wanted) and wanted > 0):
        raise InputError(f"expected a size or a number of elements above 0, got {wanted}")
    area, length = _area_and_length(made)
    size = float(np.cbrt(area * length / elements)) if elements is not None else float(wanted)
    side = max(1, round(float(np.sqrt(area / (1 + 4 * SQUARE))) / size))
    if elements is None:
        return _nodes(side, length / size)
    tried = [_nodes(n, elements / count_hexes(_nodes(n, 1))) for n in (side - 1, side, side + 1) if n >= 1]
    return min(tried, key=lambda nodes: abs(count_hexes(nodes) - elements))


def count_hexes(nodes: Counts) -> int:
    """Elements of a mesh of samples (u, v, r, w)."""
    u, v, r, w = (n - 1 for n in nodes)
    return (u * v + 2 * (u + v) * r) * w


def _nodes(side: int, along: float) -> Counts:
    """Samples for so many elements along the square's side and along the axis."""
    return side + 1, side + 1, max(1, round(SQUARE * side)) + 1, max(1, round(along)) + 1


def _area_and_length(made: Butterfly) -> tuple[float, float]:
    """Mean area of the sections, mm2, and the distance between the first and the last, mm."""
    sections = made.sections
    area = float(np.mean([signed_area(loop) for loop in sections.loops]))
    step = np.cross(*sections.frame) @ sections.stack.affine[:3, 2]
    return area, float(abs(step) * (sections.w[-1] - sections.w[0]))
