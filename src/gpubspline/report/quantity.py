"""How a field is coloured: one colour map, label and range per physical quantity."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import matplotlib
import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm, LinearSegmentedColormap, ListedColormap, LogNorm, Normalize
from numpy.typing import NDArray

from gpubspline.errors import InputError

TISSUE = LinearSegmentedColormap.from_list("tissue", ["#2a2b45", "#6d3c50", "#b36350", "#dba071", "#f0d8a6", "#fffbf0"])
"""From air to cortical bone, lightness rising all the way, so that it also reads in grey."""

DISTINCT = matplotlib.colormaps["tab20"](np.arange(20))[:, :3]
"""Of labels in turn."""

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

    @staticmethod
    def by_number(values: NDArray[Any]) -> ScalarMappable:
        """Make the mapping from labels to colours of their own, as a preview has them; the bar's edges lie between."""
        numbers = np.unique(np.round(values))
        edges = np.append(numbers, numbers[-1] + 1) - 0.5
        colours = DISTINCT[np.arange(len(numbers)) % len(DISTINCT)]
        return ScalarMappable(BoundaryNorm(edges, len(numbers)), ListedColormap(colours))

    @staticmethod
    def is_logarithmic(scale: ScalarMappable) -> bool:
        """Whether a mapping that ``scale`` made goes by the logarithm."""
        return isinstance(scale.norm, LogNorm)


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


FIRST = ("von_mises_mpa", "HU", "E_MPa", "scaled_jacobian")
"""Fields that a mesh is coloured by where none is asked for, the first that it has."""


def find_field(names: Sequence[str], wanted: str | None = None) -> str:
    """Field of a name, or of the beginning of one, such as ``"E"`` for ``"E_MPa"``.

    Arguments
    ---------
    names: the fields that a mesh has.
    wanted: with ``-`` or ``_`` between words, in small or capital letters; None takes the first of ``FIRST``.

    Raises
    ------
    InputError where the mesh has no such field, or several that begin so.
    """
    if wanted is None:
        known = [name for name in FIRST if name in names]
        if not names:
            raise InputError("expected a mesh with a field to colour it by, got one without fields")
        return (known or list(names))[0]
    if wanted in names:
        return wanted
    start = wanted.lower().replace("-", "_")
    found = [name for name in names if name.lower() == start] or [n for n in names if n.lower().startswith(start)]
    whole = [name for name in found if name.lower().startswith(f"{start}_")]
    found = whole if len(found) > 1 and len(whole) == 1 else found
    if len(found) != 1:
        kind = f", which begins {', '.join(found)}" if found else ""
        raise InputError(f"expected a field of the mesh ({', '.join(names) or 'none'}), got {wanted!r}{kind}")
    return found[0]
