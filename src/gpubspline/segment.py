"""The first half of the flow: files to a volume, and the body in it."""

from dataclasses import replace
from typing import Any

from gpubspline.clock import Clock
from gpubspline.ct.image import read_volume
from gpubspline.ct.masks import open_labels, read_segment
from gpubspline.ct.region import otsu_threshold, region_from_mask, region_from_threshold
from gpubspline.ct.volume import Volume
from gpubspline.ct.window import Window, crop, find_window
from gpubspline.errors import InputError
from gpubspline.recipe import Body, Source

AXES = {"x": 0, "y": 1, "z": 2}


def find_body(source: Source, clock: Clock) -> Body:
    """Read the CT and find the body: by mask, by threshold, or by Otsu's threshold where neither is given."""
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
        fill = source.fill or ("slice" if mask is None else "none")
        options: dict[str, Any] = {"fill": fill, "fill_axis": AXES.get(source.axis, 2)}
        if mask is not None:
            options["smoothing_mm"] = source.smoothing_mm
            if mask.coverage is not None:
                options["coverage"] = mask.coverage[window.slices]
            return Body(whole, volume, region_from_mask(volume, mask.inside[window.slices], **options), None, labels)
        threshold = source.threshold_hu
        if threshold is None:  # of all slices, also where one is meshed: it may hold nothing but air
            threshold = otsu_threshold(crop(whole, _window(replace(source, slice_index=None), whole)))
        options["smoothing_mm"] = source.smoothing_mm or 0.0
        return Body(whole, volume, region_from_threshold(volume, threshold, **options), threshold, labels)


def _window(source: Source, volume: Volume) -> Window:
    axis = AXES.get(source.axis)
    if source.slice_index is not None and axis is None:
        raise InputError("expected the axis x, y or z for one slice, got long, whose slices are no voxels'")
    return find_window(volume, source.box_mm, source.slices, source.slice_index, 2 if axis is None else axis)
