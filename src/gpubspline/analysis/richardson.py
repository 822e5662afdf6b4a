"""The limit and the observed order of a quantity under mesh refinement.

A quantity that follows f(h) = f0 + C h^p with the size h of the elements has three unknowns. Three meshes give them
(Richardson 1911; Roache 1998); more meshes give them by least squares, which forgives a mesh that does not quite refine
the one before it (Eca and Hoekstra, J. Comput. Phys. 262, 2014). A series that turns round has no such limit, and one
whose steps do not shrink has none in sight: both are said, not extrapolated.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.errors import InputError

LEAST_ORDER, GREATEST_ORDER = 0.25, 8.0
"""Orders that are looked for; one at either end is none that was observed."""

STEPS = 400
"""Orders tried before the best of them is refined."""

FAR = 0.5
"""Of the finest value: a limit further away is a guess."""

NOISE = 1e-9
"""Of the size of the values: a smaller change is rounding, or what the solver leaves."""

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Extrapolation:
    """What a series of meshes tells of a quantity.

    Attributes
    ----------
    limit: value at h = 0, or None.
    order: observed, p, or None.
    meshes: how many of the finest it is from.
    note: why there is none, or empty.
    """

    limit: float | None
    order: float | None
    meshes: int
    note: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Plain values, for JSON."""
        return {"limit": self.limit, "order": self.order, "meshes": self.meshes, "note": self.note}


def extrapolate(size: Sequence[float], value: Sequence[float]) -> Extrapolation:
    """Limit and order of values at element sizes, from the finer half of the meshes, three at the least.

    Arguments
    ---------
    size: (n,) positive and different, in any unit: such as the cube root of 1 over the number of elements.
    value: (n,) of the quantity.

    Raises
    ------
    InputError where sizes and values do not go together, or sizes are not positive and different.
    """
    h, f = np.asarray(size, dtype=np.float64), np.asarray(value, dtype=np.float64)
    if h.shape != f.shape or h.ndim != 1 or not (np.all(h > 0) and len(np.unique(h)) == len(h)):
        raise InputError(f"expected a value for each of the different sizes of meshes, got {f.shape} for {h.shape}")
    if not np.all(np.isfinite(f)):
        raise InputError("expected finite values of the meshes, got one that is not")
    order = np.argsort(-h)[-max(3, -(-len(h) // 2)) :]
    h, f = h[order], f[order]
    meshes = len(h)
    if meshes < 3:
        return Extrapolation(None, None, meshes, f"three meshes are needed, there are {meshes}")
    steps = np.diff(f)
    if np.all(np.abs(steps) <= NOISE * np.abs(f).max()):
        return Extrapolation(float(f[-1]), None, meshes, f"the finest {meshes} agree to {NOISE:g}")
    if np.any(steps > 0) and np.any(steps < 0):
        return Extrapolation(None, None, meshes, f"it goes up and down over the finest {meshes} meshes")
    found, limit = _fit(h / h[0], f)
    if found <= LEAST_ORDER * 1.001:
        return Extrapolation(None, None, meshes, f"the steps of the finest {meshes} do not shrink")
    if abs(limit - f[-1]) > FAR * abs(f[-1]):
        off = f"by {100 * abs(limit / f[-1] - 1):.0f} %" if f[-1] else "away from 0"
        return Extrapolation(None, found, meshes, f"too far from converged: the limit would move the finest {off}")
    if found >= GREATEST_ORDER * 0.999:
        return Extrapolation(
            float(f[-1]), None, meshes, f"the finest {meshes} follow no order up to {GREATEST_ORDER:g}"
        )
    return Extrapolation(limit, found, meshes)


def _fit(h: Floats, f: Floats) -> tuple[float, float]:
    """Order and limit whose f0 + C h^p is nearest to the values; 1e-12 of an order is left."""
    orders = np.linspace(LEAST_ORDER, GREATEST_ORDER, STEPS)
    while True:
        best = int(np.argmin([_misfit(p, h, f)[0] for p in orders]))
        low, high = orders[max(best - 1, 0)], orders[min(best + 1, len(orders) - 1)]
        if high - low < 1e-10:
            return float(orders[best]), _misfit(float(orders[best]), h, f)[1]
        orders = np.linspace(low, high, 20)


def _misfit(order: float, h: Floats, f: Floats) -> tuple[float, float]:
    """Sum of squares that f0 + C h^p leaves at an order, and f0."""
    power = h**order
    centred = power - power.mean()
    slope = float(centred @ (f - f.mean()) / (centred @ centred))
    limit = float(f.mean() - slope * power.mean())
    return float(np.sum((f - limit - slope * power) ** 2)), limit
