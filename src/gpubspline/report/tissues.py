"""What of a CT has which label, HU and law, before anything is meshed: the legend of a preview."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpubspline.ct.region import Region
from gpubspline.ct.volume import Volume
from gpubspline.material.laws import Law

SPREAD = (5.0, 95.0)
"""Percentiles between which most voxels of a tissue are: the rest are its edges and noise."""

ABOUT = "HU as they lie, of nine tenths of the voxels, and E of these"

STEPS = 19
"""Percentiles at which its law is asked: between two pieces a law may fall as HU rise."""


@dataclass(frozen=True)
class Tissue:
    """The voxels of a body that have a label.

    Attributes
    ----------
    label: its number; 0 of those that have none.
    name: of the label.
    mm3: their volume.
    apart: share of the label's voxels that lie outside of the body.
    hu: of most of them, the 5th and 95th percentile; None of none.
    law: its name.
    modulus_mpa: least and greatest of the law between these HU.
    """

    label: int
    name: str
    mm3: float
    apart: float
    hu: tuple[float, float] | None
    law: str
    modulus_mpa: tuple[float, float] | None

    @property
    def words(self) -> tuple[str, str, str, str]:
        """Name, volume, HU, and law with its modulus."""
        left = f", {self.apart:.0%} left out" if self.apart >= 0.01 else ""
        if self.hu is None or self.modulus_mpa is None:
            return self.name, "no voxel of the body", "", ""
        (low, high), (soft, stiff) = self.hu, self.modulus_mpa
        span = _told(soft) if soft == stiff else f"{_told(soft)} to {_told(stiff)}"
        return self.name, f"{self.mm3:,.0f} mm³{left}", f"{low:.0f} to {high:.0f} HU", f"E {span} MPa, {self.law}"


@dataclass(frozen=True, eq=False)
class Labelled:
    """A scan's labels.

    Attributes
    ----------
    numbers: (n_k, n_j, n_i) of each voxel's label, 0 for none.
    tissues: what each is.
    """

    numbers: NDArray[np.integer]
    tissues: tuple[Tissue, ...]


def find_tissues(
    volume: Volume, region: Region, labels: NDArray[np.integer], names: Mapping[int, str], laws: Mapping[int, Law]
) -> Labelled:
    """Find what each label would be meshed as, and the rest of the body.

    Arguments
    ---------
    volume, region: the scan and the body on its grid.
    labels: (n_k, n_j, n_i) number of each voxel's label, 0 for none.
    names: of the labels, by number.
    laws: by label; 0 is that of the rest.
    """
    found = []
    for number, name in {**names, 0: "the rest" if names else "the body"}.items():
        own = labels == number
        hu = volume.hu[own & region.mask]
        apart = 1 - hu.size / max(np.count_nonzero(own), 1) if number else 0.0
        law = laws.get(number, laws[0])
        if hu.size or number:
            mm3 = hu.size * volume.voxel_mm3
            found.append(Tissue(number, name, mm3, apart, _spread(hu), law.name, _moduli(hu, law)))
    return Labelled(labels, tuple(found))


def _spread(hu: NDArray[np.number]) -> tuple[float, float] | None:
    if not hu.size:
        return None
    low, high = np.percentile(hu, SPREAD)
    return float(low), float(high)


def _told(mpa: float) -> str:
    return f"{mpa:,.0f}" if mpa >= 100 else f"{mpa:.3g}"


def _moduli(hu: NDArray[np.number], law: Law) -> tuple[float, float] | None:
    if not hu.size:
        return None
    moduli = [law.modulus_mpa(float(value)) for value in np.percentile(hu, np.linspace(*SPREAD, STEPS))]
    return min(moduli), max(moduli)
