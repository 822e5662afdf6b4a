"""Calibrating a scanner: HU to a density, by numbers, by a phantom's rods in the scan, or by the patient's tissues.

Rods and tissues give a line by least squares of density on HU; what each is off it is shown. The file that describes a
calibration is read by ``calibration_file.py``.
"""

import warnings
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, signal

from gpubspline.ct.masks import read_mask
from gpubspline.ct.volume import Volume
from gpubspline.errors import GpubsplineWarning, InputError
from gpubspline.material.density import DensityRelation, Step

RADIUS_MM = 3.0
"""Of the ball of voxels about a place, unless told: inside the rods of the common phantoms."""

PROMINENCE = 0.2
"""Of a tissue's peak over the valley beside it, in heights of the peak: fat of a head has none, its slope no mode."""

OFF_THE_LINE_G_CM3 = 0.016
"""Residual of a tissue that is asked about: muscle of 55 HU beside fat of -100 leaves 0.011, a real hip 0.001, a real
abdomen with contrast agent, whose mode is no muscle's, 0.017."""

TISSUES = {"air": (-0.840, (-1020.0, -900.0)), "fat": (-0.080, (-180.0, -20.0)), "muscle": (0.030, (10.0, 130.0))}
"""Density, g/cm3 of calcium equivalent, and the HU between which the histogram's peak is looked for.

After Eggermont et al., PLoS ONE 14 (2019) e0220564, who fit a line through the three peaks; its densities of the
tissues were not at hand to be confirmed."""

_TISSUES_UNCONFIRMED = "densities of air, fat and muscle: defaults after Eggermont et al. 2019, not checked against it"


@dataclass(frozen=True)
class Reference:
    """A rod or a tissue of known density in the scan.

    Attributes
    ----------
    name: what to call it.
    density_g_cm3: known.
    hu: mean or, of a histogram's peak, mode.
    deviation_hu: standard deviation within it; None where it was not measured.
    voxels: how many were measured.
    fitted_g_cm3: density that the calibration gives its HU.
    """

    name: str
    density_g_cm3: float
    hu: float
    deviation_hu: float | None = None
    voxels: int = 0
    fitted_g_cm3: float = np.nan

    @property
    def residual_g_cm3(self) -> float:
        """Fitted less known density."""
        return self.fitted_g_cm3 - self.density_g_cm3


PLAUSIBLE_G_CM3 = (0.3, 3.0)
"""Density at 1,000 HU that is not asked about: of scanners and phantoms about 0.7 to 0.9 by QCT, and 1.2 apparent."""


@dataclass(frozen=True)
class Calibrated:
    """A calibration that was carried out.

    Attributes
    ----------
    relation: from HU to density.
    method: ``"line"``, ``"table"``, ``"rods"`` or ``"tissues"``.
    references: what it was fitted to.
    slope_error_g_cm3_per_hu, intercept_error_g_cm3: standard errors of the line; None where no reference is to spare.
    """

    relation: DensityRelation
    method: str
    references: tuple[Reference, ...] = ()
    slope_error_g_cm3_per_hu: float | None = None
    intercept_error_g_cm3: float | None = None

    @property
    def rms_g_cm3(self) -> float | None:
        """Root of the mean squared residual; None where nothing was fitted."""
        if not self.references:
            return None
        return float(np.sqrt(np.mean([reference.residual_g_cm3**2 for reference in self.references])))

    def to_dict(self) -> dict[str, Any]:
        """Plain values, for JSON."""
        relation = self.relation
        return {
            "method": self.method,
            "kind": relation.kind,
            "source": relation.source,
            "slope_g_cm3_per_hu": relation.slope_g_cm3_per_hu,
            "intercept_g_cm3": relation.intercept_g_cm3,
            "slope_error_g_cm3_per_hu": self.slope_error_g_cm3_per_hu,
            "intercept_error_g_cm3": self.intercept_error_g_cm3,
            "table": [list(point) for point in relation.table],
            "rms_g_cm3": self.rms_g_cm3,
            "references": [{**vars(each), "residual_g_cm3": each.residual_g_cm3} for each in self.references],
        }


@dataclass(frozen=True)
class Calibration:
    """A calibration as a file describes it.

    Attributes
    ----------
    kind, source: of the density.
    folder: where masks are looked for.
    points: (HU, g/cm3) of a line, two, or a table; empty for the other methods.
    mask: file of the rods' labels.
    rods, tissues: their tables.
    method: see ``Calibrated``.
    """

    kind: str
    source: str
    method: str
    folder: Path
    relation: DensityRelation | None = None
    mask: Path | None = None
    rods: tuple[dict[str, Any], ...] = ()
    tissues: tuple[tuple[str, dict[str, Any]], ...] = ()

    def carry_out(self, volume: Volume | None) -> Calibrated:
        """Find the relation from HU to density, in the whole scan where rods or tissues are looked for.

        Raises
        ------
        InputError where there is no scan to look in, or what is looked for is not in it, or the references do not give
        a density that rises with HU.
        """
        if self.relation is not None:
            _ask_about_units(self.relation)
            return Calibrated(self.relation, self.method)
        if volume is None:
            raise InputError(f"expected the CT to find the {self.method} of the calibration in, got a model alone")
        found = self._rods(volume) if self.method == "rods" else self._tissues(volume)
        unconfirmed: tuple[str, ...] = ()
        if any("density_g_cm3" not in table for _, table in self.tissues):
            unconfirmed = (_TISSUES_UNCONFIRMED,)
        _ask_about_order(found)
        made = _fitted(found, self.kind, self.method, self.source, unconfirmed)
        _ask_about_units(made.relation)
        if self.method == "tissues":
            _ask_about_tissues(made)
        return made

    def _rods(self, volume: Volume) -> list[Reference]:
        found = []
        for number, rod in enumerate(self.rods, start=1):
            if "label" in rod:
                assert self.mask is not None
                inside = volume.hu[read_mask(self.folder / self.mask.expanduser(), volume, rod["label"])]
                name = f"rod {rod['label']}"
            else:
                name = f"rod {number}"
                inside = _ball(volume, rod["centre_mm"], rod.get("radius_mm", RADIUS_MM), name)
            found.append(_measured(name, rod["density_g_cm3"], inside))
        return found

    def _tissues(self, volume: Volume) -> list[Reference]:
        found = []
        for name, table in self.tissues:
            density = table.get("density_g_cm3", TISSUES[name][0])
            if "hu" in table:
                found.append(Reference(name, density, table["hu"]))
            elif "centre_mm" in table:
                inside = _ball(volume, table["centre_mm"], table.get("radius_mm", RADIUS_MM), name)
                found.append(_measured(name, density, inside))
            else:
                found.append(_peak(volume, name, density, TISSUES[name][1]))
        return found


def _measured(name: str, density: float, inside: NDArray[Any]) -> Reference:
    values = inside.astype(np.float64)
    return Reference(name, density, float(values.mean()), float(values.std()), values.size)


def _ball(volume: Volume, centre_mm: tuple[float, ...], radius_mm: float, name: str) -> NDArray[Any]:
    """HU of the voxels whose centres lie in a ball."""
    centre = volume.to_indices(centre_mm)
    reach = radius_mm * np.linalg.norm(volume.inverse[:3, :3], axis=1)
    low = np.clip(np.floor(centre - reach), 0, volume.shape).astype(int)  # before it is made whole: it may be anywhere
    high = np.clip(np.ceil(centre + reach) + 1, 0, volume.shape).astype(int)
    if np.any(high <= low):
        raise InputError(f"expected {name} of the calibration inside the scan, got ({_shown(centre_mm)}) mm")
    i, j, k = np.meshgrid(*(np.arange(a, b) for a, b in zip(low, high, strict=True)), indexing="ij")
    index = np.stack([i, j, k], axis=-1).reshape(-1, 3)
    index = index[np.linalg.norm(volume.to_points(index) - np.asarray(centre_mm), axis=1) <= radius_mm]
    if not len(index):
        at = f"({_shown(centre_mm)}) mm, radius {radius_mm:g} mm"
        raise InputError(f"expected voxels in {name} of the calibration, got none about {at}")
    return np.asarray(volume.hu[index[:, 2], index[:, 1], index[:, 0]])


def _peak(volume: Volume, name: str, density: float, between: tuple[float, float]) -> Reference:
    """Mode of a tissue's HU: the highest peak of the histogram, smoothed by 5 HU, that stands out from what is beside.

    Valleys may lie beyond the range in which the peak has to: between fat and muscle, or muscle and bone.
    """
    low, high = between
    beyond = 150.0 if high < 500 and low > -500 else 0.0  # air's has the padding of the scan below it
    ends = (low - beyond, high + beyond)
    inside = volume.hu[(volume.hu > ends[0]) & (volume.hu < ends[1])]
    counts, edges = np.histogram(inside, bins=int(ends[1] - ends[0]), range=ends)
    smooth = np.pad(ndimage.gaussian_filter1d(counts.astype(np.float64), 5.0, mode="nearest"), 1)
    tops, found = signal.find_peaks(smooth, prominence=0.0)
    at = (edges[tops - 1] + edges[tops]) / 2
    fits = (at > low) & (at < high) & (found["prominences"] > PROMINENCE * smooth[tops])
    fits &= (tops > 1) & (tops < len(smooth) - 2)
    within = int(np.count_nonzero((inside > low) & (inside < high)))
    if within < 1000 or not fits.any():
        raise InputError(
            f"expected a peak of {name} between {low:g} and {high:g} HU in the scan's histogram, got none: give its "
            "place (centre_mm) or its hu in the calibration"
        )
    best = int(np.argmax(np.where(fits, smooth[tops], -1.0)))
    return Reference(name, density, float(at[best]), None, within)


def _fitted(found: list[Reference], kind: str, method: str, source: str, unconfirmed: tuple[str, ...]) -> Calibrated:
    """Draw the line through references by least squares of density on HU."""
    hu, density = (np.array([getattr(each, name) for each in found]) for name in ("hu", "density_g_cm3"))
    if len(found) < 2 or np.ptp(density) == 0 or np.ptp(hu) == 0:
        raise InputError(
            f"expected at least two {method} of different density and HU to calibrate by, got {len(found)}"
        )
    slope, intercept = (float(value) for value in np.polyfit(hu, density, 1))
    step = Step(f"calibration by {len(found)} {method}", "HU", kind, slope, intercept, source, unconfirmed)
    relation = DensityRelation(kind, slope, intercept, source, (step,))
    references = tuple(
        Reference(each.name, each.density_g_cm3, each.hu, each.deviation_hu, each.voxels, slope * each.hu + intercept)
        for each in found
    )
    return Calibrated(relation, method, references, *_standard_errors(hu, slope * hu + intercept - density))


def _standard_errors(hu: NDArray[np.float64], residuals: NDArray[np.float64]) -> tuple[float | None, float | None]:
    """Of the slope and the intercept of a line by least squares; None for two points, which any line goes through."""
    spare = hu.size - 2
    if spare < 1:
        return None, None
    deviation, spread = np.sqrt(np.sum(residuals**2) / spare), np.sum((hu - hu.mean()) ** 2)
    return float(deviation / np.sqrt(spread)), float(deviation * np.sqrt(1 / hu.size + hu.mean() ** 2 / spread))


def _ask_about_order(found: list[Reference]) -> None:
    """Warn of references that are denser than others and have lower HU: they are swapped, or one is not what it is."""
    ordered = sorted(found, key=lambda each: (each.density_g_cm3, each.hu))
    for light, dense in pairwise(ordered):
        if dense.density_g_cm3 > light.density_g_cm3 and dense.hu < light.hu:
            warnings.warn(
                f"{dense.name} of the calibration is denser than {light.name} ({dense.density_g_cm3:g} and "
                f"{light.density_g_cm3:g} g/cm3) but has lower HU ({dense.hu:.0f}, {light.hu:.0f}): are they swapped?",
                GpubsplineWarning,
                stacklevel=2,
            )


def _ask_about_tissues(made: Calibrated) -> None:
    """Warn of tissues that lie on no line: what was taken for muscle may hold contrast agent, or be no muscle."""
    worst = max(made.references, key=lambda each: abs(each.residual_g_cm3))
    if abs(worst.residual_g_cm3) > OFF_THE_LINE_G_CM3:
        found = ", ".join(f"{each.name} {each.hu:.0f} HU" for each in made.references)
        warnings.warn(
            f"the tissues of the calibration lie off a line by up to {abs(worst.residual_g_cm3):.3f} g/cm3 ({found}): "
            "contrast agent, organs or little fat do so; give their places (centre_mm) or HU",
            GpubsplineWarning,
            stacklevel=2,
        )


def _ask_about_units(relation: DensityRelation) -> None:
    """Warn of a density at 1,000 HU that no bone has: calibrations are given in mg/cm3, too."""
    density = relation.density_g_cm3(1000.0)
    if not PLAUSIBLE_G_CM3[0] <= density <= PLAUSIBLE_G_CM3[1]:
        warnings.warn(
            f"the calibration gives 1,000 HU {density:.4g} g/cm3, which is no bone's {relation.kind} density: is it in "
            "mg/cm3?",
            GpubsplineWarning,
            stacklevel=2,
        )


def _shown(centre_mm: tuple[float, ...]) -> str:
    return ", ".join(f"{value:g}" for value in centre_mm)
