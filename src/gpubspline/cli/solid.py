"""The mesh that a command works on: a mesh file, or made of a model file, a CT or a surface."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gpubspline.cli.options import MethodOptions, ReadOptions, RegionOptions, SamplingOptions, SplineOptions
from gpubspline.errors import InputError


@dataclass(frozen=True, eq=False)
class Solid:
    """A mesh, and what is known of how it was made: CT, law, body, figures of the mesh; of a mesh file nothing."""

    mesh: Any
    volume: Any = None
    laws: Any = None
    body: Any = None
    figures: Any = None


def find_model(
    source: list[Path],
    read: ReadOptions,
    region: RegionOptions,
    method: MethodOptions,
    spline: SplineOptions,
    sampled: SamplingOptions,
    device: Any,
    clock: Any,
    check: Callable[[Any], None],
) -> Solid:
    """Read a mesh file, or make the mesh of a model file, a CT, or a surface in one.

    ``check`` is given a body that is found in CT, before it is meshed.
    """
    from gpubspline import pipeline
    from gpubspline.export import can_read, read_mesh
    from gpubspline.spline.model import load_model
    from gpubspline.surface.read import is_surface

    surface = is_surface(source[0]) and method.ct is not None  # else .stl and .ply are meshes
    if can_read(source[0]) and not surface:
        plain = (ReadOptions(), RegionOptions(), MethodOptions(), SplineOptions(), SamplingOptions())
        if len(source) > 1 or (read, region, method, spline, sampled) != plain:
            raise InputError(f"expected one mesh file, without options that make a mesh, got {source[0].name} and more")
        with clock.stage("read"):
            return Solid(read_mesh(source[0]))
    if is_model(source, read, region, spline):
        if method != MethodOptions():
            raise InputError(
                f"expected no options of a method with {source[0].name}, which is a patch of the tensor one"
            )
        with clock.stage("read"):
            patch = load_model(source[0])
        model = pipeline.sample_patch(patch, sampled.sampling(), device, clock)
        return Solid(model.mesh, laws=model.laws)
    return _from_ct(source, read, region, method, spline, sampled, device, clock, check)


def _from_ct(
    source: list[Path],
    read: ReadOptions,
    region: RegionOptions,
    method: MethodOptions,
    spline: SplineOptions,
    sampled: SamplingOptions,
    device: Any,
    clock: Any,
    check: Callable[[Any], None],
) -> Solid:
    from gpubspline import methods, pipeline
    from gpubspline.surface.read import is_surface

    sliced, wanted = region.slice_index is not None, region.source(source, read, spline, sampled.surface_depth)
    shaping, meshing, sampling = spline.shaping(2 if sliced else 3), method.meshing(), sampled.sampling(region.labels)
    methods.implied(meshing, shaping, sampling, sliced)  # refuses before any work what does not fit together
    if is_surface(source[0]) and method.ct is None:
        raise InputError(f"expected --ct, which the material of {source[0].name} comes from, got a surface alone")
    body = find_any_body(source, wanted, read, region, method, meshing, device, clock)
    check(body.region)
    with clock.stage("method"):
        choice = methods.choose(body, meshing, shaping, sampling, spline.axis, device, sliced)
    how = (choice, wanted, shaping, meshing, sampling, device, clock)
    model, figures = make_model(body, *how, pipeline.sample_patch)
    return Solid(model.mesh, body.volume, model.laws, body, figures)


def make_model(
    body: Any,
    choice: Any,
    wanted: Any,
    shaping: Any,
    meshing: Any,
    sampling: Any,
    device: Any,
    clock: Any,
    sample: Callable[..., Any],
) -> tuple[Any, dict[str, Any]]:
    """Mesh a body by the method chosen; gives the model and its figures.

    ``sample`` makes the model of the tensor method's patch, as ``pipeline.sample_patch`` does.
    """
    from gpubspline import methods, pipeline
    from gpubspline.spline.lattice import SMOOTHING

    pipeline.check_calibration(sampling, body)
    if choice.method == "tensor":
        fitted = pipeline.fit_body(body, wanted, shaping, device, clock)
        model = sample(fitted.fit.patch, sampling, device, clock, body)
        figures = pipeline.summarise(model, device, clock, fitted, choice=choice)
    else:
        meshed = methods.mesh_body(body, choice, meshing, sampling, device, clock)
        model = pipeline.finish(meshed.mesh, sampling, device, clock, body, least_mm=meshed.least_mm)
        figures = pipeline.summarise(model, device, clock, body=body, choice=choice, meshed=meshed)
    warn_of_shape(figures, shaping.row_smoothing > SMOOTHING)
    return model, figures


def is_model(source: list[Path], read: ReadOptions, region: RegionOptions, spline: SplineOptions) -> bool:
    """Whether the input is a model file.

    Raises InputError where options come with it that find a body in CT, or more inputs: it has its body.
    """
    if source[0].suffix != ".npz":
        return False
    if len(source) > 1 or (read, region, spline) != (ReadOptions(), RegionOptions(), SplineOptions()):
        raise InputError(f"expected one model file, without options that fit one to CT, got {source[0].name} and more")
    return True


def find_any_body(
    source: list[Path],
    wanted: Any,
    read: ReadOptions,
    region: RegionOptions,
    method: MethodOptions,
    meshing: Any,
    device: Any,
    clock: Any,
) -> Any:
    """Find the body in a CT, or read a surface."""
    from gpubspline.segment import find_body, find_surface_body
    from gpubspline.surface.read import is_surface

    if not is_surface(source[0]):
        if method.ct is not None:
            raise InputError(f"expected --ct with a surface as input, got {source[0].name}, which is read as CT itself")
        return find_body(wanted, clock)
    if len(source) > 1 or region != RegionOptions():
        raise InputError(f"expected one surface, without options that find a body in CT, got {source[0].name} and more")
    if method.ct is None and read != ReadOptions():
        raise InputError("expected --ct with options that read one, got a surface alone")
    return find_surface_body(source[0], method.ct, wanted, meshing, device, clock)


def warn_of_shape(figures: dict[str, Any], smoothed: bool = False) -> None:
    """Warn of gaps that a mesh bridges or closes, and of parts of the body that it leaves out.

    ``smoothed``: whether rows of the tensor method were smoothed more than by default.
    """
    from gpubspline.cautions import warn_of_bridges, warn_of_lost, warn_of_volume

    lost, size_mm, less = figures["lost_features"] or [], figures["size_mm"], 0.0
    if figures["method"]["name"] == "tensor":
        for size in (figures["volume_mm3"], figures["area_mm2"]):
            if size["mesh"] is not None and size["region"]:
                warn_of_bridges(size["mesh"], size["region"], smoothed)
    if figures["method"]["name"] == "blocks":
        volume = figures["volume_mm3"]
        less = 1 - volume["mesh"] / volume["region"]
        if not lost or less < 0:
            warn_of_volume(volume["mesh"], volume["region"], size_mm)
    warn_of_lost(lost, size_mm, less)
