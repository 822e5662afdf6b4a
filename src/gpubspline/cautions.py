"""What a user is told of a mesh before it is made, and warned of after: how long, what is lost, closed or bridged."""

import warnings
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from gpubspline.clock import Clock
from gpubspline.ct.labels import MOST_LABELS, label_counts
from gpubspline.ct.region import Region, fill_holes
from gpubspline.ct.volume import AIR_HU, Volume
from gpubspline.errors import GpubsplineWarning
from gpubspline.material.density import MASS_OF, WEIGHED, steps_between
from gpubspline.mesh.blocks.result import BlocksReport, BodyReport
from gpubspline.mesh.element_size import ACROSS, about_elements, size_of
from gpubspline.mesh.thickness import thinnest

BRIDGED = 0.05
"""Relative difference of volumes of mesh and region from which the tensor method warns."""

SECONDS_PER_HEX = 1.5e-4
"""What a hex of blocks takes on two cores without others, about: measured from ten thousand to a million."""

LONG_S, FEWER = 90.0, 50_000
"""Time from which it is said before the work, and the hexes that are offered instead."""

THIN, HALF = 1.3, 0.5
"""Thickness, in elements, below which half of a region has nothing but walls: none of its hexes lies well inside."""

BODY_OFF, LISTED = 0.02, 12
"""Relative difference of a label's volume from which is warned, and the most labels that are named."""

NAMED = 3
"""Most places of another topology that are named."""

MOST_FINER = 0.5
"""Part of an element below which a feature is too thin to ask for hexes that follow it."""


BONE_HU, MOST_SOFT = 100.0, 0.5
"""HU from which on the laws speak of bone, and the share below it from which a body found by Otsu is asked about."""

SMALL_MM = 1.0
"""Extent of a scan below which it is asked whether its unit is the millimetre: a biopsy in a micro-CT has several."""

BELOW_AIR_HU, UNDER = -1100, 0.02
"""HU that noise and metal bring few voxels below, and the share of a scan there from which they are no HU."""

MOST_HU = 32767
"""HU above those of any metal on the extended scale of scanners, whose 16 bits are signed."""

LEAST_RANGE_HU = 10.0
"""Range of a scan that has two tissues in it; one from 0 to 1 is of attenuation, of density or scaled."""


def warn_of_units(volume: Volume) -> None:
    """Warn where a scan is so small that its spacing may be in metres or centimetres."""
    size = volume.spacing_mm * volume.shape
    if size.max() < SMALL_MM:
        warnings.warn(
            f"the scan is {' x '.join(f'{mm:.2g}' for mm in size)} mm in all: are its spacing and origin in mm?",
            GpubsplineWarning,
            stacklevel=2,
        )


def warn_of_labels(volume: Volume) -> bool:
    """Warn where what was given for the CT looks like a segmentation, whose numbers are no HU; tell whether it does."""
    counts = label_counts(volume.hu)
    looks_so = bool(counts) and max(counts) <= MOST_LABELS
    if looks_so:
        warnings.warn(
            f"the scan has nothing but whole numbers from 0 to {max(counts)}, as a segmentation has: they are taken "
            "for HU; give the CT, and this with --mask",
            GpubsplineWarning,
            stacklevel=2,
        )
    return looks_so


def warn_of_hu(volume: Volume) -> None:
    """Warn where the values of a scan are hardly HU: of another unit, or of a slope or intercept that went wrong."""
    low, high = float(volume.hu.min()), float(volume.hu.max())
    under = np.count_nonzero((volume.hu < BELOW_AIR_HU) & (volume.hu > low))  # without what fills its corners
    if 0 < high - low < LEAST_RANGE_HU:
        what = f"all values are from {low:.3g} to {high:.3g}"
    elif high > MOST_HU:
        what = f"values go up to {high:,.0f}"
    elif low >= 0 and high > -AIR_HU:
        what = "no value is below 0, as where HU + 1024 is stored or the background was set to 0"
    elif under > UNDER * volume.hu.size:
        what = (
            f"{under / volume.hu.size:.0%} lie below {BELOW_AIR_HU} and above {low:g}, as where 1024 is taken off twice"
        )
    else:
        return
    warnings.warn(f"the scan is taken for HU, but {what}: are its slope and intercept right?", GpubsplineWarning, 2)


def warn_of_soft(volume: Volume, region: Region, threshold_hu: float) -> None:
    """Warn where Otsu's threshold, which nobody chose, parts air from the body, and not bone from the rest."""
    soft = float(np.mean(volume.hu[region.mask] < BONE_HU))
    if threshold_hu < BONE_HU and soft > MOST_SOFT:
        warnings.warn(
            f"Otsu's threshold, {threshold_hu:.0f} HU, parts the body from air: {soft:.0%} of what is meshed lies "
            f"below {BONE_HU:.0f} HU, where no bone is; --threshold 250, or about that, finds bone, and 'gpubspline "
            "preview' draws what it takes",
            GpubsplineWarning,
            stacklevel=2,
        )


def warn_of_everything(volume: Volume, threshold_hu: float) -> None:
    """Warn where all of a scan, or of a crop, is the body: the mesh is a box, whose faces are where the voxels end."""
    warnings.warn(
        f"all voxels are body, of {volume.hu.min():g} to {volume.hu.max():g} HU with the threshold {threshold_hu:g}: "
        "the mesh is the box of the scan, or of the crop",
        GpubsplineWarning,
        stacklevel=2,
    )


def foretell(region: Region, size_mm: float, clock: Clock, of_surface: bool = False) -> None:
    """Say how many blocks there will be, about, and where they take more than a minute how long, and what takes less.

    ``of_surface``: whether the region is a surface's, not a scan's.

    Voxels count more faces than smooth surfaces have: porous bodies come out smaller.
    """
    elements = about_elements(region, size_mm)
    seconds = elements * SECONDS_PER_HEX
    clock.tell(f"about {elements:,.0f} hexes, {max(seconds, 1):,.0f} s")
    if seconds > LONG_S:
        warnings.warn(
            f"about {elements:,.0f} hexes of {size_mm:.3g} mm take some {seconds / 60:.0f} minutes; "
            f"--size {size_of(region, FEWER):.3g} gives about {FEWER:,}",
            GpubsplineWarning,
            stacklevel=2,
        )
    warn_of_walls(region, size_mm, of_surface)


def warn_of_walls(region: Region, size_mm: float, of_surface: bool = False) -> None:
    """Warn before the work where half of a region is walls as thin as an element: hexes are more.

    What is advised to fill has something to be filled, and a surface no option that finds another body.
    """
    if region.volume_mm3 < size_mm**3:  # which blocks refuse
        return
    thick, times = thinnest(region)[0].least(HALF), about_elements(region, size_mm) * size_mm**3 / region.volume_mm3
    if thick < THIN * size_mm:
        hollow = not of_surface and np.count_nonzero(fill_holes(region.mask, "volume")) > np.count_nonzero(region.mask)
        thicker = "" if of_surface else "another --threshold or a mask makes them thicker, "
        if hollow:
            thicker = f"--fill volume, {thicker}"
        warnings.warn(
            f"half of the region is less than {thick:.2g} mm thick, where two elements need {ACROSS * size_mm:.3g}: "
            f"its walls take about {times:.1f} times the hexes that fit in; --size {thick / ACROSS:.2g} follows them, "
            f"{thicker}--elements sets how many there are",
            GpubsplineWarning,
            stacklevel=2,
        )


def warn_of_weight(gravity: bool, kind: str) -> None:
    """Warn where gravity would pull at a density that is no weight: ``kind`` is that of the material's density."""
    if not gravity or kind == WEIGHED:
        return
    sources = "; ".join(dict.fromkeys(step.source for step in steps_between(kind, WEIGHED)))
    warnings.warn(
        f"gravity pulls at the {kind} density of the law, the {MASS_OF[kind]}, which is not what bone weighs "
        f"({sources}): a law of {WEIGHED} density has its weight",
        GpubsplineWarning,
        stacklevel=2,
    )


def warn_of_topology(report: BlocksReport, keeps_mm: float | None) -> None:
    """Warn where the mesh has other bodies, tunnels or cavities than the region: what it does where, and what does not.

    ``keeps_mm`` is a size that keeps the topology, where one is known.
    """
    if report.is_whole:
        return
    places = [f"{place.what} at ({', '.join(f'{x:.4g}' for x in place.place_mm)}) mm" for place in report.topology]
    named, rest = places[:NAMED], len(places) - NAMED
    more = f", and {rest} more, which the summary lists" if rest > 0 else ""
    finer = f"a --size below {report.size_mm:.3g} mm may follow what is thinner than an element there"
    warnings.warn(
        f"the mesh has other tunnels or cavities than the region (Euler characteristic {report.euler['mesh']}, not "
        f"{report.euler['region']}): it {', '.join(named)}{more}; "
        + (finer if keeps_mm is None else f"--size {keeps_mm:.3g} keeps the topology"),
        GpubsplineWarning,
        stacklevel=2,
    )


def warn_of_bodies(bodies: Sequence[BodyReport], parts: Mapping[str, Region], size_mm: float) -> None:
    """Warn of labels whose hexes do not have their volume, the farthest off by name, with where it is thinnest."""
    off = [body for body in bodies if abs(body.off) > BODY_OFF]
    if not off:
        return
    worst = max(off, key=lambda body: abs(body.off))
    thin, (x, y, z) = thinnest(parts[worst.name])
    names = ", ".join(f"{body.name} {body.off:+.1%}" for body in off[:LISTED])
    warnings.warn(
        f"volumes of labels are off: {names}; {worst.name} is {thin.least():.2g} mm thin at "
        f"({x:.1f}, {y:.1f}, {z:.1f}) mm and below {thin.least(0.5):.2g} mm in half of its places, where two elements "
        f"need {2 * size_mm:.3g}: a smaller --size follows it, or join it to another label",
        GpubsplineWarning,
        stacklevel=2,
    )


def warn_of_bridges(mesh_mm3: float, region_mm3: float, smoothed: bool = False) -> None:
    """Warn where rows bridge gaps: a mesh of the tensor method that is not as large as its region.

    ``smoothed``: whether row ends were smoothed more than by default, which cuts them short.
    """
    off = mesh_mm3 / region_mm3 - 1
    if np.isfinite(off) and abs(off) > BRIDGED:
        more = "more" if off > 0 else "less"
        why = "are smoothed away" if smoothed and off < 0 else "cross gaps or miss parts of it"
        fewer = "a smaller --smooth-rows keeps them, " if smoothed and off < 0 else ""
        warnings.warn(
            f"the tensor mesh fills {abs(off):.0%} {more} than the region: its rows {why}; {fewer}"
            "--method butterfly or blocks follow the surface",
            GpubsplineWarning,
            stacklevel=2,
        )


def warn_of_volume(mesh_mm3: float, region_mm3: float, size_mm: float) -> None:
    """Warn where a mesh of blocks fills gaps that its elements are too large for, or leaves out what is too thin."""
    off = mesh_mm3 / region_mm3 - 1
    if np.isfinite(off) and abs(off) > BRIDGED:
        what = (
            f"fills {off:.0%} more than the region: pores and gaps narrower than its elements of {size_mm:.3g} mm are "
            "closed; a smaller --size keeps them open"
            if off > 0
            else f"fills {-off:.0%} less than the region: what is thinner than its elements of {size_mm:.3g} mm is "
            "left out; a smaller --size follows it"
        )
        warnings.warn(
            f"the mesh {what}",
            GpubsplineWarning,
            stacklevel=2,
        )


def warn_of_lost(lost: list[dict[str, Any]], size_mm: float | None, less: float = 0.0) -> None:
    """Warn of parts of the region that the mesh leaves out, the farthest by name, and say what follows it.

    ``less``: part of the region's volume that the mesh lacks, which is told where it is large.
    """
    if not lost:
        return
    worst = max(lost, key=lambda feature: float(feature["out_mm"]))
    place = ", ".join(f"{x:.1f}" for x in worst["place_mm"])
    thick, finer = worst.get("thickness_mm"), ""
    if size_mm is not None:
        finer = f"; a --size below {size_mm:.3g} mm follows thinner features"
        if thick is not None and thick < ACROSS * size_mm:
            finer = "; --smooth, or a mask without it, takes it away"
            if thick > MOST_FINER * size_mm:
                finer = f"; a --size of {thick / ACROSS:.2g} mm follows it"
    what = "a part of the region is" if len(lost) == 1 else f"{len(lost)} parts of the region are"
    if less > BRIDGED:
        what = f"{less:.0%} of the region's volume and {what}"
    where = f"at ({place}) mm" + (f", where it is {thick:.3g} mm thick" if thick is not None else "")
    warnings.warn(
        f"{what} left out, up to {worst['out_mm']:.1f} mm outside the mesh {where}{finer} (--features draws where)",
        GpubsplineWarning,
        stacklevel=2,
    )
