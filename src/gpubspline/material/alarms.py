"""What a user should know about a mapping before trusting it: counted always, not only when it is bad."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.material.density import MASS_OF, steps_between
from gpubspline.material.laws import Law
from gpubspline.material.mass_parts import MassParts

NEAR_ZERO_MPA = 10.0
"""A modulus below this is softer than the bone that any of the laws was fitted to: marrow, air, or a wrong unit."""

MASS_TOLERANCE = 0.01
"""Relative difference of the mesh's mass from the voxels' that is worth an alarm."""


@dataclass(frozen=True)
class Alarms:
    """Counts of a mapping.

    Attributes
    ----------
    mapping: one of ``assign.MAPPINGS``.
    of: what was counted, ``"nodes"`` or ``"elements"``.
    count: how many there are.
    outside: of them, those whose HU no range of the law covers.
    beyond_specimens: those whose density none of the law's specimens had; None where these are unknown.
    near_zero: those whose modulus is below ``NEAR_ZERO_MPA``.
    density_kind: of the masses: of the law, or of laws by label whose kinds differ ``density.WEIGHED``.
    mass_mesh_g: density integrated over the mesh; None for quads.
    mass_voxels_g: the same law over the region's voxels; None without the CT.
    mass_parts: where the two part; None where they do not by more than ``MASS_TOLERANCE``, or it was not looked for.
    order_difference: of ``element-hu`` and ``element-e`` from each other, relative: mean by volume, and greatest.
    surface_depth_mm: how far inside the HU of the surface was read.
    partial_volume: what was done with the part of the surface's HU that is what lies outside, one of
        ``partial_volume.TREATMENTS``; None where it is not known.
    by_label: of laws by label what each makes of its elements, plain values; empty of one law.
    """

    mapping: str
    of: str
    count: int
    outside: int
    beyond_specimens: int | None
    near_zero: int
    density_kind: str
    mass_mesh_g: float | None = None
    mass_voxels_g: float | None = None
    order_difference: tuple[float, float] | None = None
    surface_depth_mm: float | None = None
    partial_volume: str | None = None
    by_label: tuple[dict[str, Any], ...] = ()
    mass_parts: MassParts | None = None

    @property
    def mass_difference(self) -> float | None:
        """Mass of the mesh over that of the voxels, less 1."""
        if self.mass_mesh_g is None or not self.mass_voxels_g:
            return None
        return self.mass_mesh_g / self.mass_voxels_g - 1

    @property
    def converted_by(self) -> list[str]:
        """Sources of the conversions that made the masses of laws by label one kind."""
        kinds = dict.fromkeys(share["density"] for share in self.by_label)
        steps = [step for kind in kinds for step in steps_between(kind, self.density_kind)]
        return list(dict.fromkeys(step.source for step in steps))

    def to_dict(self) -> dict[str, Any]:
        """Plain values, for JSON."""
        order, parts = self.order_difference, self.mass_parts
        mass: dict[str, Any] = {"mesh": self.mass_mesh_g, "voxels": self.mass_voxels_g}
        mass |= {"difference": self.mass_difference}
        mass |= {"density": self.density_kind, "converted_by": self.converted_by}
        return {
            "mapping": self.mapping,
            "surface_depth_mm": self.surface_depth_mm,
            "partial_volume": self.partial_volume,
            "of": self.of,
            "count": self.count,
            "outside_law": self.outside / self.count,
            "beyond_specimens": None if self.beyond_specimens is None else self.beyond_specimens / self.count,
            "near_zero_modulus": self.near_zero / self.count,
            "near_zero_mpa": NEAR_ZERO_MPA,
            "mass_g": mass,
            "mass_parts": None if parts is None else parts.to_dict(),
            "order_difference": None if order is None else {"mean": order[0], "max": order[1]},
        }


def count_alarms(
    mapping: str, of: str, law: Law, density: NDArray[Any], modulus: NDArray[Any], piece: NDArray[Any], **others: Any
) -> Alarms:
    """Count the alarms of n nodes or elements: density (n), g/cm3, modulus (n), MPa, and piece (n) of the law."""
    beyond = None
    if law.specimens_g_cm3 is not None:
        low, high = law.specimens_g_cm3
        beyond = int(np.count_nonzero((density < low) | (density > high)))
    outside, soft = int(np.count_nonzero(piece < 0)), int(np.count_nonzero(modulus < NEAR_ZERO_MPA))
    return Alarms(mapping, of, piece.size, outside, beyond, soft, law.density.kind, **others)


def add_alarms(parts: Sequence[Alarms], **others: Any) -> Alarms:
    """Alarms of a mesh from those of its parts, which were mapped alike; ``others`` are of the whole.

    Raises ValueError where masses are of unlike kinds of density.
    """
    if len({part.density_kind for part in parts}) > 1:
        raise ValueError("expected masses of one kind of density, got several")
    beyond = [part.beyond_specimens for part in parts if part.beyond_specimens is not None]
    masses = [part.mass_mesh_g for part in parts if part.mass_mesh_g is not None]
    return Alarms(
        parts[0].mapping,
        parts[0].of,
        sum(part.count for part in parts),
        sum(part.outside for part in parts),
        sum(beyond) if beyond else None,
        sum(part.near_zero for part in parts),
        parts[0].density_kind,
        sum(masses) if masses else None,
        **others,
    )


def mass_words(mass: dict[str, Any]) -> str:
    """What a mass is of, of the ``mass_g`` of ``Alarms.to_dict``, and how unlike kinds were made one."""
    words = f"{MASS_OF[mass['density']]}, by {mass['density']} density"
    if mass["converted_by"]:
        words += f", to which laws of other kinds are converted ({'; '.join(mass['converted_by'])})"
    return words


def mass_advice(alarms: dict[str, Any], volume_mm3: dict[str, float | None] | None = None) -> str:
    """Why the mass of a mesh is not the voxels', and what would mend it, of ``Alarms.to_dict``.

    ``volume_mm3``: of mesh and region, as a summary has them.
    """
    mesh, region = ((volume_mm3 or {}).get(name) for name in ("mesh", "region"))
    off, difference = mesh / region - 1 if mesh and region else 0.0, alarms["mass_g"]["difference"]
    parts = alarms.get("mass_parts")
    between = 1.0 if parts is None else parts["between_nodes_g"] / (difference * alarms["mass_g"]["voxels"])
    where = _where(parts) if parts is not None and between <= 0.5 else ""
    if abs(off) > MASS_TOLERANCE and off / difference > 0.5:
        return f"its volume is {abs(off):.1%} {'above' if off > 0 else 'below'} the region's{where and ': ' + where}"
    if alarms["partial_volume"] == "none" and alarms["surface_depth_mm"] is None:
        return "HU on the surface are half of what lies outside; --partial-volume fold gives them their own"
    if where:
        return where
    if alarms["mapping"] == "nodal":
        return (
            "HU are interpolated between nodes or control points: more of them, --mapping nodal-e or element-e mend it"
        )
    return "the quadrature is too coarse, or the mesh and the region differ in places"


def _where(parts: dict[str, float]) -> str:
    filled, left = parts["filled_mm3"], parts["left_mm3"]
    return (
        f"it fills {filled:,.0f} mm3 ({parts['filled_g']:.3g} g) outside the region, such as cracks and pores, and "
        f"leaves out {left:,.0f} mm3 of it; smaller elements, or more control points, follow it closer"
    )
