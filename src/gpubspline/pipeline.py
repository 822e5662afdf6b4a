"""The flow, as code: files, volume, region, control lattice, hyperpatch, mesh, material, summary."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from gpubspline.clock import Clock
from gpubspline.ct.image import read_volume
from gpubspline.ct.masks import read_mask
from gpubspline.ct.region import Region, otsu_threshold, region_from_mask, region_from_threshold
from gpubspline.ct.volume import Volume
from gpubspline.ct.window import Window, crop, find_window
from gpubspline.device import Device
from gpubspline.errors import InputError
from gpubspline.export.vts import VtsWriter, write_slab
from gpubspline.material.mapping import apply_material
from gpubspline.mesh.distance import distances, flat_axes
from gpubspline.mesh.quality import assess
from gpubspline.mesh.sample import sample
from gpubspline.mesh.slabs import SLAB_NODES, Slab, sample_slabs
from gpubspline.mesh.tally import add, tally
from gpubspline.recipe import Fitted, Model, Sampling, Shaping, Source
from gpubspline.report.summary import summary
from gpubspline.spline.fit import fit
from gpubspline.spline.hyperpatch import Hyperpatch
from gpubspline.spline.lattice import control_lattice, data_shape, default_shape

LOOKED_AT = 96
"""Samples per direction of the mesh that stands for one too large to draw."""

AXES = {"x": 0, "y": 1, "z": 2}


def find_region(source: Source, clock: Clock) -> tuple[Volume, Region, float | None]:
    """Read the CT and find the body: by mask, by threshold, or by Otsu's threshold where neither is given."""
    if source.mask is not None and source.threshold_hu is not None:
        raise InputError("expected a threshold or a mask, got both")
    if source.label is not None and source.mask is None:
        raise InputError("expected a label together with a mask file, got a label alone")
    with clock.stage("read"):
        whole = read_volume(source.path, progress=clock.advance, **source.reading)
        mask = None if source.mask is None else read_mask(source.mask, whole, source.label)
    with clock.stage("region"):
        window = _window(source, whole)
        volume = crop(whole, window)
        fill = source.fill or ("slice" if mask is None else "none")
        options: dict[str, Any] = {"fill": fill, "fill_axis": AXES.get(source.axis, 2)}
        if mask is not None:
            options["smoothing_mm"] = source.smoothing_mm
            return volume, region_from_mask(volume, mask[window.slices], **options), None
        threshold = otsu_threshold(volume) if source.threshold_hu is None else source.threshold_hu
        options["smoothing_mm"] = source.smoothing_mm or 0.0
        return volume, region_from_threshold(volume, threshold, **options), threshold


def _window(source: Source, volume: Volume) -> Window:
    axis = AXES.get(source.axis)
    if source.slice_index is not None and axis is None:
        raise InputError("expected the axis x, y or z for one slice, got long, whose slices are no voxels'")
    return find_window(volume, source.box_mm, source.slices, source.slice_index, 2 if axis is None else axis)


def fit_patch(source: Source, shaping: Shaping, device: Device, clock: Clock) -> Fitted:
    """Read the CT, find the body, lay the control lattice through it and make the hyperpatch."""
    volume, region, threshold = find_region(source, clock)
    only = None if source.slice_index is None else 0  # the volume is cropped to the slice
    with clock.stage("lattice"):
        shape = shaping.control or default_shape(region, source.axis, only)
        laid = data_shape(region, source.axis, only) if shaping.fit == "least-squares" else shape
        options: dict[str, Any] = {"axis": source.axis, "slice_index": only, "interpolation": shaping.interpolation}
        lattice = control_lattice(volume, region, laid, smoothing=shaping.row_smoothing, **options)
    with clock.stage("fit"):
        degree = shaping.degree * len(shape) if len(shaping.degree) == 1 else shaping.degree
        made = fit(lattice, shaping.fit, degree=degree, control=shape, device=device)
    return Fitted(region, threshold, made, shaping.fit)


def sample_patch(
    patch: Hyperpatch, sampling: Sampling, device: Device, clock: Clock, region: Region | None = None
) -> Model:
    """Sample a hyperpatch, map the material onto its nodes, judge its elements and its distance from the region."""
    nodes = sampling.nodes or patch.shape
    with clock.stage("sample"):
        mesh = sample(patch, nodes, order=sampling.order, element_type=sampling.element_type, device=device)
    with clock.stage("material"):
        mesh, material = apply_material(mesh, sampling.law, device=device, **sampling.policy)
    with clock.stage("quality"):
        mesh, quality = assess(mesh, device)
    with clock.stage("distance"):
        off = None if region is None else distances(mesh, region, device)
        counted = tally(mesh, quality, out_of_range=material.out_of_range, distances=off)
    return Model(mesh, counted, sampling)


def stream_patch(
    patch: Hyperpatch,
    sampling: Sampling,
    path: Path,
    device: Device,
    clock: Clock,
    region: Region | None = None,
    slab_nodes: int = SLAB_NODES,
) -> Model:
    """Do the same slab by slab and write each to a ``.vts`` as it comes, so that memory does not grow with the mesh."""
    nodes = sampling.nodes or patch.shape
    seen = tuple(min(n, LOOKED_AT) for n in nodes)
    coarse = sample_patch(patch, replace(sampling, nodes=seen), device, Clock())
    flat = None if region is None else flat_axes(coarse.mesh, region)
    parts = []
    types = {name: values.dtype for name, values in coarse.mesh.fields.items()}
    cell_types = {name: values.dtype for name, values in coarse.mesh.cell_fields.items()}
    with VtsWriter(path, nodes, types, cell_types, coarse.mesh.points.dtype) as writer:
        slabs = sample_slabs(patch, nodes, device=device, slab_nodes=slab_nodes)
        while slab := _next(slabs, clock):
            with clock.stage("material"):
                mesh, material = apply_material(slab.mesh, sampling.law, device=device, **sampling.policy)
            with clock.stage("quality"):
                mesh, quality = assess(mesh, device)
            with clock.stage("distance"):
                off = None if region is None else _side_distances(slab, region, device, flat)
                outside = int(np.count_nonzero(material.piece[slab.own_nodes] < 0))
                parts.append(tally(mesh, quality, own_nodes=slab.own_nodes, out_of_range=outside, distances=off))
            with clock.stage("write"):
                write_slab(writer, replace(slab, mesh=mesh))
            clock.advance(slab.last, nodes[2] - 1)
    return Model(coarse.mesh, add(parts), sampling)


def _next(slabs: Iterator[Slab], clock: Clock) -> Slab | None:
    with clock.stage("sample"):
        return next(slabs, None)


def _side_distances(slab: Slab, region: Region, device: Device, flat: Any) -> tuple[Any, Any]:
    found = [distances(slab.mesh, region, device, side, flat) for side in slab.sides]
    return np.concatenate([d for d, _ in found]), np.concatenate([w for _, w in found])


def summarise(model: Model, device: Device, clock: Clock, fitted: Fitted | None = None) -> dict[str, Any]:
    """Collect the figures of a run; those that need the CT are None where the model came from a file."""
    known: dict[str, Any] = {"law": model.sampling.law, "policy": model.sampling.policy.get("policy")}
    if fitted is not None:
        error, region = fitted.fit.error, fitted.region
        flat = model.mesh.element.dimension == 2
        known["region_size"] = region.section_mm2 if flat else region.volume_mm3
        known |= {"threshold_hu": fitted.threshold_hu, "fit": fitted.method}
        known |= {"fit_error_mm": error.mean_mm, "fit_error_hu": error.mean_hu}
    return summary(model.counted, device, clock.seconds, **known)
