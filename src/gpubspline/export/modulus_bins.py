"""Elements gathered by modulus and Poisson's ratio, for solvers and people who want one material per element set."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.errors import InputError
from gpubspline.mesh.mesh import Mesh

_CHUNK = 1 << 18
"""Elements averaged at a time, which bounds the memory."""

ROUNDING = 1e-6
"""Relative difference of moduli that is none: no bin is narrower."""

POISSON_WIDTH = 0.02
"""Of a bin; elements that are held sideways are 6 % stiffer at 0.32 than at 0.30, and a quarter at 0.36."""


@dataclass(frozen=True, eq=False)
class ModulusBins:
    """Elements by modulus and Poisson's ratio.

    Attributes
    ----------
    members: element numbers of each bin that has any; by law, by modulus in it, by Poisson's ratio in that.
    modulus_mpa, poisson: (b,) of each bin, the mean of its elements.
    density_g_cm3: (b,) the same, or None where the mesh has none.
    largest_error, mean_error: of the bins' moduli against their elements', relative.
    poisson_error: the largest, absolute.
    source: what an element's modulus was taken from, in words.
    """

    members: list[NDArray[Any]]
    modulus_mpa: NDArray[np.float64]
    poisson: NDArray[np.float64]
    density_g_cm3: NDArray[np.float64] | None
    largest_error: float
    mean_error: float
    poisson_error: float
    source: str


def modulus_bins(mesh: Mesh, bins: int) -> ModulusBins:
    """Gather elements in bins of modulus, spaced evenly in its logarithm, so that the relative error is even.

    An element's modulus is its element field ``E_MPa``, or the mean of its nodes' where the mesh has none. Elements of
    different laws (element field ``law``) share no bin: each law has its own ``bins``. Nor do elements whose Poisson's
    ratios are more than ``POISSON_WIDTH`` apart, as where a law gives one modulus twice: such a bin is parted, and
    there are more than ``bins``. Poisson's ratio has ``bins`` at most itself, so that one bin is one material.

    Raises
    ------
    InputError for a number of bins below 1 or a modulus that is not positive.
    """
    if bins < 1:
        raise InputError(f"expected at least 1 modulus bin, got {bins}")
    modulus = element_values(mesh, "E_MPa")
    if modulus.min() <= 0:
        raise InputError(f"expected positive moduli, got {modulus.min():g} MPa")
    law = np.unique(mesh.cell_fields.get("law", np.zeros(modulus.size, np.int32)), return_inverse=True)[1]
    poisson, number = element_values(mesh, "nu"), np.empty(modulus.size, np.int64)
    for index in range(law.max() + 1):
        own = law == index
        within = index * bins + _number(np.log(modulus[own]), bins)
        number[own] = within * bins + _nearest(poisson[own], bins)
    present, place, counts = np.unique(number, return_inverse=True, return_counts=True)

    def mean(values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(np.bincount(place, values) / counts)

    error, known = np.abs(mean(modulus)[place] / modulus - 1), {*mesh.fields, *mesh.cell_fields}
    return ModulusBins(
        members=[np.flatnonzero(place == b) for b in range(len(present))],
        modulus_mpa=mean(modulus),
        poisson=mean(poisson),
        density_g_cm3=mean(element_values(mesh, "density_g_cm3")) if "density_g_cm3" in known else None,
        largest_error=float(error.max()),
        mean_error=float(error.mean()),
        poisson_error=float(np.abs(mean(poisson)[place] - poisson).max()),
        source="the modulus of each" if "E_MPa" in mesh.cell_fields else "the mean modulus of its nodes",
    )


def _number(logarithm: NDArray[np.float64], bins: int) -> NDArray[np.int64]:
    """Bin (m,) of each of the moduli."""
    span = max(float(np.ptp(logarithm)), ROUNDING * bins)
    return np.asarray(np.minimum((logarithm - logarithm.min()) / span * bins, bins - 1), dtype=np.int64)


def _nearest(poisson: NDArray[np.float64], bins: int) -> NDArray[np.int64]:
    """Bin (m,) of each Poisson's ratio: the nearest of even steps, on whose ends those lie that a law names."""
    steps = min(bins - 1, np.ceil(np.ptp(poisson) / POISSON_WIDTH - 1e-3))  # 0.36 - 0.30 is a hair more in float32
    width = np.ptp(poisson) / steps if steps > 0 else 1.0
    return np.asarray(np.rint((poisson - poisson.min()) / width), dtype=np.int64)


def element_values(mesh: Mesh, field: str) -> NDArray[np.float64]:
    """Values (m,) of an element field, or the means of the nodal field of that name where there is none."""
    if field in mesh.cell_fields:
        return np.asarray(mesh.cell_fields[field], dtype=np.float64)
    return element_means(mesh, field)


def element_means(mesh: Mesh, field: str) -> NDArray[np.float64]:
    """Mean (m,) of a nodal field over the nodes of each element."""
    values, means = mesh.fields[field].astype(np.float64), np.empty(mesh.n_elements)
    for first in range(0, mesh.n_elements, _CHUNK):
        elements = np.arange(first, min(first + _CHUNK, mesh.n_elements))
        means[elements] = values[mesh.cells_of(elements)].mean(axis=1)
    return means
