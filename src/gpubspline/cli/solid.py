"""The mesh that a command works on: a mesh file, or made of a model file or a CT."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gpubspline.cli.options import ReadOptions, RegionOptions, SamplingOptions, SplineOptions
from gpubspline.errors import InputError


@dataclass(frozen=True, eq=False)
class Solid:
    """A mesh, and what is known of how it was made; of a mesh file nothing is."""

    mesh: Any
    volume: Any = None
    law: Any = None


def find_model(
    source: list[Path],
    read: ReadOptions,
    region: RegionOptions,
    spline: SplineOptions,
    sampled: SamplingOptions,
    device: Any,
    clock: Any,
) -> Solid:
    """Read a mesh file, or make the mesh of a model file or a CT."""
    from gpubspline import pipeline
    from gpubspline.export import can_read, read_mesh
    from gpubspline.spline.model import load_model

    if can_read(source[0]):
        plain = (ReadOptions(), RegionOptions(), SplineOptions(), SamplingOptions())
        if len(source) > 1 or (read, region, spline, sampled) != plain:
            raise InputError(f"expected one mesh file, without options that make a mesh, got {source[0].name} and more")
        with clock.stage("read"):
            return Solid(read_mesh(source[0]))
    if is_model(source, read, region, spline):
        with clock.stage("read"):
            patch, body = load_model(source[0]), None
    else:
        shaping = spline.shaping(3 if region.slice_index is None else 2)
        fitted = pipeline.fit_patch(region.source(source, read, spline, sampled.surface_depth), shaping, device, clock)
        patch, body = fitted.fit.patch, fitted.body
    model = pipeline.sample_patch(patch, sampled.sampling(), device, clock, body)
    return Solid(model.mesh, None if body is None else body.volume, model.law)


def is_model(source: list[Path], read: ReadOptions, region: RegionOptions, spline: SplineOptions) -> bool:
    """Whether the input is a model file.

    Raises InputError where options come with it that find a body in CT, or more inputs: it has its body.
    """
    if source[0].suffix != ".npz":
        return False
    if len(source) > 1 or (read, region, spline) != (ReadOptions(), RegionOptions(), SplineOptions()):
        raise InputError(f"expected one model file, without options that fit one to CT, got {source[0].name} and more")
    return True
