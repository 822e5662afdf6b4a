"""Sets and surfaces as arrays by name, for formats that have arrays but no sets: VTK's field data.

``node_set NAME`` holds node numbers, ``element_set NAME`` element numbers, ``surface NAME`` rows of an element number
and a side, 0 to 5 for u0, u1, v0, v1, w0, w1; all from 0, as VTK counts.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.export.deck import Deck

NODES, ELEMENTS, SURFACE = "node_set ", "element_set ", "surface "

Arrays = dict[str, NDArray[np.int32]]


def set_arrays(deck: Deck) -> Arrays:
    """Arrays of the sets of a deck, but for the one of all elements."""
    arrays = {f"{NODES}{name}": np.asarray(members) for name, members in deck.node_sets.items()}
    arrays |= {f"{ELEMENTS}{name}": np.asarray(members) for name, members in deck.element_sets.items()}
    for name, faces in deck.surfaces.items():
        rows = [faces.elements, faces.sides]
        arrays[f"{SURFACE}{name}"] = np.stack(rows, axis=1, dtype=np.int32, casting="same_kind")
    return {name: np.ascontiguousarray(values, dtype=np.int32) for name, values in arrays.items()}


def sets_of(arrays: Mapping[str, NDArray[Any]]) -> tuple[Arrays, Arrays]:
    """Node and element sets among the arrays of a file."""
    found: tuple[Arrays, Arrays] = ({}, {})
    for kind, sets in zip((NODES, ELEMENTS), found, strict=True):
        for name, values in arrays.items():
            if name.startswith(kind):
                sets[name.removeprefix(kind)] = np.asarray(values, dtype=np.int32).ravel()
    return found


def set_flags(deck: Deck) -> tuple[Arrays, Arrays]:
    """Node and element sets of a deck as fields of 0 and 1, for formats that have fields only."""
    found: tuple[Arrays, Arrays] = ({}, {})
    sets = (NODES, deck.node_sets, deck.mesh.n_nodes), (ELEMENTS, deck.element_sets, deck.mesh.n_elements)
    for into, (kind, named, count) in zip(found, sets, strict=True):
        for name, members in named.items():
            into[f"{kind}{name}"] = np.zeros(count, dtype=np.int32)
            into[f"{kind}{name}"][members] = 1
    return found


def from_flags(kind: str, fields: Mapping[str, NDArray[Any]]) -> Arrays:
    """Sets of a kind among fields, which ``set_flags`` made."""
    named = {name: np.flatnonzero(values) for name, values in fields.items() if name.startswith(kind)}
    return {name.removeprefix(kind): members.astype(np.int32) for name, members in named.items()}
