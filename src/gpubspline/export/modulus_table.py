"""The nodal material as a table along one nodal field, which a solver carries as temperature.

A solver knows a material by its temperature, and a temperature by node. The field that plays it must tell modulus and
Poisson's ratio apart at every node. HU does: each node's material is a function of its HU. The modulus itself does not
where two branches of a law overlap with different Poisson's ratios (eqs 3.6 and 3.7 give 129 to 436 MPa twice).

The table's rows are nodes' own values, and enough of them that linear interpolation between rows gives every other
node its modulus, Poisson's ratio and density within ``TOLERANCE`` of their size; two rows straddle a jump. Beyond the
nodes nothing is promised: within an element the solver interpolates HU, not modulus, and crosses a jump where HU does.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.errors import InputError

TOLERANCE = 1e-4
"""Relative; a tenth of the third digit, which no density calibration has."""

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ModulusTable:
    """Material along a carrier.

    Attributes
    ----------
    carrier: name of the nodal field that plays the temperature, ``"HU"`` or ``"E_MPa"``.
    at: (r,) its value in each row, rising.
    columns: (r,) each, what the rows hold: ``E_MPa``, ``nu`` and, where all of it is positive, ``density_g_cm3``.
    error: largest relative difference of a node from the table.
    """

    carrier: str
    at: Floats
    columns: dict[str, Floats]
    error: float


def modulus_table(fields: dict[str, NDArray[Any]]) -> ModulusTable:
    """Tabulate nodal fields ``E_MPa``, ``nu`` and ``density_g_cm3`` along ``HU``, or along ``E_MPa`` where that fails.

    Raises
    ------
    InputError where neither field tells the materials of the nodes apart.
    """
    names = ["E_MPa", "nu"]
    if "density_g_cm3" in fields and np.all(fields["density_g_cm3"] > 0):
        names.append("density_g_cm3")
    values = np.stack([fields[name].astype(np.float64) for name in names])
    size = np.maximum(np.abs(values), 1e-300)
    for carrier in ("HU", "E_MPa"):
        if carrier not in fields:
            continue
        at, first, place = np.unique(fields[carrier].astype(np.float64), return_index=True, return_inverse=True)
        if np.all(np.abs(values - values[:, first][:, place]) <= TOLERANCE * size):
            rows, error = _thin(at, values[:, first])
            columns = {name: column[first][rows] for name, column in zip(names, values, strict=True)}
            return ModulusTable(carrier, at[rows], columns, error)
    raise InputError(
        "expected a material that is a function of HU or of its modulus, got another: ask for modulus bins"
    )


def _thin(at: Floats, columns: Floats) -> tuple[NDArray[np.int64], float]:
    """Rows of a table (c, n) along ``at`` (n,) that suffice, and the largest relative error left.

    Douglas and Peucker's way: every segment that errs too much somewhere is split where it errs most.
    """
    size = np.maximum(np.abs(columns), 1e-300)
    rows = np.unique([0, len(at) - 1])
    while True:
        straight = np.stack([np.interp(at, at[rows], column[rows]) for column in columns])
        error = np.max(np.abs(straight - columns) / size, axis=0)
        if error.max() <= TOLERANCE:
            return rows, float(error.max())
        segment = np.searchsorted(rows, np.arange(len(at)), side="right") - 1
        most = np.maximum.reduceat(error, rows)[segment]
        worst = np.flatnonzero((error == most) & (most > TOLERANCE))
        _, one_each = np.unique(segment[worst], return_index=True)
        rows = np.union1d(rows, worst[one_each])
