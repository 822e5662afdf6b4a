"""Structured meshes: which nodes an element has, without any table.

Nodes are numbered along u, then v, then w. Elements of order 2 lie on a lattice of twice the density; quad8 and hex20
have no nodes at its points with more than one odd coordinate, and what is left is numbered in the same order.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.mesh.elements import Element

Counts = tuple[int, ...]
Integers = NDArray[Any]

_CHUNK = 1 << 18
"""Elements compared at a time, which bounds the memory."""

_BLOCK = 1 << 16
"""Elements made at a time, which fit into a cache."""


def lattice_counts(element: Element, structure: Counts) -> Counts:
    """Lattice points per direction, midway ones included, of ``structure`` corner nodes per direction."""
    return tuple(element.order * (n - 1) + 1 for n in structure)


def element_counts(structure: Counts) -> Counts:
    """Elements per direction."""
    return tuple(n - 1 for n in structure)


def count_elements(structure: Counts) -> int:
    """How many elements the structure has."""
    return int(np.prod(element_counts(structure), dtype=np.int64))


def count_nodes(element: Element, structure: Counts) -> int:
    """How many nodes the structure has."""
    last = [np.array([n - 1]) for n in lattice_counts(element, structure)]
    return int(node_numbers(element, structure, last)[0]) + 1


def node_numbers(element: Element, structure: Counts, at: list[Integers]) -> Integers:
    """Node number at the lattice points ``at`` (one integer array per direction, broadcast against each other)."""
    if not element.serendipity:
        number = np.zeros((), dtype=np.int64)
        for n, index in zip(lattice_counts(element, structure)[::-1], at[::-1], strict=True):
            number = number * n + index
        return number
    (n_u, n_v), (a, b) = structure[:2], at[:2]
    c = at[2] if element.dimension == 3 else np.zeros((), dtype=np.int64)
    full_row = 2 * n_u - 1
    before_planes = (c + 1) // 2 * (n_v * full_row + (n_v - 1) * n_u) + c // 2 * (n_u * n_v)
    before_rows = np.where(c % 2 == 0, (b + 1) // 2 * full_row + b // 2 * n_u, b // 2 * n_u)
    return np.asarray(before_planes + before_rows + np.where((b % 2 == 0) & (c % 2 == 0), a, a // 2))


def has_node(element: Element, structure: Counts) -> NDArray[np.bool_] | None:
    """Which lattice points carry a node, in node order, flat; None where all of them do."""
    if not element.serendipity:
        return None
    odd = [np.arange(n) % 2 for n in lattice_counts(element, structure)]
    return np.asarray(sum(np.meshgrid(*odd, indexing="ij"))).ravel(order="F") <= 1


def cells_of(element: Element, structure: Counts, elements: Integers) -> NDArray[np.int32]:
    """Node numbers (m, k) of the given elements (m,), which are numbered along u, then v, then w."""
    corner = np.unravel_index(np.asarray(elements, dtype=np.int64), element_counts(structure), order="F")
    first = [element.order * index for index in corner]
    steps = [np.array([v[axis] * element.order // 2 for v in element.vertices]) for axis in range(element.dimension)]
    if element.serendipity:
        at = [index[:, None] + step for index, step in zip(first, steps, strict=True)]
        return node_numbers(element, structure, at).astype(np.int32)
    cells = np.empty((len(corner[0]), element.n_nodes), dtype=np.int32)
    start = node_numbers(element, structure, first).astype(np.int32)
    for vertex, step in enumerate(node_numbers(element, structure, steps).astype(np.int32)):
        np.add(start, step, out=cells[:, vertex])
    return cells


def faces_of(element: Element, structure: Counts, elements: Integers, sides: Integers) -> NDArray[np.int32]:
    """Node numbers (f, k) of sides of the given elements (f,), by their places (f,) in ``element.sides``."""
    vertices = np.array(list(element.sides.values()))
    if element.serendipity:
        return np.take_along_axis(cells_of(element, structure, elements), vertices[sides], axis=1)
    corner = np.unravel_index(elements, element_counts(structure), order="F")
    first = node_numbers(element, structure, [element.order * index for index in corner]).astype(np.int32)
    pattern = cells_of(element, structure, np.zeros(1, dtype=np.int64))[0, vertices]
    return np.asarray(np.take(pattern, sides, axis=0) + first[:, None])


def cell_blocks(element: Element, structure: Counts) -> Iterator[tuple[int, NDArray[np.int32]]]:
    """Node numbers of all elements, block after block: the number of its first element, and its cells (m, k).

    A block is some rows or some layers, and all are alike but for a number added at each vertex, which is several times
    faster than ``cells_of``. Each takes the memory of the one before it.
    """
    *along, n_last = element_counts(structure)
    layer = int(np.prod(along))
    size = layer * min(max(_BLOCK // layer, 1), n_last) if layer <= _BLOCK else along[0] * max(_BLOCK // along[0], 1)
    whole = layer * n_last if size >= layer else layer  # no block goes on over the end of this
    begins = [first for begin in range(0, layer * n_last, whole) for first in range(begin, begin + whole, size)]
    pattern = cells_of(element, structure, np.arange(size))
    steps = cells_of(element, structure, np.array(begins)) - pattern[0]
    cells = np.empty_like(pattern)
    for first, step in zip(begins, steps, strict=True):
        count = min(size, whole - first % whole)
        np.add(pattern[:count], step[0] if np.all(step == step[0]) else step, out=cells[:count])
        yield first, cells[:count]


def elements_at(structure: Counts, side: str) -> Integers:
    """Numbers of the elements along a side, by its name (``"u0"`` to ``"w1"``)."""
    counts, axis = element_counts(structure), "uvw".index(side[0])
    ranges = [np.arange(n) for n in counts]
    ranges[axis] = ranges[axis][-1:] if side[1] == "1" else ranges[axis][:1]
    mesh = np.meshgrid(*ranges, indexing="ij")
    return np.asarray(np.ravel_multi_index([m.ravel(order="F") for m in mesh], counts, order="F"))


def side_nodes(element: Element, structure: Counts, side: str) -> Integers:
    """Numbers of the nodes on a side, ascending, by its name (``"u0"`` to ``"w1"``)."""
    ranges = [np.arange(n) for n in lattice_counts(element, structure)]
    axis = "uvw".index(side[0])
    ranges[axis] = ranges[axis][-1:] if side[1] == "1" else ranges[axis][:1]
    at = list(np.meshgrid(*ranges, indexing="ij", sparse=True))
    numbers = node_numbers(element, structure, at)
    if not element.serendipity:
        return numbers.ravel(order="F")
    has_node = np.asarray(sum(index % 2 for index in at)) <= 1
    return np.asarray(numbers.T[has_node.T])


def corner_nodes(element: Element, structure: Counts) -> Integers | None:
    """Node numbers of the corner nodes in their own order; None where every node is one."""
    if element.order == 1:
        return None
    at = [2 * index for index in np.meshgrid(*(np.arange(n) for n in structure), indexing="ij", sparse=True)]
    return node_numbers(element, structure, at).ravel(order="F")


def recognise(element: Element, cells: NDArray[np.int32], n_nodes: int) -> Counts | None:
    """Structure whose implied elements are ``cells`` (m, k), one by one, and that has ``n_nodes``; None where none is.

    Along a row each element begins where the one before it ends, and so do rows along a layer: how long the first row
    and the first layer are says what the structure would be.
    """
    if not len(cells):
        return None
    row = _run(cells[:, 0], cells[:, 1])
    layer = _run(cells[::row, 0], cells[::row, 3])
    counts = (row + 1, layer + 1, len(cells) // (row * layer) + 1)[: element.dimension]
    if count_elements(counts) != len(cells) or count_nodes(element, counts) != n_nodes:
        return None
    for first in range(0, len(cells), _CHUNK):
        elements = np.arange(first, min(first + _CHUNK, len(cells)))
        if not np.array_equal(cells_of(element, counts, elements), cells[elements]):
            return None
    return counts


def _run(begins: NDArray[np.int32], ends: NDArray[np.int32]) -> int:
    """How many from the first on follow each other."""
    breaks = np.flatnonzero(begins[1:] != ends[:-1])
    return int(breaks[0]) + 1 if len(breaks) else len(begins)
