"""How a field is coloured: one colour map, label and range per physical quantity."""

from dataclasses import dataclass
from typing import Any

import matplotlib
import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, LogNorm, Normalize
from numpy.typing import NDArray

TISSUE = LinearSegmentedColormap.from_list("tissue", ["#2a2b45", "#6d3c50", "#b36350", "#dba071", "#f0d8a6", "#fffbf0"])
"""From air to cortical bone, lightness rising all the way, so that it also reads in grey."""

DECADES = 20.0
"""The least ratio of the ends of a logarithmic colour bar."""


@dataclass(frozen=True)
class Quantity:
    """How a field is shown.

    Attributes
    ----------
    label: the name with its unit, for the colour bar.
    colours: a colour map, or the name of one of matplotlib's.
    limits: fixed ends of the colour bar; the field's own range where None.
    logarithmic: whether a range over decades is shown by its logarithm.
    """

    label: str
    colours: Any = "viridis"
    limits: tuple[float, float] | None = None
    logarithmic: bool = False

    def scale(self, values: NDArray[Any]) -> tuple[ScalarMappable, str]:
        """Make the mapping from values to colours, and say where its bar needs arrows for values beyond its ends.

        The range holds 99 % of the values, so that one metal clip does not turn everything else dark.
        """
        low, high = self.limits or np.percentile(values, [0.5, 99.5])
        if not high > low:
            low, high = low - 0.5, high + 0.5
        span = high - low
        below, above = np.min(values) < low - 0.01 * span, np.max(values) > high + 0.01 * span
        colours = matplotlib.colormaps[self.colours] if isinstance(self.colours, str) else self.colours
        extend = {(False, False): "neither", (True, False): "min", (False, True): "max", (True, True): "both"}
        decades = self.logarithmic and np.min(values) > 0 and high > DECADES * low
        norm = LogNorm(low, high) if decades else Normalize(low, high)
        return ScalarMappable(norm, colours), extend[bool(below), bool(above)]


QUANTITIES = {
    "HU": Quantity("HU", TISSUE),
    "E_MPa": Quantity("Young's modulus\nMPa", "viridis", logarithmic=True),
    "density_g_cm3": Quantity("density\ng/cm³", "cividis"),
    "nu": Quantity("Poisson's\nratio", "cividis"),
    "von_mises_mpa": Quantity("von Mises\nstress MPa", "plasma"),
    "displacement_mm": Quantity("displacement\nmm", "GnBu"),
    "scaled_jacobian": Quantity("scaled\nJacobian", "RdYlGn", (0.0, 1.0)),
}


def quantity(field: str) -> Quantity:
    """Look up how a field is shown; one that is not known gets its own name as the label."""
    return QUANTITIES.get(field, Quantity(field))
