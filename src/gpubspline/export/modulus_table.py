"""The nodal material as a table along one nodal field, which a solver carries as temperature.

A solver knows a material by its temperature, and a temperature by node. Which field plays it depends on the element.

Elements with curved edges interpolate the temperature, and HU tells the materials apart at every node: each node's is a
function of its HU. The modulus itself does not where two branches of a law overlap with different Poisson's ratios
(eqs 3.6 and 3.7 give 129 to 436 MPa twice). Beyond the nodes nothing is promised: within an element the solver
interpolates HU, not modulus, and crosses a jump where HU does.

Elements with straight edges take one temperature, the mean of their nodes. The modulus of the mean HU is well below the
mean modulus (a femur of 13,000 hexes gives way a fifth more), so there the modulus is the temperature: each element has
the mean modulus of its nodes, exactly. Poisson's ratio and density are means where branches overlap; at how many nodes
they are off, by how much at most and the density in total, is stated.

The table's rows are nodes' own values, and enough of them that linear interpolation between rows gives every other
node its modulus, Poisson's ratio and density within ``TOLERANCE`` of their size; two rows straddle a jump.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.errors import InputError

TOLERANCE = 1e-4
"""Relative; a tenth of the third digit, which no density calibration has."""

MEAN_ROWS = 100
"""Of a table along the modulus whose Poisson's ratios and densities are means; ANSYS takes as many."""

NOTABLE = 0.01
"""Difference that is counted: as wide as bins of Poisson's ratio are."""

LOOSEST = 0.02
"""Relative; beyond it bins tell the truth better."""

MOST_ROWS = 10_000
"""A material that needs more is no function of its carrier but noise; the laws need a few hundred."""

_SAMPLE = 1 << 16
"""Nodes that lay out the table before the others are held against it, as many at a time: they bound the memory."""

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ModulusTable:
    """Material along a carrier.

    Attributes
    ----------
    carrier: name of the nodal field that plays the temperature, ``"HU"`` or ``"E_MPa"``.
    at: (r,) its value in each row, rising.
    columns: (r,) each, what the rows hold: ``E_MPa``, ``nu`` and, where all of it is positive, ``density_g_cm3``.
    error: largest relative difference of a node's modulus from the table.
    poisson_error: largest difference of a node's Poisson's ratio.
    density_error: largest relative difference of a node's density.
    density_total_error: relative difference of the sum of all nodes' densities.
    share_off: of the nodes whose Poisson's ratio is off by more than ``NOTABLE``, or density by as much of it.
    """

    carrier: str
    at: Floats
    columns: dict[str, Floats]
    error: float
    poisson_error: float = 0.0
    density_error: float = 0.0
    density_total_error: float = 0.0
    share_off: float = 0.0


def modulus_table(
    fields: dict[str, NDArray[Any]], most_rows: int | None = None, straight: bool = False
) -> ModulusTable:
    """Tabulate nodal fields ``E_MPa``, ``nu`` and ``density_g_cm3`` along ``HU``, or along ``E_MPa`` where that fails.

    Arguments
    ---------
    most_rows: that the solver takes, or None for any number; where ``TOLERANCE`` needs more, the tolerance is doubled
        until they suffice, up to ``LOOSEST``.
    straight: for elements with straight edges: along ``E_MPa``, whatever it takes.

    Raises
    ------
    InputError where neither field tells the materials of the nodes apart.
    """
    names = ["E_MPa", "nu"]
    if "density_g_cm3" in fields and np.all(fields["density_g_cm3"] > 0):
        names.append("density_g_cm3")
    if straight:
        few = min(most_rows or MEAN_ROWS, MEAN_ROWS)  # many rows would only follow the nodes from branch to branch
        return _plain(fields, names, few) or _along_modulus(fields, names, few)
    for carrier in ("HU", "E_MPa"):
        found = _exact(fields, carrier, names, most_rows, TOLERANCE) if carrier in fields else None
        if found is not None:
            return found
    raise InputError(
        "expected a material that is a function of HU or of its modulus, got another: ask for modulus bins"
    )


def _exact(
    fields: dict[str, NDArray[Any]], carrier: str, names: list[str], most_rows: int | None, tolerance: float
) -> ModulusTable | None:
    """Table within a tolerance of every node, looser where rows are few, or None."""
    columns = [fields[name] for name in names]
    found = _tabulate(fields[carrier], columns, tolerance, MOST_ROWS)
    while found is not None and most_rows is not None and found[0].shape[1] > most_rows and tolerance < LOOSEST:
        tolerance *= 2
        found = _tabulate(fields[carrier], columns, tolerance, MOST_ROWS)
    if found is None or found[0].shape[1] > (most_rows or MOST_ROWS):
        return None
    (at, *rows), error = found
    return ModulusTable(carrier, at, dict(zip(names, rows, strict=True)), error, error, error)


def _plain(fields: dict[str, NDArray[Any]], names: list[str], most_rows: int) -> ModulusTable | None:
    """Table along the modulus within ``TOLERANCE`` of every node, or None where few rows do not do it."""
    found = _tabulate(fields["E_MPa"], [fields[name] for name in names], TOLERANCE, most_rows)
    if found is None:
        return None
    (at, *rows), error = found
    return ModulusTable("E_MPa", at, dict(zip(names, rows, strict=True)), 0.0, error, error)


def _along_modulus(fields: dict[str, NDArray[Any]], names: list[str], n_rows: int) -> ModulusTable:
    """Table along the modulus, in which it is itself, and all else the mean of the nodes about each row."""
    modulus = fields["E_MPa"]
    low, high = float(modulus.min()), float(modulus.max())
    if low <= 0:
        raise InputError(f"expected positive moduli, got {low:g} MPa")
    at = np.geomspace(low, high, n_rows).astype(modulus.dtype).astype(np.float64)
    at[[0, -1]] = low, high
    at = np.unique(at)
    between, sums = np.sqrt(at[1:] * at[:-1]), np.zeros((len(names), at.size))
    for nodes in _parts(modulus.size):
        nearest = np.searchsorted(between, modulus[nodes].astype(np.float64))
        sums += [np.bincount(nearest, None if name == "E_MPa" else fields[name][nodes], at.size) for name in names]
    met = sums[0] > 0
    columns = {"E_MPa": at}
    for name, total in zip(names[1:], sums[1:], strict=True):
        columns[name] = np.interp(at, at[met], total[met] / sums[0, met])
    return ModulusTable("E_MPa", at, columns, 0.0, **_how_far_off(fields, columns))


def _how_far_off(fields: dict[str, NDArray[Any]], columns: dict[str, Floats]) -> dict[str, float]:
    """Figures of ``ModulusTable`` for a table along the modulus."""
    modulus, most, n_off, sums = fields["E_MPa"], {"nu": 0.0, "density_g_cm3": 0.0}, 0, np.zeros(2)
    for nodes in _parts(modulus.size):
        off = np.zeros(modulus[nodes].size)
        for name in columns.keys() & most.keys():
            own = fields[name][nodes].astype(np.float64)
            found = np.interp(modulus[nodes], columns["E_MPa"], columns[name])
            by = np.abs(found - own) if name == "nu" else np.abs(found / own - 1)
            off, most[name] = np.maximum(off, by), max(most[name], float(by.max()))
            sums += (found.sum(), own.sum()) if name != "nu" else 0
        n_off += int(np.count_nonzero(off > NOTABLE))
    total = float(abs(sums[0] / sums[1] - 1)) if sums[1] else 0.0
    figures = {"poisson_error": most["nu"], "density_error": most["density_g_cm3"], "density_total_error": total}
    return figures | {"share_off": n_off / modulus.size}


def _parts(n_nodes: int) -> list[slice]:
    return [slice(first, first + _SAMPLE) for first in range(0, n_nodes, _SAMPLE)]


def _tabulate(
    along: NDArray[Any], columns: list[NDArray[Any]], tolerance: float, most_rows: int
) -> tuple[Floats, float] | None:
    """Rows (1 + c, r) that suffice for every node, and the largest relative error left; None where so many do not.

    The nodes are gone through in parts, a sample of them all first, until none adds a row.
    """

    def values(nodes: Any) -> Floats:
        return np.stack([column[nodes].astype(np.float64) for column in (along, *columns)])

    n_nodes = along.size
    parts = [slice(0, n_nodes, -(-n_nodes // _SAMPLE)), *_parts(n_nodes)]
    table = values([along.argmin(), along.argmax()])
    if table[0, 0] == table[0, 1]:
        table = table[:, :1]
    while True:
        n_rows, error = table.shape[1], 0.0
        for part in parts:
            refined = _refined(table, values(part), tolerance, most_rows)
            if refined is None:
                return None
            table, left = refined
            error = max(error, left)
        if table.shape[1] == n_rows:
            return table, error


def _refined(table: Floats, nodes: Floats, tolerance: float, most_rows: int) -> tuple[Floats, float] | None:
    """Table (1 + c, r) with as many of the nodes (1 + c, k) as rows as the others need, and the error left.

    Douglas and Peucker's way: every segment that errs too much somewhere is split where it errs most. None where a node
    differs from the row at its own place, or the rows become too many.
    """
    while True:
        error = _relative_error(table, nodes)
        wrong = np.flatnonzero(error > tolerance)
        if wrong.size == 0:
            return table, float(error.max())
        segment = np.searchsorted(table[0], nodes[0, wrong], side="right")
        worst_first = np.lexsort((-error[wrong], segment))
        _, one_each = np.unique(segment[worst_first], return_index=True)
        table = np.concatenate([table, nodes[:, wrong[worst_first[one_each]]]], axis=1)
        table = table[:, np.argsort(table[0])]
        if table.shape[1] > most_rows or np.any(np.diff(table[0]) == 0):
            return None


def _relative_error(table: Floats, nodes: Floats) -> Floats:
    """Largest relative difference (k,) of each node's values from the table's, straight between rows."""
    at, rows = table[0], table[1:]
    low = np.clip(np.searchsorted(at, nodes[0], side="right") - 1, 0, max(at.size - 2, 0))
    high = np.minimum(low + 1, at.size - 1)
    share = (nodes[0] - at[low]) / np.maximum(at[high] - at[low], 1e-300)
    straight = rows[:, low] + share * (rows[:, high] - rows[:, low])
    return np.asarray(np.max(np.abs(straight - nodes[1:]) / np.maximum(np.abs(nodes[1:]), 1e-300), axis=0))
