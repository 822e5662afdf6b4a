"""Stress of a solved mesh: at its nodes for pictures, and the figures that are compared.

At each node stress is the mean of what its elements extrapolate to it, weighted by their volumes. An element
extrapolates by the trilinear function nearest to its Gauss values: through all 8 of hex8, by least squares to the 27 of
hex20 (Hinton and Campbell 1974). Von Mises stress and principal values at nodes are those of that mean. The figures are
from the Gauss points, where nothing is extrapolated.

The greatest stress at a point is no figure to compare meshes by. At the rim of a support or of a force it grows without
end as elements shrink; elsewhere it follows the modulus, which in CT varies within an element as much as from one to
the next, so that it wanders by a few per cent with where the Gauss points happen to lie. In bone, stress is a mean over
a few trabeculae in any case, a few mm (Harrigan et al., J. Biomechanics 21, 1988). A load case therefore may say over
what radius stress is averaged before its maximum is taken, ``averaged_mm``; that maximum converges.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from gpubspline.analysis.gauss import COMPONENTS, GaussStress, check_options, gauss_stress, principal, von_mises
from gpubspline.analysis.local_mean import LocalMean, local_mean
from gpubspline.errors import InputError
from gpubspline.mesh.elements import ELEMENTS, Element
from gpubspline.mesh.mesh import Mesh
from gpubspline.shown import brief

Floats = NDArray[np.float64]

MAXIMUM_MEAN = (
    "greatest mean of the von Mises stress, by volume, over balls of {radius:.3g} mm about nodes further than "
    "{away:.3g} mm from those that are held or carry a force, balls with less than {filled:.0f} % in the body left out"
)
"""What ``max_von_mises_mpa`` is where the load case says what stress is averaged over."""

MAXIMUM = (
    "greatest von Mises stress at the Gauss points of the elements with no node within {away:.3g} mm of a node that is "
    "held or carries a force"
)
"""What it is where it only says how far from supports and forces stress counts."""

MAXIMUM_ANYWHERE = "greatest von Mises stress at the Gauss points of all elements"
"""What it is where nothing is averaged or left out."""

FILLED = 0.25
"""Share of a ball that must lie in the body: half of it does at a flat surface, less where elements cut it off."""

PERCENTILE = "von Mises stress that 99 % of the volume does not exceed, at all Gauss points, next to supports too"
"""What ``p99_von_mises_mpa`` is; a maximum of means away from supports and forces can be less."""

_ELEMENTS = 1 << 12
"""Elements at a time, whose planes fit a processor's cache."""


@dataclass(frozen=True)
class StressFigures:
    """The figures of a solved mesh.

    Attributes
    ----------
    max_von_mises_mpa: as ``definition`` says.
    max_at_mm: (3,) where: a Gauss point, or the middle of a ball.
    definition: one line.
    max_at_point_mpa: at the Gauss points of ``MAXIMUM``, whatever is averaged.
    max_anywhere_mpa: at any Gauss point.
    p99_von_mises_mpa: see ``PERCENTILE``.
    strain_energy_nmm: integral of the strain energy density, N mm.
    """

    max_von_mises_mpa: float
    max_at_mm: Floats
    definition: str
    max_at_point_mpa: float
    max_anywhere_mpa: float
    p99_von_mises_mpa: float
    strain_energy_nmm: float


@dataclass(frozen=True, eq=False)
class Stress:
    """Stress at nodes, and the figures.

    Attributes
    ----------
    stress_mpa, strain: (6, n) xx, yy, zz, xy, yz, xz; shear strains are the tensor's, half the engineers'.
    energy: (n,) strain energy density, N mm/mm3, never below 0.
    figures: from the Gauss points.
    """

    stress_mpa: Floats
    strain: Floats
    energy: Floats
    figures: StressFigures

    __repr__ = brief

    def fields(self) -> dict[str, NDArray[Any]]:
        """Nodal fields (n,) for a mesh: stress, strain, their principal values, von Mises, energy density."""
        names = ["xyz"[row] + "xyz"[column] for row, column in COMPONENTS]
        made = {f"stress_{name}_mpa": values for name, values in zip(names, self.stress_mpa, strict=True)}
        made |= {"von_mises_mpa": von_mises(self.stress_mpa)}
        made |= {f"principal_{n}_mpa": values for n, values in enumerate(principal(self.stress_mpa), start=1)}
        made |= {f"strain_{name}": values for name, values in zip(names, self.strain, strict=True)}
        made |= {f"principal_strain_{n}": values for n, values in enumerate(principal(self.strain), start=1)}
        return made | {"strain_energy_density": self.energy}


@dataclass(eq=False)
class _Seen:
    """What is gathered from the elements as they pass."""

    n_nodes: int
    mean: LocalMean | None = None
    recovered: Floats = field(init=False)
    volume: Floats = field(init=False)
    energy_nmm: float = 0.0
    best: float = -1.0
    best_at: Floats = field(default_factory=lambda: np.zeros(3))
    anywhere: float = 0.0
    values: list[NDArray[np.float32]] = field(default_factory=list)
    shares: list[NDArray[np.float32]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.recovered, self.volume = np.zeros((13, self.n_nodes)), np.zeros(self.n_nodes)

    def recover(self, found: GaussStress, nodes: NDArray[np.int32], extrapolation: Floats) -> None:
        """Add what the elements of ``nodes`` (m, k) extrapolate to them, times their volumes."""
        volume = found.volume.sum(axis=0)
        first, last = int(nodes.min()), int(nodes.max()) + 1
        flat = (nodes.T - first).ravel()
        for total, values in zip(self.recovered, (*found.stress, *found.strain, found.energy), strict=True):
            at_nodes = extrapolation @ values * volume
            total[first:last] += np.bincount(flat, at_nodes.ravel(), last - first)
        self.volume[first:last] += np.bincount(flat, np.tile(volume, nodes.shape[1]), last - first)

    def judge(self, found: GaussStress, points_mm: Floats, counted: NDArray[np.bool_]) -> None:
        """See the Gauss values at points (3, g, m); elements that are ``counted`` (m,) may hold the maximum."""
        values = von_mises(found.stress)
        self.energy_nmm += float((found.energy * found.volume).sum())
        self.anywhere = max(self.anywhere, float(values.max()))
        self.values.append(values.ravel().astype(np.float32))
        self.shares.append(found.volume.ravel().astype(np.float32))
        if self.mean is not None:
            self.mean.add(points_mm.reshape(3, -1).T, found.volume.ravel(), values.ravel())
        among = np.where(counted, values, -1.0)
        if among.max() > self.best:
            g, m = np.unravel_index(int(among.argmax()), among.shape)
            self.best, self.best_at = float(among[g, m]), points_mm[:, g, m].copy()

    def percentile(self, share: float) -> float:
        """Value that a share of the volume does not exceed."""
        values, shares = np.concatenate(self.values), np.concatenate(self.shares)
        order = np.argsort(values)
        filled = np.cumsum(shares[order], dtype=np.float64)
        return float(values[order[min(int(np.searchsorted(filled, share * filled[-1])), order.size - 1)]])


def recover(
    mesh: Mesh,
    displacement_mm: Floats,
    *,
    modulus: str = "graded",
    formulation: str = "full",
    gripped: NDArray[np.bool_] | None = None,
    away_mm: float = 0.0,
    averaged_mm: float = 0.0,
    centres_mm: NDArray[Any] | None = None,
) -> Stress:
    """Stress of a solved mesh at its nodes, and its figures.

    Arguments
    ---------
    mesh: hexes with the nodal fields ``E_MPa`` and ``nu``.
    displacement_mm: (n, 3) of the nodes.
    modulus, formulation: those that it was solved with, see ``gauss_stress``.
    gripped: (n,) bool, nodes that are held or carry a force.
    away_mm: how far from them the maximum is looked for; everywhere where it is 0.
    averaged_mm: radius that stress is averaged over before its maximum is taken; 0 takes it at the Gauss points.
    centres_mm: (c, 3) middles of the balls that it is averaged over, the mesh's nodes where None. Meshes of one body
        are compared at the same places.

    Raises
    ------
    InputError as ``gauss_stress``, and where no element lies that far away.
    """
    check_options(mesh, modulus, formulation)
    shape, extrapolation = mesh.element.shape(mesh.element.gauss()[0]), extrapolate(mesh.element)
    near = _near(mesh, gripped, away_mm) if gripped is not None and gripped.any() and away_mm > 0 else None
    seen = _Seen(mesh.n_nodes, local_mean(mesh.points, averaged_mm) if averaged_mm > 0 else None)
    for elements in _slabs(mesh):
        nodes = mesh.cells_of(elements)
        found = gauss_stress(mesh, displacement_mm, elements, modulus=modulus, formulation=formulation)
        seen.recover(found, nodes, extrapolation)
        points = np.matmul(shape, mesh.planes[:, nodes.T].astype(np.float64))
        counted = np.ones(len(nodes), dtype=np.bool_) if near is None else np.asarray(~near[nodes].any(axis=1))
        seen.judge(found, points, counted)
    if seen.best < 0:
        raise InputError(f"expected elements further than {away_mm:.3g} mm from supports and forces, got none of them")
    nodal = seen.recovered / np.where(seen.volume > 0, seen.volume, 1.0)
    best, at, definition = seen.best, seen.best_at, MAXIMUM_ANYWHERE if near is None else MAXIMUM.format(away=away_mm)
    if seen.mean is not None:
        centres = mesh.points if centres_mm is None else centres_mm
        held = mesh.points[gripped] if near is not None else np.empty((0, 3))
        best, at, definition = _greatest_mean(seen.mean, centres, held, away_mm)
    figures = StressFigures(
        max_von_mises_mpa=best,
        max_at_mm=at,
        definition=definition,
        max_at_point_mpa=seen.best,
        max_anywhere_mpa=seen.anywhere,
        p99_von_mises_mpa=seen.percentile(0.99),
        strain_energy_nmm=seen.energy_nmm,
    )
    return Stress(nodal[:6], nodal[6:12], np.maximum(nodal[12], 0.0), figures)


def _greatest_mean(
    mean: LocalMean, centres: NDArray[Any], held: NDArray[Any], away_mm: float
) -> tuple[float, Floats, str]:
    """Give the greatest mean about the centres away from points that are held, where it is, and what it is."""
    counted = np.ones(len(centres), dtype=np.bool_)
    if len(held):
        counted = ~np.isfinite(cKDTree(held).query(centres, distance_upper_bound=away_mm)[0])
    means, filled = mean.at(centres)
    means = np.where(counted & (filled >= FILLED), means, -1.0)
    place = int(means.argmax())
    if means[place] < 0:
        raise InputError(
            f"expected balls of {mean.radius_mm:g} mm with {100 * FILLED:.0f} % in the body, got none to average in"
        )
    words = MAXIMUM_MEAN.format(radius=mean.radius_mm, away=away_mm if len(held) else 0.0, filled=100 * FILLED)
    return float(means[place]), centres[place].astype(np.float64), words


def extrapolate(element: Element) -> Floats:
    """(k, g) from values at the Gauss points of a hex to its vertices, by the trilinear function nearest to them."""
    at, weights = element.gauss()
    linear = ELEMENTS["hex8"]
    basis = linear.shape(at)
    fitted = np.linalg.solve(basis.T @ (weights[:, None] * basis), basis.T * weights)
    return np.asarray(linear.shape(np.array(element.vertices) / 2) @ fitted)


def _near(mesh: Mesh, gripped: NDArray[np.bool_], away_mm: float) -> NDArray[np.bool_]:
    """Which nodes (n,) lie within a distance of those that are gripped."""
    distance, _ = cKDTree(mesh.points[gripped]).query(mesh.points, distance_upper_bound=away_mm)
    return np.asarray(np.isfinite(distance))


def _slabs(mesh: Mesh) -> Iterator[NDArray[np.int64]]:
    for first in range(0, mesh.n_elements, _ELEMENTS):
        yield np.arange(first, min(first + _ELEMENTS, mesh.n_elements))
