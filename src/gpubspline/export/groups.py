"""Overlapping sets as disjoint families, each in some of the sets: what MED and Gmsh keep instead of lists."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.export.deck_loads import Faces

_MOST_BITS = 60


@dataclass(frozen=True, eq=False)
class Families:
    """Items by the sets they are in.

    Attributes
    ----------
    of: (n,) family of each item.
    names: of each family, the names of the sets that it is in; none for items in no set.
    """

    of: NDArray[np.int64]
    names: list[tuple[str, ...]]


def families(count: int, sets: Mapping[str, NDArray[Any]]) -> Families:
    """Part ``count`` items by the sets of item numbers that they are in."""
    code, used = np.zeros(count, dtype=np.int64), 0
    for members in sets.values():
        if used == _MOST_BITS:
            code, used = np.unique(code, return_inverse=True)[1].ravel(), int(count).bit_length()
        code *= 2
        code[members] += 1
        used += 1
    _, first, of = np.unique(code, return_index=True, return_inverse=True)
    names: list[list[str]] = [[] for _ in first]
    for name, members in sets.items():
        among = np.zeros(count, dtype=np.bool_)
        among[members] = True
        for family in np.flatnonzero(among[first]):
            names[family].append(name)
    return Families(of.ravel().astype(np.int64), [tuple(each) for each in names])


@dataclass(frozen=True, eq=False)
class Facets:
    """The faces of all surfaces, each once, and the families they are in; elements and nodes as in ``Faces``."""

    elements: NDArray[np.int64]
    nodes: NDArray[np.int32]
    families: Families


def facets(surfaces: Mapping[str, Faces]) -> Facets | None:
    """Join surfaces that overlap; None where there are none."""
    if not surfaces:
        return None
    places = np.concatenate([8 * faces.elements + faces.sides for faces in surfaces.values()])
    _, first, which = np.unique(places, return_index=True, return_inverse=True)
    nodes = np.concatenate([faces.nodes for faces in surfaces.values()])[first]
    ends = np.cumsum([0, *(len(faces.elements) for faces in surfaces.values())])
    own = {name: which.ravel()[a:b] for name, a, b in zip(surfaces, ends[:-1], ends[1:], strict=True)}
    elements = np.concatenate([faces.elements for faces in surfaces.values()])[first]
    return Facets(elements, nodes, families(len(first), own))
