"""The options of the command line in groups, each option spelled once, and what the groups make of their texts."""

import inspect
import sys
from collections.abc import Callable, Sequence
from dataclasses import MISSING, dataclass, fields, replace
from functools import wraps
from math import isfinite
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import typer

from gpubspline.errors import InputError
from gpubspline.files import check_apart, check_writable


def flattened(command: Callable[..., None]) -> Callable[..., None]:
    """Let a command take groups of options as dataclasses: Typer sees the fields, the command sees the groups."""
    hints = get_type_hints(command, include_extras=True)
    groups = {name: kind for name, kind in hints.items() if hasattr(kind, "__dataclass_fields__")}
    own = [p for p in inspect.signature(command).parameters.values() if p.name not in groups]
    parameters, annotations = list(own), {p.name: hints[p.name] for p in own}
    for kind in groups.values():
        kinds = get_type_hints(kind, include_extras=True)
        for field in fields(kind):
            default = inspect.Parameter.empty if field.default is MISSING else field.default
            parameters.append(inspect.Parameter(field.name, inspect.Parameter.KEYWORD_ONLY, default=default))
            annotations[field.name] = kinds[field.name]

    @wraps(command)
    def run(**given: Any) -> None:
        parts = {name: kind(**{f.name: given.pop(f.name) for f in fields(kind)}) for name, kind in groups.items()}
        command(**given, **parts)

    keyword = [p.replace(kind=inspect.Parameter.KEYWORD_ONLY, annotation=annotations[p.name]) for p in parameters]
    run.__signature__ = inspect.Signature(keyword)  # type: ignore[attr-defined]
    run.__annotations__ = annotations
    return run


def _option(panel: str, text: str, *names: str, metavar: str | None = None, show_default: bool = True) -> Any:
    return typer.Option(*names, help=text, metavar=metavar, rich_help_panel=panel, show_default=show_default)


@dataclass
class ReadOptions:
    """How a CT is read."""

    series: Annotated[str | None, _option("Input", "SeriesInstanceUID, where not the largest CT series")] = None
    allow_gaps: Annotated[bool, _option("Input", "fill missing slices by interpolation", "--allow-gaps")] = False
    spacing: Annotated[str | None, _option("Input", "voxel spacing of a .npy file, mm", metavar="DI,DJ,DK")] = None

    def reading(self) -> dict[str, Any]:
        """Keywords of ``read_volume``."""
        spacing = numbers(self.spacing, "spacing", 3)
        return {"series": self.series, "allow_gaps": self.allow_gaps, "spacing_mm": spacing}


@dataclass
class RegionOptions:
    """Which part of a CT is meshed."""

    box: Annotated[str | None, _option("Input", "crop to a box, LPS mm", metavar="X0,X1,Y0,Y1,Z0,Z1")] = None
    slices: Annotated[str | None, _option("Input", "crop to slices A to B - 1 along k", metavar="A:B")] = None
    slice_index: Annotated[
        int | None, _option("Input", "mesh slice K with quads, -1 for the last", "--slice", metavar="K")
    ] = None
    threshold: Annotated[
        float | None, _option("Region", "what lies above is body (default: Otsu's threshold)", metavar="HU")
    ] = None
    mask: Annotated[Path | None, _option("Region", "mask or label file on the CT's grid", metavar="FILE")] = None
    label: Annotated[int | None, _option("Region", "label in it (default: all but 0)", metavar="N")] = None
    fill: Annotated[
        str | None,
        _option("Region", "where holes are filled (default: slice, none for masks)", metavar="slice|volume|none"),
    ] = None
    smooth: Annotated[
        float | None, _option("Region", "Gaussian on HU, or on a mask's boundary (default: 0; a voxel)", metavar="MM")
    ] = None

    def source(self, paths: list[Path], read: ReadOptions, axis: str) -> Any:
        """What the pipeline reads."""
        from gpubspline.recipe import Source

        return Source(
            paths,
            threshold_hu=self.threshold,
            mask=self.mask,
            label=self.label,
            box_mm=numbers(self.box, "box", 6),
            slices=slice_range(self.slices),
            slice_index=self.slice_index,
            axis=axis,
            fill=self.fill,
            smoothing_mm=self.smooth,
            reading=read.reading(),
        )


@dataclass
class SplineOptions:
    """How the hyperpatch is made."""

    axis: Annotated[str, _option("Spline", "stack slices along this axis", metavar="x|y|z|long")] = "z"
    control: Annotated[str | None, _option("Spline", "control points (default: by the data)", metavar="NU,NV[,NW]")] = (
        None
    )
    degree: Annotated[str, _option("Spline", "degrees, 1 to 5", metavar="P[,Q[,R]]")] = "3"
    fit: Annotated[
        str,
        _option("Spline", "data as control points, through or near them", metavar="control|interpolate|least-squares"),
    ] = "control"
    interpolation: Annotated[str, _option("Spline", "resampling of HU", metavar="linear|cubic")] = "linear"

    smooth_rows: Annotated[
        float | None, _option("Spline", "Gaussian on row ends, in rows; 0 is the paper (default: 1.5)", metavar="ROWS")
    ] = None

    def shaping(self, directions: int) -> Any:
        """What the pipeline fits."""
        from gpubspline.recipe import Shaping

        degree = integers(self.degree, "degree", (1, directions)) or (3,)
        control = integers(self.control, "control", (directions,))
        shaping = Shaping(control, degree, self.fit, self.interpolation)
        if self.smooth_rows is None:
            return shaping
        if not self.smooth_rows >= 0:
            raise InputError(f"expected --smooth-rows of 0 or more, got {self.smooth_rows:g}")
        return replace(shaping, row_smoothing=self.smooth_rows)


@dataclass
class MeshOptions:
    """How the mesh is sampled, and what its material is."""

    nodes: Annotated[
        str | None, _option("Mesh", "samples per direction (default: as control points)", metavar="U,V[,W]")
    ] = None
    order: Annotated[int, _option("Mesh", "1: quad4, hex8; 2: quad8, hex20", metavar="1|2")] = 1
    element: Annotated[str | None, _option("Mesh", "element type instead, such as hex27", metavar="TYPE")] = None
    law: Annotated[
        str | None, _option("Material", "see 'gpubspline laws' (default: wirtz-2000)", metavar="NAME|FILE.toml")
    ] = None
    out_of_range: Annotated[str, _option("Material", "HU that the law does not cover", metavar="clamp|floor|error")] = (
        "clamp"
    )
    floor_modulus: Annotated[float | None, _option("Material", "modulus of 'floor'", metavar="MPA")] = None

    def sampling(self) -> Any:
        """What the pipeline samples."""
        from gpubspline.material.registry import DEFAULT_LAW
        from gpubspline.material.registry import law as find_law
        from gpubspline.recipe import Sampling

        policy: dict[str, Any] = {"policy": self.out_of_range}
        if self.floor_modulus is not None:
            policy["floor_modulus_mpa"] = self.floor_modulus
        counts = integers(self.nodes, "nodes", (2, 3))
        return Sampling(find_law(self.law or DEFAULT_LAW), counts, self.order, self.element, policy)


MADE_FIELDS = ("density_g_cm3", "E_MPa", "nu", "material", "scaled_jacobian")
"""Fields that a mesh gets beside the channels of its patch."""


@dataclass
class OutputOptions:
    """The files a run writes: checked before the work, written after it."""

    output: Annotated[
        Path,
        _option(
            "Output", "mesh: .vtu, .inp or what meshio writes", "--output", "-o", metavar="FILE", show_default=False
        ),
    ]
    modulus_bins: Annotated[
        int | None, _option("Output", ".inp: N element sets by modulus, not nodal modulus", metavar="N")
    ] = None
    summary: Annotated[Path | None, _option("Output", "figures of the run, .json", metavar="FILE")] = None
    picture: Annotated[Path | None, _option("Output", "picture of the mesh, .png", metavar="FILE")] = None
    field: Annotated[str, _option("Output", "field that colours the picture", metavar="NAME")] = "HU"
    histogram: Annotated[Path | None, _option("Output", "scaled Jacobians, .png", metavar="FILE")] = None

    _streamed = False  # whether the mesh was written while it was made

    @property
    def paths(self) -> list[Path]:
        """Every file that is asked for."""
        return [path for path in (self.output, self.summary, self.picture, self.histogram) if path]

    def check(self, inputs: Sequence[Path] = ()) -> None:
        """Raise InputError where a file could not be written, or would replace another or one of the inputs."""
        from gpubspline.export import check_extension
        from gpubspline.report.sheet import check_png

        check_extension(self.output)
        for path in self.paths:
            check_writable(path)
        check_apart(self.paths, inputs)
        for path in filter(None, (self.picture, self.histogram)):
            check_png(path)
        if self.modulus_bins is not None and self.output.suffix.lower() != ".inp":
            raise InputError(f"expected an .inp file for --modulus-bins, got {self.output.name}")

    def make(self, patch: Any, sampling: Any, device: Any, clock: Any, region: Any = None) -> Any:
        """Sample the patch; a ``.vts`` of a solid is written on the way, slab by slab."""
        from gpubspline import pipeline
        from gpubspline.streaming import stream_patch

        known = (*patch.channels, *MADE_FIELDS)
        if self.picture and self.field not in known:
            raise InputError(f"expected one of the fields {', '.join(known)} for --field, got {self.field!r}")
        first_order = sampling.order == 1 and sampling.element_type in (None, "hex8")
        self._streamed = self.output.suffix.lower() == ".vts" and patch.parametric_dimension == 3 and first_order
        if self._streamed:
            return stream_patch(patch, sampling, self.output, device, clock, region)
        return pipeline.sample_patch(patch, sampling, device, clock, region)

    def write(self, model: Any, figures: dict[str, Any], clock: Any) -> None:
        """Write what is not written yet."""
        from gpubspline.export import write
        from gpubspline.report.histogram import write_histogram
        from gpubspline.report.picture import write_picture
        from gpubspline.report.summary import write_summary

        if not self._streamed:
            with clock.stage("write"):
                write(model.mesh, self.output, law=model.sampling.law, modulus_bins=self.modulus_bins)
        if self.picture:
            with clock.stage("picture"):
                write_picture(model.mesh, self.picture, field=self.field)
        if self.histogram:
            write_histogram(model.counted.quality, self.histogram)
        if self.summary:
            figures["seconds"] = {**clock.seconds, "total": sum(clock.seconds.values())}
            write_summary(figures, self.summary)


@dataclass
class SolveOptions:
    """What acts on a mesh, how it is solved, and the files of it."""

    load: Annotated[
        str,
        _option(
            "Load",
            "load case: stance, or a file (schema: analysis/load_case.py)",
            metavar="NAME|FILE.toml",
            show_default=False,
        ),
    ]
    output: Annotated[
        Path,
        _option(
            "Output",
            "mesh with displacement and stress: .vtu or what meshio writes",
            "--output",
            "-o",
            metavar="FILE",
            show_default=False,
        ),
    ]
    summary: Annotated[Path | None, _option("Output", "figures of the run, .json", metavar="FILE")] = None
    modulus: Annotated[
        str, _option("Solve", "interpolated inside the elements, or one mean each", metavar="graded|element")
    ] = "graded"
    formulation: Annotated[
        str, _option("Solve", "of hex8; 'incompatible' bends freely", metavar="full|incompatible|bbar")
    ] = "full"
    tolerance: Annotated[float, _option("Solve", "forces out of balance, of the loads")] = 1e-8

    @property
    def paths(self) -> list[Path]:
        """Every file that is asked for."""
        return [path for path in (self.output, self.summary) if path]

    def case(self, inputs: Sequence[Path]) -> Any:
        """Read the load case; raises InputError, too, where a file could not be written or would replace an input."""
        from gpubspline.analysis.load_case import load_case
        from gpubspline.export import check_extension

        check_extension(self.output)
        for path in self.paths:
            check_writable(path)
        check_apart(self.paths, [*inputs, Path(self.load)])
        return load_case(self.load)

    def how(self) -> dict[str, Any]:
        """Keywords of ``respond``."""
        return {"modulus": self.modulus, "formulation": self.formulation, "tolerance": self.tolerance}

    def write(self, response: Any, figures: dict[str, Any], clock: Any) -> None:
        """Write the mesh and the figures."""
        from gpubspline.export import write
        from gpubspline.report.summary import write_summary

        with clock.stage("write"):
            write(response.mesh, self.output)
        figures["seconds"] = {**clock.seconds, "total": sum(clock.seconds.values())}
        if self.summary:
            write_summary(figures, self.summary)


@dataclass
class RunOptions:
    """Where kernels run, and what is said meanwhile."""

    backend: Annotated[str, _option("Run", "kernel backend", metavar="auto|warp|opencl")] = "auto"
    device: Annotated[str | None, _option("Run", "see 'gpubspline backends'", metavar="NAME")] = None
    precision: Annotated[str, _option("Run", "of the kernels", metavar="float32|float64")] = "float32"
    quiet: Annotated[bool, _option("Run", "print warnings and errors only", "--quiet", "-q")] = False

    def open(self) -> Any:
        """Open the device."""
        from gpubspline.device import open_device

        return open_device(device_name(self.backend, self.device), self.precision)

    def clock(self) -> Any:
        """Progress on stderr, where that is a terminal."""
        from gpubspline.progress import ShownClock

        return ShownClock(shown=not self.quiet and sys.stderr.isatty())

    def say(self, lines: list[str]) -> None:
        """Print the result, unless quiet."""
        if not self.quiet:
            typer.echo("\n".join(lines))


def integers(text: str | None, name: str, counts: tuple[int, ...]) -> tuple[int, ...] | None:
    """Read ``"20,80,26"``; raises InputError unless it has one of the given numbers of integers."""
    if text is None:
        return None
    try:
        values = tuple(int(part) for part in text.split(","))
    except ValueError:
        values = ()
    if len(values) not in counts:
        expected = " or ".join(str(count) for count in counts)
        raise InputError(f"expected {expected} integers with commas for --{name}, got {text!r}")
    return values


def numbers(text: str | None, name: str, count: int) -> tuple[float, ...] | None:
    """Read ``"0.5,0.5,2"``; raises InputError unless it is as many numbers."""
    if text is None:
        return None
    try:
        values = tuple(float(part) for part in text.split(","))
    except ValueError:
        values = ()
    if len(values) != count or not all(map(isfinite, values)):
        raise InputError(f"expected {count} numbers with commas for --{name}, got {text!r}")
    return values


def slice_range(text: str | None) -> tuple[int | None, int | None] | None:
    """Read ``"5:20"``, ``":20"`` or ``"-10:"``; raises InputError for anything else."""
    if text is None:
        return None
    try:
        first, last = (int(part) if part.strip() else None for part in text.split(":"))
    except ValueError:
        raise InputError(f"expected A:B for --slices, got {text!r}") from None
    return first, last


def device_name(backend: str, device: str | None) -> str:
    """One name for ``open_device`` from the two options: ``warp`` and ``cuda:0`` give ``warp:cuda:0``."""
    if device is None or device == "auto":
        return backend
    kind = device.partition(":")[0]
    if kind in ("warp", "opencl"):
        if backend not in ("auto", kind):
            raise InputError(f"expected a device of the backend {backend}, got {device}")
        return device
    if backend == "auto":
        backend = "warp" if kind in ("cpu", "cuda") else "opencl"
    return f"{backend}:{device}"
