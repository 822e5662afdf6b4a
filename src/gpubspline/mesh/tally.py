"""What is counted of a mesh: as a whole, or added up over its parts where the whole is never held."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpubspline.mesh.distance import SurfaceDistance, summarise_distances
from gpubspline.mesh.mesh import Mesh
from gpubspline.mesh.quality import Quality, merge
from gpubspline.mesh.validity import Certificate

Floats = NDArray[np.float64]

_OF_ELEMENTS = ("density_g_cm3", "E_MPa", "nu")
"""Fields that are counted of elements where nodes do not have them."""


@dataclass(frozen=True)
class Spread:
    """Least, greatest and sum of some values, and their number."""

    min: float
    max: float
    total: float
    count: int

    @property
    def mean(self) -> float:
        """Mean of the values."""
        return self.total / self.count


@dataclass(frozen=True, eq=False)
class Tally:
    """Counts and figures of a mesh.

    Attributes
    ----------
    element_type: of all elements.
    n_nodes, n_elements: numbers.
    size: volume of hexes, mm3; area of quads, mm2.
    spreads: of nodal fields, by name, and of the material of elements where nodes have none.
    quality: of the elements.
    out_of_range: nodes whose HU no range of the law covers, or None where there is no law.
    distances: distances (s,), mm, from the surface to the region's, and the weight (s,) of each; or None.
    certificate: of the hexes' validity; None of quads, and where it was not asked for.
    """

    element_type: str
    n_nodes: int
    n_elements: int
    size: float
    spreads: dict[str, Spread]
    quality: Quality
    out_of_range: int | None = None
    distances: tuple[Floats, Floats] | None = None
    certificate: Certificate | None = None

    @property
    def surface_distance(self) -> SurfaceDistance | None:
        """Summary of the distances."""
        return None if self.distances is None else summarise_distances(*self.distances)


def tally(
    mesh: Mesh,
    quality: Quality,
    *,
    own_nodes: slice = slice(None),
    out_of_range: int | None = None,
    distances: tuple[Floats, Floats] | None = None,
    certificate: Certificate | None = None,
) -> Tally:
    """Count a mesh, or a part of one of whose nodes ``own_nodes`` are counted with it."""
    own = {name: values[own_nodes] for name, values in mesh.fields.items()}
    own = {name: mesh.cell_fields[name] for name in _OF_ELEMENTS if name in mesh.cell_fields} | own
    spreads = {
        name: Spread(float(values.min()), float(values.max()), float(values.sum(dtype=np.float64)), values.size)
        for name, values in own.items()
    }
    size = mesh.volume_mm3 if mesh.element.dimension == 3 else mesh.area_mm2
    n_nodes = len(range(*own_nodes.indices(mesh.n_nodes)))
    counted = (mesh.element_type, n_nodes, mesh.n_elements, size, spreads, quality, out_of_range, distances)
    return Tally(*counted, certificate)


def add(parts: Sequence[Tally]) -> Tally:
    """Tally of a mesh from those of its parts, in the order of their elements."""
    spreads = {name: _joined([part.spreads[name] for part in parts]) for name in parts[0].spreads}
    outside = [part.out_of_range for part in parts if part.out_of_range is not None]
    known = [part.distances for part in parts if part.distances is not None]
    return Tally(
        parts[0].element_type,
        sum(part.n_nodes for part in parts),
        sum(part.n_elements for part in parts),
        sum(part.size for part in parts),
        spreads,
        merge([part.quality for part in parts]),
        sum(outside) if outside else None,
        (np.concatenate([d for d, _ in known]), np.concatenate([w for _, w in known])) if known else None,
    )


def _joined(spreads: Sequence[Spread]) -> Spread:
    low, high = min(spread.min for spread in spreads), max(spread.max for spread in spreads)
    return Spread(low, high, sum(spread.total for spread in spreads), sum(spread.count for spread in spreads))
