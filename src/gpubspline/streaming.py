"""The second half of the flow for meshes too large to hold: sampled, judged, counted and written slab by slab."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from gpubspline.clock import Clock
from gpubspline.ct.region import Region
from gpubspline.device import Device
from gpubspline.export.density_names import with_kind
from gpubspline.export.vts import VtsWriter, write_slab
from gpubspline.material.alarms import add_alarms
from gpubspline.material.assign import nodal_alarms
from gpubspline.material.mapping import apply_material, law_on_device
from gpubspline.material.voxel_mass import voxel_mass_g
from gpubspline.mesh.distance import distances, flat_axes
from gpubspline.mesh.quality import assess
from gpubspline.mesh.slabs import SLAB_NODES, Slab, sample_slabs
from gpubspline.mesh.tally import add, tally
from gpubspline.pipeline import calibrate, sample_patch
from gpubspline.recipe import Body, Model, Sampling
from gpubspline.spline.hyperpatch import Hyperpatch

LOOKED_AT = 96
"""Samples per direction of the mesh that stands for one too large to draw."""


def stream_patch(
    patch: Hyperpatch,
    sampling: Sampling,
    path: Path,
    device: Device,
    clock: Clock,
    body: Body | None = None,
    allow_inverted: bool = False,
    slab_nodes: int = SLAB_NODES,
) -> Model:
    """Do what ``pipeline.sample_patch`` does slab by slab, and write each slab to a ``.vts`` as it comes.

    Memory does not grow with the mesh; no connectivity is ever built.

    Raises
    ------
    MeshError, and no file is left, where an element is inverted and that is not allowed.
    """
    nodes = sampling.nodes or patch.shape
    seen = tuple(min(n, LOOKED_AT) for n in nodes)
    sampling, calibrated = calibrate(sampling, body)
    law = sampling.law
    coarse = sample_patch(patch, replace(sampling, nodes=seen), device, Clock())
    flat = None if body is None else flat_axes(coarse.mesh, body.region)
    parts, alarms, policy = [], [], sampling.mapping.policy
    named = with_kind(coarse.mesh)
    types = {name: values.dtype for name, values in named.fields.items()}
    cell_types = {name: values.dtype for name, values in named.cell_fields.items()}
    with VtsWriter(path, nodes, types, cell_types, coarse.mesh.points.dtype) as writer:
        slabs = sample_slabs(patch, nodes, device=device, slab_nodes=slab_nodes)
        while slab := _next(slabs, clock):
            with clock.stage("material"):
                mesh, material = apply_material(slab.mesh, law, device=device, **policy)
                alarms.append(nodal_alarms(mesh, material, device, slab.own_nodes, points=1))
            with clock.stage("quality"):
                mesh, quality = assess(mesh, device)
                if not allow_inverted:
                    quality.check()
            with clock.stage("distance"):
                off = None if body is None else _side_distances(slab, body.region, device, flat)
                own: dict[str, Any] = {"own_nodes": slab.own_nodes, "out_of_range": alarms[-1].outside}
                parts.append(tally(mesh, quality, **own, distances=off))
            with clock.stage("write"):
                write_slab(writer, replace(slab, mesh=with_kind(mesh)))
                clock.advance(slab.last, nodes[2] - 1)
    mass, treatment = None, None
    if body is not None and body.volume is not None:
        treatment = body.partial_volume
        with clock.stage("material"):
            there = law_on_device(law, device, **policy)
            mass = voxel_mass_g(body.volume, body.region, there, device, partial_volume=treatment)
    counted = add_alarms(alarms, mass_voxels_g=mass, partial_volume=treatment)
    return Model(coarse.mesh, add(parts), sampling, law, counted, calibrated)


def _next(slabs: Iterator[Slab], clock: Clock) -> Slab | None:
    with clock.stage("sample"):
        return next(slabs, None)


def _side_distances(slab: Slab, region: Region, device: Device, flat: Any) -> tuple[Any, Any]:
    found = [distances(slab.mesh, region, device, side, flat) for side in slab.sides]
    return np.concatenate([d for d, _ in found]), np.concatenate([w for _, w in found])
