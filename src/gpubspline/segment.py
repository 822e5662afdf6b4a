"""The first half of the flow: files to a volume, and the body in it."""

import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.cautions import warn_of_everything, warn_of_hu, warn_of_labels, warn_of_soft, warn_of_units
from gpubspline.clock import Clock
from gpubspline.ct.image import read_volume
from gpubspline.ct.masks import open_labels, read_segment
from gpubspline.ct.region import Region, otsu_threshold, region_from_mask, region_from_threshold
from gpubspline.ct.volume import Volume
from gpubspline.ct.window import Window, crop, find_window
from gpubspline.device import Device
from gpubspline.errors import GpubsplineWarning, InputError
from gpubspline.mesh.blocks.level_set import SAMPLES
from gpubspline.mesh.element_size import default_size
from gpubspline.recipe import Body, Meshing, Source
from gpubspline.spline.reformat import AXES as STACKED
from gpubspline.surface.read import read_surface
from gpubspline.surface.region import region_from_surface
from gpubspline.surface.surface import Surface, spelled

AXES = {"x": 0, "y": 1, "z": 2}

APART = 0.01
"""Share of a mask, in parts of their own, from which is warned: less are specks."""


def find_body(source: Source, clock: Clock) -> Body:
    """Read the CT and find the body: by mask, by threshold, or by Otsu's threshold where neither is given."""
    if source.axis not in STACKED:
        raise InputError(f"expected the axis {', '.join(STACKED)}, got {source.axis!r}")
    if source.mask is not None and source.threshold_hu is not None:
        raise InputError("expected a threshold or a mask, got both")
    if source.label is not None and source.mask is None:
        raise InputError("expected a label together with a mask file, got a label alone")
    with clock.stage("read"):
        whole = read_volume(source.path, progress=clock.advance, **source.reading)
        mask = None if source.mask is None else read_segment(source.mask, whole, source.label)
        labels = None if source.labels is None else open_labels(source.labels, whole)
    with clock.stage("region"):
        window = _window(source, whole)
        volume = crop(whole, window)
        warn_of_units(volume)
        if not warn_of_labels(whole):
            warn_of_hu(whole)
        if source.slice_index is None and 1 in volume.shape:
            along = "ijk"[volume.shape.index(1)]
            raise InputError(f"expected several slices for a solid, got one along {along}: --slice makes quads of it")
        fill = source.fill or ("slice" if mask is None else "none")
        options: dict[str, Any] = {"fill": fill, "fill_axis": AXES.get(source.axis, 2)}
        if mask is not None:
            options["smoothing_mm"] = source.smoothing_mm
            if mask.coverage is not None:
                options["coverage"] = mask.coverage[window.slices]
            region = region_from_mask(volume, mask.inside[window.slices], **options)
            _warn_of_parts(mask.inside[window.slices], region)
            return Body(whole, volume, region, None, labels, source.partial_volume)
        threshold = source.threshold_hu
        if threshold is None:  # of all slices, also where one is meshed: it may hold nothing but air
            threshold = otsu_threshold(crop(whole, _window(replace(source, slice_index=None), whole)))
        options["smoothing_mm"] = source.smoothing_mm or 0.0
        region = region_from_threshold(volume, threshold, **options)
        if region.mask.all():
            warn_of_everything(volume, threshold)
        elif source.threshold_hu is None:
            warn_of_soft(volume, region, threshold)
        return Body(whole, volume, region, threshold, labels, source.partial_volume)


def _warn_of_parts(mask: NDArray[np.bool_], region: Region) -> None:
    """Warn where a mask has parts apart from its largest, which alone is meshed."""
    left = np.count_nonzero(mask & ~region.mask) / np.count_nonzero(mask)
    if left > APART:
        warnings.warn(
            f"{left:.0%} of the mask is left out: it lies apart from the largest part, which alone is meshed",
            GpubsplineWarning,
            stacklevel=2,
        )


def find_surface_body(
    path: Path, ct: Path | None, source: Source, meshing: Meshing, device: Device, clock: Clock
) -> Body:
    """Read a closed surface, and the CT that its material comes from, if any.

    The grid is a third of an element, or fine enough for a third of the one that the thinnest feature asks for.
    """
    with clock.stage("read"):
        surface = read_surface(path)
        whole = None if ct is None else read_volume(ct, progress=clock.advance, **source.reading)
    if whole is not None:
        _check_overlap(surface, whole, path.name)
    with clock.stage("region"):
        size = meshing.size_mm
        if size is None and meshing.elements is not None and meshing.elements > 0:
            size = float(np.cbrt(surface.volume_mm3 / meshing.elements))
        region = region_from_surface(surface, device, spacing_mm=None if size is None else size / SAMPLES)
        if size is None and default_size(region) / SAMPLES < 0.8 * float(region.spacing_mm.min()):
            region = region_from_surface(surface, device, spacing_mm=default_size(region) / SAMPLES)
    return Body(whole, whole, region, None, partial_volume=source.partial_volume)


def _check_overlap(surface: Surface, volume: Volume, name: str) -> None:
    """Raise InputError where a surface lies outside the CT: the one in another frame, perhaps."""
    index = volume.to_indices(surface.points)
    outside = np.any((index < -1) | (index > np.array(volume.shape)), axis=1)
    if outside.all():
        low, high = surface.box
        raise InputError(
            f"expected {name} to lie in the CT, got it at {spelled(low)} to {spelled(high)}, outside the scan: are its "
            "coordinates LPS mm? (RAS has the signs of x and y turned)"
        )
    if outside.any():
        warnings.warn(
            f"{outside.mean():.0%} of the points of {name} lie outside the CT, where HU is that of the nearest voxel",
            GpubsplineWarning,
            stacklevel=2,
        )


def _window(source: Source, volume: Volume) -> Window:
    axis = AXES.get(source.axis)
    if source.slice_index is not None and axis is None:
        raise InputError("expected the axis x, y or z for one slice, got long, whose slices are no voxels'")
    return find_window(volume, source.box_mm, source.slices, source.slice_index, 2 if axis is None else axis)
